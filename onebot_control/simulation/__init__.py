"""A robot on flat ground in PyBullet, without ROS: wheel speeds in, motion out.

simulation = Simulation(description, driven=("left_wheel_joint", "right_wheel_joint"))
for _ in range(100):
    simulation.step({"left_wheel_joint": 3.0, "right_wheel_joint": 3.0}, 0.01)
print(simulation.base_pose().translation)
"""

from onebot_control.simulation.robot import JointStates, Pose, Twist
from onebot_control.simulation.scene import SceneBodies
from onebot_control.simulation.settings import RobotSpawn, Settings
from onebot_control.simulation.world import Simulation, World, WorldRobot

__all__ = [
    "JointStates",
    "RobotSpawn",
    "Pose",
    "SceneBodies",
    "Settings",
    "Simulation",
    "Twist",
    "World",
    "WorldRobot",
]
