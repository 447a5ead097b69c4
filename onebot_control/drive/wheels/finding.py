"""Finds the wheels of a drive among a robot's joints, by their geometry.

A wheel turns about a level axis and reaches the ground with a round shape. Wheels on two sides turn
about a lateral axis, are on the left or the right, and are not carried by a joint that swivels
them. Names decide only if several sets of wheels remain.
"""

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from onebot_control.conventions import WORLD_FRAME
from onebot_control.drive.wheels.rolling_shapes import Tyre, Tyres, lowest_point
from onebot_description.arrays import Floats
from onebot_description.elements.urdf import Description, Joint, Mesh
from onebot_description.errors import OneBotError
from onebot_description.geometry import matrices
from onebot_description.model import RobotModel
from onebot_description.model.rigid_bodies import rigid_frames

_MIDDLE = 0.005  # m; a wheel closer to the middle line is on neither side
_GROUND = 0.1  # a wheel on the ground is at most this fraction of its radius above the lowest one
_ALIKE = 0.01  # relative difference of radii in a set; also m above the lowest wheel
_ACROSS = math.cos(math.radians(1.0))  # cosine of the greatest angle of an axle to the lateral axis
_LEVEL = math.sin(math.radians(1.0))  # sine of the greatest angle of an axle to the ground
_TRAIL = 0.1  # a caster's wheel trails its swivel by at least this fraction of its radius
_VERTICAL = 0.9  # cosine of the greatest angle of a swivel joint to the vertical
_PASSIVE = re.compile(r"cast[eo]r|passive|free|idler|support|omni|dummy", re.IGNORECASE)
# Matches the names of omnidirectional wheels and of their meshes.
_SKEW = math.sin(math.radians(5.0))  # sine of the least angle of a mecanum wheel's rollers
_FEWEST_OMNI = 3  # wheels of a drive by omni wheels
_FEWEST_OBLIQUE = 2  # those of them that are not lateral; one may be
_ROLLERS = re.compile(r"mec+anum|omni|swedish", re.IGNORECASE)


class Axle(NamedTuple):
    """A rotating joint, in the root link's frame with all joints at 0."""

    joint: Joint
    pose: Floats  # (4, 4) of the joint's frame
    axis: Floats  # (3,), unit vector

    @property
    def across(self) -> bool:
        """Whether it points to the left or to the right within a degree, as a wheel's axle does."""
        return abs(float(self.axis[1])) >= _ACROSS

    @property
    def level(self) -> bool:
        """Whether it is level within a degree, as each wheel's axle is."""
        return abs(float(self.axis[2])) <= _LEVEL

    @property
    def direction(self) -> float:
        """1 if a positive velocity of a wheel on it drives forward, -1 if backward."""
        return 1.0 if self.axis[1] > 0.0 else -1.0

    def middle(self, tyre: Tyre | None) -> Floats:
        """Return the middle of the wheel, (3,), m; without a tyre the joint's origin."""
        position: Floats = self.pose[:3, 3]
        return position if tyre is None else position + tyre.offset * self.axis


class Wheel(NamedTuple):
    """What rolls, in the root link's frame with all joints at 0."""

    name: str  # the joint's
    x: float  # position of its middle in the frame of the root link, m
    y: float  # likewise
    bottom: float  # z where it touches the ground, m
    radius: float  # m
    link: str


def axles(description: Description, places: Mapping[str, Floats]) -> dict[str, Axle]:
    """Return the continuous and revolute joints by name.

    Args:
        description: the robot.
        places: the pose (4, 4) of each link in the root link's frame, with all joints at 0.
    """
    return {
        joint.name: Axle(joint, places[joint.child], places[joint.child][:3, :3] @ joint.axis)
        for joint in description.joints
        if joint.kind in ("continuous", "revolute")
    }


