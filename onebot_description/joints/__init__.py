"""Joint positions from parameters: zeros, motions, named poses, mimic joints, limits.

Example:
    >>> from onebot_description.description import Joint
    >>> from onebot_description.joints.config import JointsConfig
    >>> from onebot_description.joints.source import JointStateSource
    >>> from onebot_description.parameters.reader import read
    >>> motion = {"type": "sine", "amplitude": 1.0, "frequency": 0.05}
    >>> config = read(JointsConfig, {"motions": {"elbow": motion}})
    >>> source = JointStateSource([Joint("elbow", "continuous", "arm", "hand")], config)
    >>> positions, velocities = source.sample(0.0)
    >>> positions.tolist()  # rad
    [0.0]

This package imports none of its modules.
"""
