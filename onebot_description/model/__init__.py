"""Forward kinematics for given joint positions, and links that are fixed together as one body."""

from onebot_description.model.robot_model import RobotModel

__all__ = ["RobotModel"]
