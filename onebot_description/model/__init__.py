"""Forward kinematics: transforms of joints and poses of links for given joint positions."""

from onebot_description.model.robot_model import RobotModel

__all__ = ["RobotModel"]
