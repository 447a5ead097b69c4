"""A robot's joints as arrays, and where its links are for given joint positions."""

from onebot_description.model.robot_model import RobotModel

__all__ = ["RobotModel"]
