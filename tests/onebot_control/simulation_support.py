"""The robot that the simulation's tests drive, whole or spoilt in some way."""

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from onebot_control.physics.engine import PhysicsSettings
from onebot_control.physics.robot_body import JointStates, RobotBody, Twist
from onebot_control.physics.spawning import RobotSpawn
from onebot_control.physics.world import World
from onebot_description.description import Description, parse_description
from onebot_description.geometry.poses import PlanarPose, Transform, yaw_of

ROBOTS = Path(__file__).resolve().parent.parent / "robots"
URDF = (ROBOTS / "diff_drive.urdf").read_text()
LEFT, RIGHT = "left_wheel_joint", "right_wheel_joint"
DRIVEN = (LEFT, RIGHT)
RADIUS, SEPARATION = 0.06, 0.3


def robot(pattern: str = "", replacement: str = "", count: int = 0) -> Description:
    """The test robot with every match of ``pattern`` (a regular expression) replaced."""
    text = URDF
    if pattern:
        text, replaced = re.subn(pattern, replacement, URDF, count=count, flags=re.DOTALL)
        assert replaced, pattern
    return parse_description(text, str(ROBOTS / "diff_drive.urdf"))


class Simulation(World):
    """A world of one robot, with the robot's methods."""

    def step(self, velocities, duration):
        self.robots[0].turn(velocities)
        super().step(duration)

    def joint_states(self) -> JointStates:
        return self.robots[0].state()[0]

    def base_pose(self) -> Transform:
        return self.robots[0].state()[1]

    def base_twist(self) -> Twist:
        _, pose, velocity = self.robots[0].state()
        return velocity.twist(pose.rotation)

    def __getattr__(self, name):
        return getattr(self.robots[0], name)


def simulate(
    description: Description | None = None,
    driven: Sequence[str] = DRIVEN,
    settings: PhysicsSettings = PhysicsSettings(),  # noqa: B008 - it is frozen
    scene: Description | None = None,
    **place: float,
) -> Simulation:
    spawn = RobotSpawn(description or robot(), driven, PlanarPose(**place))
    return Simulation([spawn], settings, scene)


def drive(simulation: Simulation, linear: float, angular: float, duration: float) -> None:
    """Drive for ``duration`` s as a controller does: by ramps of 0.5 m/s^2 and 1 rad/s^2."""
    period, v, w = 0.01, 0.0, 0.0
    cycles = round(duration / period)
    for cycle in range(cycles):
        left = (cycles - 1 - cycle) * period
        v = _ramp(v, linear, 0.5, left, period)
        w = _ramp(w, angular, 1.0, left, period)
        simulation.step(wheels(v, w), period)


def _ramp(now: float, goal: float, slope: float, left: float, period: float) -> float:
    goal = float(np.clip(goal, -slope * left, slope * left))
    return float(np.clip(goal, now - slope * period, now + slope * period))


def wheels(linear: float, angular: float) -> list[float]:
    """Wheel speeds, left and right, rad/s."""
    half = angular * SEPARATION / 2.0
    return [(linear - half) / RADIUS, (linear + half) / RADIUS]


def planar(simulation: Simulation | RobotBody) -> tuple[float, float, float]:
    """Where the robot is: x, y in m, heading in rad."""
    _, pose, _ = simulation.state()
    return (*pose.translation[:2], yaw_of(*pose.rotation))


def bits(simulation: Simulation | RobotBody) -> bytes:
    """The state of a robot, every bit of it."""
    return np.concatenate([value for part in simulation.state() for value in part]).tobytes()
