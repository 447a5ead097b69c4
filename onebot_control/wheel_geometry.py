"""The wheels' separation and radius, read from the robot's description."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from onebot_description.description.description import Cylinder, Description, Sphere
from onebot_description.errors import OneBotError, did_you_mean
from onebot_description.model import RobotModel, quaternions
from onebot_description.parameters.reader import ConfigError, Problem

# How far apart lengths may be and still count as the same, m.
_SAME = 1e-6
_LEFT = np.array([0.0, 1.0, 0.0])


class WheelGeometry(NamedTuple):
    """What a differential drive's odometry rests on."""

    separation: float  # distance between left and right wheels, m
    radius: float  # of all the wheels, m


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


def wheel_separation(
    description: Description, left_names: Sequence[str], right_names: Sequence[str]
) -> float:
    """Return the distance between the wheels of the two sides, m.

    Across the driving direction; of wheels that stand in one line with it, the whole distance, as
    diff_drive_controller has taken it.

    Raises:
        OneBotError: a joint is missing, or left is not left of right, or an axle points elsewhere.
    """
    check_wheel_names(description, left_wheel_names=left_names, right_wheel_names=right_names)
    model = RobotModel.from_description(description)
    poses = dict(zip(model.links, model.link_poses({}), strict=True))
    children = {joint.name: joint for joint in description.joints}
    for name in (*left_names, *right_names):
        joint = children[name]
        axis = quaternions.rotate(poses[joint.child][3:], np.array(joint.axis))
        _check_axle(description, name, axis)
    left, right = (
        np.mean([poses[children[name].child][:3] for name in names], axis=0)
        for names in (left_names, right_names)
    )
    across, apart = float(left[1] - right[1]), float(np.linalg.norm(left - right))
    if abs(across) <= _SAME < apart:
        return apart
    if across <= 0.0:
        raise OneBotError(
            f'robot "{description.robot_name}": the left wheels ({", ".join(left_names)}) are at '
            f"y = {left[1]:g} m, not left of the right ones ({', '.join(right_names)}) at "
            f"y = {right[1]:g} m; swap left_wheel_names and right_wheel_names"
        )
    return across


def wheel_radius(description: Description, names: Sequence[str]) -> float:
    """Return the one radius, m, of the spheres or cylinders that these joints' links roll on.

    Raises:
        OneBotError: a link has no such shape, or they differ.
    """
    links = {joint.name: joint.child for joint in description.joints}
    radii = {name: _link_radius(description, links[name], name) for name in names}
    if max(radii.values()) - min(radii.values()) > _SAME:
        listed = ", ".join(f"{name} {radius:g} m" for name, radius in radii.items())
        raise OneBotError(
            f'robot "{description.robot_name}" has wheels of several radii ({listed}): set '
            "wheel_radius, and left_wheel_radius_multiplier and right_wheel_radius_multiplier"
        )
    return next(iter(radii.values()))


def _check_axle(description: Description, name: str, axis: NDArray[np.float64]) -> None:
    if np.allclose(axis, _LEFT, atol=1e-3):
        return
    shown = " ".join(f"{value:g}" for value in np.round(axis, 3) + 0.0)
    raise OneBotError(
        f'robot "{description.robot_name}", joint "{name}": its axis points to ({shown}) in the '
        f"frame of {description.root_link}; it must point to the left, (0 1 0), for a positive "
        "velocity to drive forward"
    )


def _link_radius(description: Description, name: str, joint: str) -> float:
    link = next(link for link in description.links if link.name == name)
    for geometries in (link.collisions, link.visuals):
        shapes = [geometry.shape for geometry in geometries]
        radii = {shape.radius for shape in shapes if isinstance(shape, Cylinder | Sphere)}
        if len(radii) == 1:
            return radii.pop()
    raise OneBotError(
        f'robot "{description.robot_name}", joint "{joint}": link "{name}" has no sphere or '
        "cylinder to read the wheel's radius from; set wheel_radius (m)"
    )
