"""A small robot, an ideal plant and a configuration, for tests of the controller."""

import math
from collections.abc import Sequence
from typing import Any, cast

from onebot_control.controlled_robot import ControlledRobot, Snapshot
from onebot_control.drive.diff_drive import DiffDriveKinematics
from onebot_control.drive.odometry import Odometry
from onebot_control.drive_kinds import ControlConfig
from onebot_control.fleet import Fleet
from onebot_control.physics.robot_body import JointStates, MassVelocity, RobotBody, Twist
from onebot_control.prepared_robot import Member, PreparedRobot
from onebot_description.description import Description, parse_description
from onebot_description.geometry.poses import Transform, rotate

SEPARATION, RADIUS = 0.3, 0.06  # m
WHEELS = {
    "left_wheel_names": ["left_wheel_joint"],
    "right_wheel_names": ["right_wheel_joint"],
}
_INERTIA = 'ixx="0.0003" iyy="0.0004" izz="0.0003" ixy="0" ixz="0" iyz="0"'


def wheel(side: str, y: float, shape: str = f'<sphere radius="{RADIUS}"/>') -> str:
    """A wheel and its joint, as URDF."""
    return f"""
  <link name="{side}_wheel">
    <inertial><mass value="0.2"/><inertia {_INERTIA}/></inertial>
    <collision><geometry>{shape}</geometry></collision>
  </link>
  <joint name="{side}_wheel_joint" type="continuous">
    <parent link="base_link"/><child link="{side}_wheel"/>
    <origin xyz="0 {y} 0"/><axis xyz="0 1 0"/><limit effort="5" velocity="40"/>
  </joint>"""


CASTER = f"""
  <link name="caster">
    <inertial><mass value="0.2"/><inertia {_INERTIA}/></inertial>
    <collision><geometry><sphere radius="0.03"/></geometry></collision>
  </link>
  <joint name="caster_joint" type="fixed">
    <parent link="base_link"/><child link="caster"/><origin xyz="-0.2 0 -0.03"/>
  </joint>"""


def urdf(*parts: str, name: str = "bot") -> str:
    """A base with ``parts`` on it; by default two wheels and a sliding caster."""
    chosen = parts or (wheel("left", SEPARATION / 2), wheel("right", -SEPARATION / 2), CASTER)
    return f"""<robot name="{name}">
  <link name="base_link">
    <inertial><origin xyz="-0.05 0 0"/><mass value="3.5"/>
      <inertia ixx="0.03" iyy="0.03" izz="0.04" ixy="0" ixz="0" iyz="0"/></inertial>
  </link>{"".join(chosen)}
</robot>"""


def robot(*parts: str) -> Description:
    """The checked description of ``urdf(*parts)``."""
    return parse_description(urdf(*parts))


def config(**values: Any) -> ControlConfig:
    """A configuration with the wheels named; ``linear_x_...`` stands for ``linear.x....``."""
    dotted = {_dotted(name): value for name, value in values.items()}
    return ControlConfig.from_parameters({**WHEELS, **dotted})


def _dotted(name: str) -> str:
    for axis in ("linear_x_", "angular_z_"):
        name = name.replace(axis, axis[:-3] + "." + axis[-2] + ".")
    return name


class IdealPlant:
    """Wheels that turn as told at once, and never slip."""

    joints = ("left_wheel_joint", "right_wheel_joint")
    scene = None

    def __init__(self, left: float = 0.0, right: float = 0.0) -> None:
        self.left, self.right = left, right
        self.world = self
        self.speeds = (0.0, 0.0)
        self.closed = False
        self.reset()

    def turn(self, velocities: Sequence[float]) -> None:
        self.targets = velocities

    def step(self, duration: float) -> None:
        left, right = self.targets
        assert math.isfinite(left) and math.isfinite(right)
        self.speeds = (left, right)
        self.left += left * duration
        self.right += right * duration
        self._truth.update_from_velocities((left, right), duration)

    def state(self) -> tuple[JointStates, Transform, MassVelocity]:
        pose, (linear, angular) = self.base_pose(), self.base_twist()
        velocity = MassVelocity(rotate(pose.rotation, linear), angular, (0.0, 0.0, 0.0))
        return self.joint_states(), pose, velocity

    def joint_states(self) -> JointStates:
        return JointStates((self.left, self.right), tuple(self.speeds), (0.0, 0.0))

    def base_pose(self) -> Transform:
        half = self._truth.heading / 2.0
        rotation = (0.0, 0.0, math.sin(half), math.cos(half))
        return Transform((self._truth.x, self._truth.y, RADIUS), rotation)

    def base_twist(self) -> Twist:
        linear, _, angular = self._truth.kinematics.body_motion(self.speeds, ())
        return Twist((linear, 0.0, 0.0), (0.0, 0.0, angular))

    def reset(self) -> None:
        self._truth = Odometry(DiffDriveKinematics(SEPARATION, RADIUS, RADIUS))

    def teleport(self, x: float, y: float, yaw: float) -> None:
        self._truth.set_pose(x, y, yaw)

    def obstructed(self) -> bool:
        return False

    def close(self) -> None:
        self.closed = True


class IdealWorld:
    """Moves ideal plants together."""

    def __init__(self, plants: Sequence[IdealPlant]) -> None:
        self.plants = plants

    def step(self, duration: float, *, recorded: bool | None = False) -> None:
        for plant in self.plants:
            plant.step(duration)

    def close(self) -> None:
        for plant in self.plants:
            plant.close()


def controlled_robot(
    description: Description, config: ControlConfig, plant: RobotBody
) -> ControlledRobot:
    """A robot in this plant."""
    return ControlledRobot(PreparedRobot(Member(description, config)), plant)


def ideal_drive(plant: IdealPlant | None = None, **values: Any) -> ControlledRobot:
    """A drive of the ideal plant."""
    chosen = config(**values)
    return controlled_robot(robot(), chosen, cast(RobotBody, plant or IdealPlant()))


def alone(description: Description, config: ControlConfig) -> Fleet:
    """A robot in a world of its own."""
    return Fleet.from_members([Member(description, config)])


def cycle(drive: ControlledRobot) -> Snapshot:
    """Do a control cycle of the only robot of a world; how it was at its beginning."""
    snapshot = drive.begin()
    drive.turn()
    drive.body.world.step(drive.period)
    return snapshot
