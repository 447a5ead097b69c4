"""Joint positions from parameters: zeros, motions, named poses, mimic joints, limits.

source = JointStateSource(description.joints, JointsConfig.from_parameters({
    "motions": {"elbow": {"type": "sine", "amplitude": 1.0, "frequency": 0.05}},
}))
positions, velocities = source.sample(0.1)
"""

from onebot_description.joints.config import Dependent, JointsConfig, Sequence
from onebot_description.joints.limits import soft_limits
from onebot_description.joints.motions import Constant, Keyframes, Sine
from onebot_description.joints.problems import ConfigError, Problem
from onebot_description.joints.source import JointStateSource

__all__ = [
    "ConfigError",
    "Constant",
    "Dependent",
    "JointStateSource",
    "JointsConfig",
    "Keyframes",
    "Problem",
    "Sequence",
    "Sine",
    "soft_limits",
]
