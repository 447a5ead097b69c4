"""Physics of robots on level ground or in a scene, with PyBullet: joint velocities in, motion out.

Example:
    >>> from onebot_control.physics import RobotSpawn, World
    >>> from onebot_description.description import load_description
    >>> description = load_description("package://onebot_description/urdf/onebot.urdf.xacro")
    >>> with World([RobotSpawn(description, ("left_wheel_joint", "right_wheel_joint"))]) as world:
    ...     [robot] = world.robots
    ...     robot.turn([3.0, 3.0])  # rad/s
    ...     world.step(1.0)
    ...     joints, pose, velocity = robot.state()
    >>> pose.translation[0] > 0.1
    True
"""

from onebot_control.physics.engine import PhysicsSettings
from onebot_control.physics.robot_body import JointStates, MassVelocity, RobotBody, Twist
from onebot_control.physics.scene import SceneBodies
from onebot_control.physics.spawning import RobotSpawn
from onebot_control.physics.world import World

__all__ = [
    "JointStates",
    "MassVelocity",
    "RobotBody",
    "RobotSpawn",
    "SceneBodies",
    "PhysicsSettings",
    "Twist",
    "World",
]
