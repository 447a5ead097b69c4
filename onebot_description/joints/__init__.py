"""Joint positions from parameters: zeros, motions, named poses, mimic joints, limits.

from onebot_description.joints.config import JointsConfig
from onebot_description.joints.source import JointStateSource

source = JointStateSource(description.joints, JointsConfig.from_parameters({
    "motions": {"elbow": {"type": "sine", "amplitude": 1.0, "frequency": 0.05}},
}))
positions, velocities = source.sample(0.1)

This package imports none of its modules.
"""
