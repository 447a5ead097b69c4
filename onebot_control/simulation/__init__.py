"""A robot on flat ground in PyBullet, without ROS: wheel speeds in, motion out.

simulation = Simulation(description, driven=("left_wheel_joint", "right_wheel_joint"))
for _ in range(100):
    simulation.step({"left_wheel_joint": 3.0, "right_wheel_joint": 3.0}, 0.01)
print(simulation.base_pose().translation)
"""

from onebot_control.simulation.member import Member
from onebot_control.simulation.settings import Settings
from onebot_control.simulation.simulation import Simulation
from onebot_control.simulation.states import JointStates, Pose, Twist
from onebot_control.simulation.world import World
from onebot_control.simulation.world_robot import WorldRobot

__all__ = [
    "JointStates",
    "Member",
    "Pose",
    "Settings",
    "Simulation",
    "Twist",
    "World",
    "WorldRobot",
]
