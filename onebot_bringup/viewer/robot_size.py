"""Measures a robot: the box around its shapes, and the camera and axes that fit it."""

from collections.abc import Mapping

import numpy as np

from onebot_bringup.viewer.core.robot_shapes import marker_size
from onebot_description.arrays import Floats
from onebot_description.elements.urdf import Description, Geometry, Link
from onebot_description.errors import OneBotError
from onebot_description.geometry import matrices
from onebot_description.geometry.poses import Triple
from onebot_description.model.robot_model import RobotModel


def corners(geometry: Geometry) -> Floats:
    """Return the (8, 3) corners of the box around ``geometry``, meters, in its link's frame."""
    import trimesh  # slow to import

    from onebot_bringup.viewer.core.glb import load_shape

    local = trimesh.bounds.corners(load_shape(geometry.shape).bounds)
    return matrices.transformed(local, matrices.of_origin(geometry.origin))


def robot_bounds(description: Description, poses: Mapping[str, Floats]) -> Floats | None:
    """Return the (2, 3) box around all visuals, meters, in the fixed frame.

    Args:
        description: the robot.
        poses: (4, 4) matrices of the links in the fixed frame; links not in it are left out.
    """
    clouds = []
    marker = marker_size(description)
    for link in description.links:
        if link.name in poses and (cloud := link_corners(link, marker)) is not None:
            clouds.append(matrices.transformed(cloud, poses[link.name]))
    return box_around(np.concatenate(clouds)) if clouds else None


def link_corners(link: Link, marker: float) -> Floats | None:
    """Return the corners (N, 3) of the boxes around the visuals, meters; None without any.

    Args:
        link: the link.
        marker: edge of the box that replaces a visual that cannot be drawn, m.
    """
    clouds = []
    for geometry in link.visuals:
        try:
            clouds.append(corners(geometry))
        except OneBotError:  # was reported when the visual was drawn
            clouds.append(geometry.origin.xyz + marker * np.array([[-0.5] * 3, [0.5] * 3]))
    return np.concatenate(clouds) if clouds else None


def box_around(points: Floats) -> Floats:
    """Return the (2, 3) minimum and maximum coordinates of points (N, 3)."""
    return np.array([points.min(axis=0), points.max(axis=0)])


def diagonal(bounds: Floats) -> float:
    """Return the diagonal of a (2, 3) box, meters."""
    return float(np.linalg.norm(bounds[1] - bounds[0]))


def robot_size(description: Description) -> float:
    """Return the diagonal of the box around a robot whose joints are at 0, meters.

    It is 0 without shapes, and if the links are not one tree: then only TF knows their poses.
    """
    try:
        model = RobotModel.from_description(description)
    except OneBotError:
        return 0.0
    bounds = posed_bounds(description, model, np.zeros(len(model.joints)))
    return 0.0 if bounds is None else diagonal(bounds)


def posed_bounds(description: Description, model: RobotModel, positions: Floats) -> Floats | None:
    """Return the (2, 3) box around a robot, meters, in its root link's frame; None without shapes.

    Args:
        description: the robot.
        model: its kinematics.
        positions: (M,) joint positions, rad or m.
    """
    return robot_bounds(description, model.link_matrices(positions))


def fitting_eye(bounds: Floats, quarters: int = 0) -> tuple[Triple, Triple]:
    """Return eye and target, meters, that show the whole (2, 3) box from the front left, above.

    Args:
        bounds: the box.
        quarters: quarter turns to the left, to look from another side.
    """
    center = bounds.mean(axis=0)
    radius = max(diagonal(bounds) / 2, 0.01)
    direction = np.array([1.0, 0.75, 0.65])
    for _ in range(quarters):
        direction = np.array([-direction[1], direction[0], direction[2]])
    # The factor fits a field of view of about 55 degrees, with some space around the robot.
    eye = center + direction / np.linalg.norm(direction) * radius * 2.6
    return _vector(eye), _vector(center)


def _vector(values: Floats) -> Triple:
    x, y, z = (round(float(value), 4) for value in values)
    return x, y, z


_SHORTEST = 0.05  # share of the robot's size, so that the axes of a hundred links are visible, too
_OF_LINK = 0.75  # share of a link's size that its axes have


def fitting_length(size: float, links: int) -> float:
    """Return a suitable length of axes for a robot of ``size`` (its diagonal), both in meters.

    The axes are long enough to stick out of a few big links, short enough for many small ones.
    """
    return round(size * max(0.55 / links**0.7, _SHORTEST), 3) if links else 0.0


def axes_lengths(robot: Description) -> dict[str, float]:
    """Return the longest axes, meters, that do not hide a link, by link name.

    They are in proportion to the link's visuals; a link without any has its parent's length.
    """
    parents = {joint.child: joint.parent for joint in robot.joints}
    marker = marker_size(robot)
    lengths = {}
    for link in robot.links:
        cloud = link_corners(link, marker)
        if cloud is not None:
            lengths[link.name] = round(_OF_LINK * float(np.linalg.norm(np.ptp(cloud, axis=0))), 3)
    for name in robot.link_names:
        way = []
        while name not in lengths and name in parents:
            way.append(name)
            name = parents[name]
        if name in lengths:
            lengths.update(dict.fromkeys(way, lengths[name]))
    return lengths
