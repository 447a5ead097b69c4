"""Forward kinematics for given joint positions, and rigid bodies of links fixed together."""

from onebot_description.model.robot_model import RobotModel

__all__ = ["RobotModel"]
