"""The wheels' separation and radius, read from the robot's description."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from onebot_control.wheels.shapes import Tyre, Tyres
from onebot_description.description.description import Description, Joint
from onebot_description.errors import OneBotError, did_you_mean
from onebot_description.model import RobotModel, quaternions
from onebot_description.parameters.reader import ConfigError, Problem

Floats = NDArray[np.float64]

# How far apart lengths may be and still count as the same, m.
_SAME = 1e-6
_LEFT = np.array([0.0, 1.0, 0.0])
_STEPS = 200  # of a fixed-point iteration that needs one for four equal loads
_LEAST = 0.01  # load of a wheel, of the mean of all


class WheelGeometry(NamedTuple):
    """What a differential drive's odometry rests on."""

    separation: float  # distance between left and right wheels, m; of skid steer the effective one
    radius: float  # of all the wheels, m


class Axle(NamedTuple):
    """A joint that turns, seen from the root link with all joints at 0."""

    joint: Joint
    pose: Floats  # (4, 4) of the joint's frame
    axis: Floats  # (3,), unit vector

    @property
    def across(self) -> bool:
        """Whether it points to the left or to the right, as a wheel's does."""
        return bool(np.allclose(abs(self.axis), _LEFT, atol=1e-3))

    @property
    def direction(self) -> float:
        """1 if a positive velocity of a wheel on it drives forward, -1 if backward."""
        return 1.0 if self.axis[1] > 0.0 else -1.0

    def middle(self, tyre: Tyre | None) -> Floats:
        """The middle (3,) of the wheel."""
        position: Floats = self.pose[:3, 3]
        return position if tyre is None else position + tyre.offset * self.axis


def axles(description: Description) -> dict[str, Axle]:
    """Return the continuous and revolute joints by name."""
    model = RobotModel.from_description(description)
    poses = dict(zip(model.links, model.link_poses({}), strict=True))
    found = {}
    for joint in description.joints:
        if joint.kind in ("continuous", "revolute"):
            place = np.eye(4)
            place[:3, :3] = quaternions.to_matrix(poses[joint.child][3:])
            place[:3, 3] = poses[joint.child][:3]
            found[joint.name] = Axle(joint, place, place[:3, :3] @ np.array(joint.axis))
    return found


def check_wheel_names(description: Description, **sides: Sequence[str]) -> None:
    """Check that each name is a joint of the robot that turns.

    Args:
        description: of the robot.
        sides: parameter name to the joints it names.

    Raises:
        ConfigError: naming the joints that there are.
    """
    turning = [j.name for j in description.joints if j.kind in ("continuous", "revolute")]
    problems = [
        Problem(
            parameter,
            f'robot "{description.robot_name}" has no joint "{name}" that turns'
            f"{did_you_mean(name, turning, 'it has')}",
        )
        for parameter, names in sides.items()
        for name in names
        if name not in turning
    ]
    if problems:
        raise ConfigError(problems)


def wheel_geometry(
    description: Description,
    left_names: Sequence[str],
    right_names: Sequence[str],
    *,
    separation: float = 0.0,
    radius: float = 0.0,
) -> WheelGeometry:
    """Return the drive's geometry: what is given, and the description's where that is 0.

    Raises:
        OneBotError: a wheel joint is missing, or the description does not define the geometry.
    """
    return WheelGeometry(
        separation or wheel_separation(description, left_names, right_names),
        radius or wheel_radius(description, [*left_names, *right_names]),
    )


def wheel_directions(description: Description, names: Sequence[str]) -> dict[str, float]:
    """Return for each wheel joint 1 if a positive velocity drives forward, -1 if backward.

    Raises:
        OneBotError: a joint is missing, or its axis points neither to the left nor to the right.
    """
    found = axles(description)
    for name in names:
        _check_axle(description, name, found[name])
    return {name: found[name].direction for name in names}


