"""Robots with the drives that are not differential, for tests; all in SI units."""

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType

from onebot_control.drive_kinds import DRIVES
from onebot_description.description import Description, parse_description

MECANUM = DRIVES["mecanum_drive_controller/MecanumDriveController"]
OMNI = DRIVES["omni_wheel_drive_controller/OmniWheelDriveController"]
STEERING = DRIVES["ackermann_steering_controller/AckermannSteeringController"]
TRICYCLE = DRIVES["tricycle_controller/TricycleController"]

RADIUS, LENGTH, WIDTH, CIRCLE = 0.05, 0.15, 0.14, 0.18
BASE, TRACK, STEERS = 0.32, 0.28, 0.5  # wheelbase, m, track, m, limit of each steering joint, rad
CORNERS = {
    "front_left": (1, 1),
    "front_right": (1, -1),
    "rear_right": (-1, -1),
    "rear_left": (-1, 1),
}


def wheel(name: str, place: Sequence[float], *, yaw: float = 0.0, parent: str = "base") -> str:
    """A wheel whose axle points to the left of ``yaw``."""
    moment, (x, y, z) = 0.5 * RADIUS**2, place
    return (
        f'<link name="{name}"><inertial><mass value="0.5"/><inertia ixx="{0.3 * moment}" '
        f'iyy="{0.3 * moment}" izz="{0.5 * moment}" ixy="0" ixz="0" iyz="0"/></inertial><collision>'
        f'<geometry><cylinder radius="{RADIUS}" length="0.04"/></geometry></collision></link>'
        f'<joint name="{name}_joint" type="continuous"><parent link="{parent}"/>'
        f'<child link="{name}"/><origin xyz="{x} {y} {z}" rpy="{-math.pi / 2.0} 0 {yaw}"/>'
        '<axis xyz="0 0 1"/><limit effort="20" velocity="60"/></joint>'
    )


def steered(name: str, x: float, y: float, axis: str = "0 0 1") -> str:
    """A wheel that a hinge steers."""
    return (
        f'<link name="{name}_hinge"><inertial><mass value="0.2"/><inertia ixx="1e-3" iyy="1e-3" '
        'izz="1e-3" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        f'<joint name="{name}_steering" type="revolute"><parent link="base"/>'
        f'<child link="{name}_hinge"/><origin xyz="{x} {y} {RADIUS}"/><axis xyz="{axis}"/>'
        f'<limit lower="{-STEERS}" upper="{STEERS}" effort="20" velocity="5"/></joint>'
        f"{wheel(name, (0.0, 0.0, 0.0), parent=f'{name}_hinge')}"
    )


def robot(*parts: str, name: str) -> Description:
    """A box of 10 kg on wheels."""
    return parse_description(
        f'<robot name="{name}"><link name="base"><inertial><origin xyz="0 0 0.08"/><mass value="10"'
        '/><inertia ixx="0.1" iyy="0.15" izz="0.2" ixy="0" ixz="0" iyz="0"/></inertial><collision>'
        '<origin xyz="0 0 0.13"/><geometry><box size="0.48 0.25 0.1"/></geometry></collision>'
        f"</link>{''.join(parts)}</robot>",
        f"{name}.urdf",
    )


def mecanum(
    names: Mapping[str, str] = MappingProxyType({}), ahead: float = 0.0, *parts: str
) -> Description:
    """Wheels at the corners, by these names or such as mecanum_front_left."""
    wheels = [
        wheel(names.get(corner, f"mecanum_{corner}"), (LENGTH * x + ahead, WIDTH * y, RADIUS))
        for corner, (x, y) in CORNERS.items()
    ]
    return robot(*wheels, *parts, name="mecanum")


def omni(count: int = 3, first: float = 0.3) -> Description:
    """Wheels on a circle, the first at this angle to the left of forward, rad."""
    angles = [first + math.tau * row / count for row in range(count)]
    wheels = [
        wheel(f"w{row}", (CIRCLE * math.cos(a), CIRCLE * math.sin(a), RADIUS), yaw=a - math.pi / 2)
        for row, a in enumerate(angles)
    ]
    return robot(*wheels, name="omni")


def car(rear: float = -0.15, axis: str = "0 0 1") -> Description:
    """Two driven wheels at the rear, at this x, and two steered ones in front."""
    behind = [wheel(f"rear_{side}", (rear, y * TRACK / 2, RADIUS)) for side, y in SIDES.items()]
    ahead = [steered(f"front_{s}", rear + BASE, y * TRACK / 2, axis) for s, y in SIDES.items()]
    return robot(*behind, *ahead, name="car")


def tricycle() -> Description:
    """One steered wheel in front, and two at the rear."""
    behind = [wheel(f"rear_{side}", (-0.15, y * TRACK / 2, RADIUS)) for side, y in SIDES.items()]
    return robot(*behind, steered("front", BASE - 0.15, 0.0), name="tricycle")


SIDES = {"left": 1, "right": -1}
