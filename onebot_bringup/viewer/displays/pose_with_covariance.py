"""A pose and how sure it is (geometry_msgs/PoseWithCovarianceStamped).

The covariance is drawn as that of odometry is: an ellipse around the place, on the ground of the
message's frame, and a sector around the heading.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import rerun as rr

from onebot_bringup.viewer.displays.covariance import (
    FILL_ALPHA,
    LARGEST_AXIS,
    ellipse_outline,
    fan,
    heading_deviation,
    place_ellipse,
    sector_outline,
    yaw_only,
)
from onebot_bringup.viewer.displays.message_display import MessageDisplay
from onebot_bringup.viewer.displays.pose import Floats, PoseLook, PosesDrawing, one_pose
from onebot_bringup.viewer.settings import setting
from onebot_description.model.quaternions import rotate

_WIDTH = 1.5  # of the outlines, pixels


@dataclass(frozen=True)
class PoseWithCovarianceLook(PoseLook):
    """A pose as an arrow along x or as axes, with an ellipse and a sector of its covariance."""

    covariance: bool = setting(True, "show it")
    sigma: float = setting(3.0, "how many standard deviations they are wide")
    heading: float = setting(0.5, "radius of the sector, metres; 0 for none")


class PoseWithCovarianceDrawing(PosesDrawing[PoseWithCovarianceLook]):
    """The pose of one topic."""

    repeated = True

    def draw(self, message: Any) -> Sequence[rr.AsComponents]:
        """Return the arrow or the axes, and the outlines of its covariance that are known."""
        poses = one_pose(message.pose.pose)
        outlines = self._outlines(poses[0], message.pose.covariance)
        corners = np.concatenate(outlines) if outlines else np.empty((0, 3))
        color = self.look.color or self.color
        width: Any = [rr.Radius.ui_points(_WIDTH / 2)]
        triangles = [fan() + sum(map(len, outlines[:row])) for row in range(len(outlines))]
        return [
            *self.shapes(poses),
            rr.LineStrips3D(outlines, colors=[color], radii=width),
            rr.Mesh3D(
                vertex_positions=corners,
                triangle_indices=np.concatenate(triangles) if triangles else np.empty((0, 3), int),
                albedo_factor=(*color, FILL_ALPHA),
            ),
        ]

    def _outlines(self, pose: Floats, covariance: Floats) -> list[Floats]:
        if not self.look.covariance:
            return []
        found = []
        sigma, radius = self.look.sigma, self.look.heading
        ellipse, deviation = place_ellipse(covariance), heading_deviation(covariance)
        if ellipse is not None and 0 < sigma * ellipse.along <= LARGEST_AXIS:
            found.append(ellipse_outline(ellipse, sigma) + pose[:3])
        if deviation is not None and sigma * radius > 0:
            turned = rotate(yaw_only(pose[3:]), sector_outline(deviation, sigma, radius))
            found.append(turned + pose[:3])
        return found


class PoseWithCovarianceDisplay(MessageDisplay[PoseWithCovarianceLook]):
    """Draws poses with their covariance, such as that of a localization."""

    key = "pose_with_covariance"
    Look = PoseWithCovarianceLook
    draws = PoseWithCovarianceDrawing
    message_types = ("geometry_msgs/msg/PoseWithCovarianceStamped",)
    live = False