def wheel_separation(
    description: Description, left_names: Sequence[str], right_names: Sequence[str]
) -> float:
    """Return the distance between the wheels of the two sides, m.

    Across the driving direction; of wheels that stand in one line with it, the whole distance, as
    diff_drive_controller has taken it. Of several wheels a side, the effective one; see
    ``skid_separation``.

    Raises:
        OneBotError: a joint is missing, or left is not left of right, or an axle points elsewhere.
    """
    check_wheel_names(description, left_wheel_names=left_names, right_wheel_names=right_names)
    wheel_directions(description, [*left_names, *right_names])
    turning, tyres = axles(description), Tyres(description)
    lefts, rights = (
        np.array([turning[name].middle(tyres.of(name)) for name in names])
        for names in (left_names, right_names)
    )
    left, right = lefts.mean(axis=0), rights.mean(axis=0)
    across, apart = float(left[1] - right[1]), float(np.linalg.norm(left - right))
    if abs(across) <= _SAME < apart:
        return apart
    if across <= 0.0:
        raise OneBotError(
            f'robot "{description.robot_name}": the left wheels ({", ".join(left_names)}) are at '
            f"y = {left[1]:g} m, not left of the right ones ({', '.join(right_names)}) at "
            f"y = {right[1]:g} m; swap left_wheel_names and right_wheel_names"
        )
    if len(left_names) == 1:
        return across
    return skid_separation(across, np.concatenate([lefts, rights])[:, 0], _center(description))


def skid_separation(across: float, along: Floats, center: float) -> float:
    """Return the separation of two wheels that would turn a robot as these do.

    Wheels one behind the other cannot turn the robot without sliding sideways. The friction that
    this takes opposes the whole sliding, so that the wheels slide forward and backward, too, and
    turn the robot less. The robot turns about the point at which neither the forces nor the moments
    of the friction, the same in all directions and in proportion to the load, accelerate it. For
    four wheels with the centre of mass in the middle that gives across * (1 + (L / across)^2), L
    being the wheelbase.

    Args:
        across: distance of the two sides, m.
        along: (N,) positions of all wheels along the robot, m.
        center: position of the centre of mass along the robot, m.
    """
    along, center = along - along.mean(), center - float(along.mean())
    spread = float(np.mean(along**2))
    if spread <= _SAME**2:
        return across
    loads = np.maximum(1.0 + along * center / spread, _LEAST)
    turning, slip = 0.0, 2.0 * spread / across  # x of the point; m/s at a wheel for 1 rad/s
    for _ in range(_STEPS):
        sideways = along - turning
        weights = loads / np.hypot(slip, sideways)
        slip = 2.0 / across * float(np.average(sideways**2, weights=weights))
        turning = float(np.average(along, weights=weights))
    return across + 2.0 * slip


def _center(description: Description) -> float:
    """Return the position of the robot's centre of mass along the robot, m."""
    model = RobotModel.from_description(description)
    poses = dict(zip(model.links, model.link_poses({}), strict=True))
    masses = moment = 0.0
    for link in description.links:
        if link.inertial is not None:
            pose = poses[link.name]
            place = pose[:3] + quaternions.rotate(pose[3:], np.array(link.inertial.origin.xyz))
            masses += link.inertial.mass
            moment += link.inertial.mass * float(place[0])
    return moment / masses if masses > 0.0 else 0.0


def wheel_radius(description: Description, names: Sequence[str]) -> float:
    """Return the one radius, m, of the round shapes that these joints' links roll on.

    Raises:
        OneBotError: a link has no such shape, or they differ.
    """
    tyres = Tyres(description)
    radii = {name: _radius(description, name, tyres) for name in names}
    if max(radii.values()) - min(radii.values()) > _SAME:
        listed = ", ".join(f"{name} {radius:g} m" for name, radius in radii.items())
        raise OneBotError(
            f'robot "{description.robot_name}" has wheels of several radii ({listed}): set '
            "wheel_radius, and left_wheel_radius_multiplier and right_wheel_radius_multiplier"
        )
    return next(iter(radii.values()))


def _check_axle(description: Description, name: str, axle: Axle) -> None:
    if axle.across:
        return
    shown = " ".join(f"{value:g}" for value in np.round(axle.axis, 3) + 0.0)
    raise OneBotError(
        f'robot "{description.robot_name}", joint "{name}": its axis points to ({shown}) in the '
        f"frame of {description.root_link}; that of a wheel must point to the left, (0 1 0), or "
        "to the right, (0 -1 0)"
    )


def _radius(description: Description, name: str, tyres: Tyres) -> float:
    if (tyre := tyres.of(name)) is not None:
        return tyre.radius
    link = next(joint.child for joint in description.joints if joint.name == name)
    raise OneBotError(
        f'robot "{description.robot_name}", joint "{name}": link "{link}" has no one sphere, '
        "cylinder or round mesh to read the wheel's radius from; set wheel_radius (m)"
    )
