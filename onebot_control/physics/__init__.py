"""Robots on flat ground in PyBullet, without ROS: wheel velocities in, motion out.

with World([RobotSpawn(description, ("left_wheel_joint", "right_wheel_joint"))]) as world:
    [robot] = world.robots
    robot.turn([3.0, 3.0])
    world.step(1.0)
    print(robot.base_pose().translation)
"""

from onebot_control.physics.physics_settings import Settings
from onebot_control.physics.robot import JointStates, MassVelocity, Pose, Robot, Twist
from onebot_control.physics.scene_bodies import SceneBodies
from onebot_control.physics.spawning import RobotSpawn
from onebot_control.physics.world import World

__all__ = [
    "JointStates",
    "MassVelocity",
    "Pose",
    "Robot",
    "RobotSpawn",
    "SceneBodies",
    "Settings",
    "Twist",
    "World",
]