def find_wheels(
    description: Description, turning: Mapping[str, Axle], tyres: Tyres, *, rollers: bool = False
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Find the wheels on two sides that drive the robot.

    Args:
        description: the robot.
        turning: its rotating joints; see ``axles``.
        tyres: the round shapes of its links.
        rollers: whether its wheels have rollers, as those of a mecanum drive; else that is refused.

    Returns:
        The wheels' joints on the left, and those on the right, from front to rear.

    Raises:
        OneBotError: there are no such wheels, or several sets of them, or they are steered or
            omnidirectional; the text lists the rotating joints.
    """
    lateral = _on_ground(_lateral(turning, tyres))
    swivels = {wheel.name: swivel(description, wheel.name, turning) for wheel in lateral}
    _check_steering(description, turning, tyres)
    wheels = [wheel for wheel in lateral if swivels[wheel.name] is None]
    sets = _sets(wheel for wheel in wheels if abs(wheel.y) > _MIDDLE)
    sets = [group for group in sets if not any(map(_is_passive, group))] or sets
    if len(sets) != 1:
        raise _not_driven(description, turning, _why_not_one_set(sets))
    [drive] = sets
    if not rollers and (reason := rollers_reason(description, drive)):
        text = f"it is no differential drive: {reason}; let the control file name the type of its"
        raise _not_driven(description, turning, f"{text} drive, or none")
    drive.sort(key=lambda wheel: -wheel.x)
    left = tuple(wheel.name for wheel in drive if wheel.y > 0.0)
    return left, tuple(wheel.name for wheel in drive if wheel.y < 0.0)


def steered_wheels(
    description: Description, turning: Mapping[str, Axle], tyres: Tyres
) -> dict[str, str]:
    """Return the joints that steer wheels on the ground, by the wheels' joints."""
    steered = {}
    for wheel in _on_ground(_lateral(turning, tyres)):
        joint = swivel(description, wheel.name, turning)
        if joint and _is_steered(wheel, turning[wheel.name], turning[joint.name]):
            steered[wheel.name] = joint.name
    return steered


def rollers_reason(description: Description, wheels: Sequence[Wheel]) -> str:
    """Return why wheels have rollers by which they drive sideways, too; "" if they have not."""
    if len(wheels) <= 2:
        return ""
    if all(_has_rollers(description, wheel) for wheel in wheels):
        return "by their names, its wheels are omnidirectional, with rollers around them"
    plugin = description.drive_plugin
    if plugin is not None and plugin.kind in ("mecanum", "planar"):
        return f"it drives sideways, too ({plugin.where})"
    oblique = [link for link, angle in description.rollers.items() if abs(math.sin(angle)) > _SKEW]
    if oblique:
        return f"<fdir1> says that its wheels have rollers ({', '.join(oblique)})"
    return ""


def ground_wheels(
    description: Description, turning: Mapping[str, Axle], tyres: Tyres
) -> list[Wheel]:
    """Return all that rolls on the ground on a level axis and that no joint swivels."""
    wheels = _on_ground(_rolling(turning, tyres))
    return [wheel for wheel in wheels if swivel(description, wheel.name, turning) is None]


def omni_wheels(
    description: Description, turning: Mapping[str, Axle], tyres: Tyres
) -> Sequence[Wheel]:
    """Return three or more alike wheels of which at least two do not drive forward; or none."""
    groups = [
        group
        for group in _alike(ground_wheels(description, turning, tyres))
        if len(group) >= _FEWEST_OMNI
        and sum(not turning[wheel.name].across for wheel in group) >= _FEWEST_OBLIQUE
    ]
    return groups[-1] if groups else ()


def has_wheels(description: Description) -> bool:
    """Return whether a robot has wheels on the ground; otherwise it stands still.

    What rolls counts as a wheel if its lowest point is at most its radius above the robot's;
    higher up it belongs to an arm. A robot whose root link is ``world`` stands still.

    Raises:
        OneBotError: the mesh of a collision shape cannot be read.
    """
    if description.root_link == WORLD_FRAME:
        return False
    tyres = Tyres(description, rigid_frames(description))
    places = RobotModel.from_description(description).link_matrices({})
    turning = axles(description, places)
    if not (wheels := _lateral(turning, tyres)):
        wheels = ground_wheels(description, turning, tyres)
        if len(wheels) < _FEWEST_OMNI:
            return False
    bottoms = [
        lowest_point(collision.shape, places[link.name] @ matrices.of_origin(collision.origin))
        for link in description.links
        for collision in link.collisions
    ]
    lowest = min(bottoms, default=math.inf)
    return any(wheel.bottom - wheel.radius <= lowest for wheel in wheels)


def _why_not_one_set(sets: Sequence[Sequence[Wheel]]) -> str:
    if sets:
        names = " or ".join(", ".join(wheel.name for wheel in group) for group in sets)
        return f"it is not clear which of its wheels drive it: {names}"
    return "no wheel on the left that has its like on the right was found among its joints"


def _check_steering(description: Description, turning: Mapping[str, Axle], tyres: Tyres) -> None:
    """Raise OneBotError if a wheel is steered, as a car's are."""
    for wheel, joint in steered_wheels(description, turning, tyres).items():
        raise OneBotError(
            f'robot "{description.robot_name}" cannot be driven: it is no differential drive: '
            f'joint "{joint}" steers the wheel of "{wheel}". Let the control file name the type of '
            "its drive, such as ackermann_steering_controller/AckermannSteeringController, or "
            "none. If it is a caster, name it so, have its wheel trail it, "
            "or name the drive wheels: left_wheel:=JOINT right_wheel:=JOINT"
        )


def _not_driven(description: Description, turning: Mapping[str, Axle], reason: str) -> OneBotError:
    joints = [f"{axle.joint.name} {_seen(axle)}" for axle in turning.values()]
    return OneBotError(
        f'robot "{description.robot_name}" cannot be driven: {reason}. Wheels are continuous '
        "joints whose axes point to the left, (0 1 0), in the frame of "
        f"{description.root_link}, with a round shape on the ground. Name them: "
        "left_wheel:=JOINT right_wheel:=JOINT, or left_wheel_names and right_wheel_names in "
        "params_file (or start without a simulation: sim:=false). "
        f"Its joints that turn: {'; '.join(joints) or 'none'}"
    )


def _seen(axle: Axle) -> str:
    x, y, z = (f"{value:.3g}" for value in np.round(axle.pose[:3, 3], 3) + 0.0)
    pointing = " ".join(f"{value:.3g}" for value in np.round(axle.axis, 3) + 0.0)
    return f"({axle.joint.kind}, at {x} {y} {z}, axis {pointing})"


def _lateral(turning: Mapping[str, Axle], tyres: Tyres) -> list[Wheel]:
    """Return everything that rolls on a lateral axis, at any height."""
    return [wheel for wheel in _rolling(turning, tyres) if turning[wheel.name].across]


def _rolling(turning: Mapping[str, Axle], tyres: Tyres) -> list[Wheel]:
    """Return everything that rolls, at any height: continuous joints with a level axis."""
    wheels = []
    for name, axle in turning.items():
        if axle.joint.kind != "continuous" or not axle.level:
            continue
        if (tyre := tyres.tyre(name)) is not None:
            x, y, z = axle.middle(tyre).tolist()
            wheels.append(Wheel(name, x, y, z - tyre.radius, tyre.radius, axle.joint.child))
    return wheels


def _on_ground(wheels: Sequence[Wheel]) -> list[Wheel]:
    ground = min((wheel.bottom for wheel in wheels), default=0.0)
    return [w for w in wheels if w.bottom - ground <= max(_ALIKE, _GROUND * w.radius)]


def swivel(description: Description, name: str, turning: Mapping[str, Axle]) -> Joint | None:
    """Return the vertical joint that swivels the wheel of a joint; None if there is none."""
    above = {joint.child: joint for joint in description.joints}
    link = turning[name].joint.parent
    while joint := above.get(link):
        if joint.name in turning and abs(turning[joint.name].axis[2]) > _VERTICAL:
            return joint
        link = joint.parent
    return None


def _is_steered(wheel: Wheel, axle: Axle, swivel: Axle) -> bool:
    """Return whether a wheel is steered; a caster's swivel is continuous, and its wheel trails."""
    if _PASSIVE.search(f"{swivel.joint.name} {wheel.name} {wheel.link}"):
        return False
    x, y, _ = np.cross(axle.axis, (0.0, 0.0, 1.0))
    trail = x * (wheel.x - swivel.pose[0, 3]) + y * (wheel.y - swivel.pose[1, 3])
    return swivel.joint.kind == "revolute" or abs(float(trail)) < _TRAIL * wheel.radius


def _sets(wheels: Iterable[Wheel]) -> list[list[Wheel]]:
    """Group wheels of similar radius; keep groups with as many wheels left as right."""
    alike = _alike(wheels)
    return [group for group in alike if sum(1 if wheel.y > 0.0 else -1 for wheel in group) == 0]


def _alike(wheels: Iterable[Wheel]) -> list[list[Wheel]]:
    """Group wheels of similar radius, the smallest first."""
    sets: list[list[Wheel]] = []
    for wheel in sorted(wheels, key=lambda wheel: wheel.radius):
        if sets and wheel.radius <= sets[-1][0].radius * (1.0 + _ALIKE) + 1e-6:
            sets[-1].append(wheel)
        else:
            sets.append([wheel])
    return sets


def _is_passive(wheel: Wheel) -> bool:
    return bool(_PASSIVE.search(f"{wheel.name} {wheel.link}"))


def _has_rollers(description: Description, wheel: Wheel) -> bool:
    link = next(link for link in description.links if link.name == wheel.link)
    shapes = [geometry.shape for geometry in (*link.collisions, *link.visuals)]
    # Only the folders next to the file; those above may belong to the user.
    files = ["/".join(shape.uri.split("/")[-3:]) for shape in shapes if isinstance(shape, Mesh)]
    return any(map(_ROLLERS.search, (wheel.name, wheel.link, *files)))
