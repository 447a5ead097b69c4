"""Cameras (sensor_msgs/CameraInfo): the frustum of what each sees, with its picture in it.

The picture comes from a topic beside CameraInfo's, such as /camera/image_raw beside
/camera/camera_info, as ROS drivers name them.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import rerun as rr

from onebot_bringup.viewer.core.display import LayoutPart
from onebot_bringup.viewer.core.drawing import (
    Drawing,
    TopicSettings,
    topic_entity,
)
from onebot_bringup.viewer.core.rerun_limits import SELDOM, is_drawable
from onebot_bringup.viewer.core.settings import Color, color, setting
from onebot_bringup.viewer.displays.image import picture_frame

# Names of the picture topics beside a CameraInfo.
_NAMES = ("image", "image_raw", "image_color", "image_mono", "image_rect", "image_rect_color")


@dataclass(frozen=True)
class CameraInfoSettings(TopicSettings):
    """Frustums of cameras."""

    far_clip: float = setting(0.5, "distance of the picture, meters")
    color: Color | None = setting(None, "sRGB bytes; empty: automatic", color)


class CameraInfoDrawing(Drawing[CameraInfoSettings]):
    """The frustum of one camera."""

    key = "camera_info"
    message_types = ("sensor_msgs/msg/CameraInfo",)
    period_ns = SELDOM
    newest_only = True
    _drawn = False

    def layout(self) -> LayoutPart:
        """Return the pictures shown in the frustum, once there is a frustum."""
        space = self.name.rpartition("/")[0]
        pictures = [topic_entity("image", f"{space}/{name}") for name in _NAMES]
        return LayoutPart(shown=tuple(pictures) if self._drawn else ())

    def style(self) -> Sequence[rr.AsComponents]:
        far_clip = self.settings.far_clip
        return [rr.Pinhole.from_fields(image_plane_distance=far_clip, color=self.color)]

    def draw(self, message: Any) -> Sequence[rr.AsComponents]:
        """Return the projection of the rectified picture."""
        matrix, resolution = _projection(message)
        self._drawn = True
        return [
            rr.Pinhole.from_fields(
                image_from_camera=matrix,
                resolution=resolution,
                camera_xyz=rr.ViewCoordinates.RDF,
                parent_frame=self.frame,
                child_frame=picture_frame(self.name),
            )
        ]


def _projection(message: Any) -> tuple[np.ndarray, tuple[int, int]]:
    """Return the (3, 3) camera matrix and the picture's size, after binning and cropping."""
    is_rectified = bool(message.p[0])
    matrix = message.p.reshape(3, 4)[:, :3] if is_rectified else message.k.reshape(3, 3)
    matrix = matrix.astype(float)  # a copy
    if not (matrix[0, 0] and matrix[1, 1] and is_drawable(matrix)):
        raise ValueError("it is not calibrated: neither k nor p has focal lengths")
    roi = message.roi
    size = np.array([roi.width or message.width, roi.height or message.height], float)
    binning = np.maximum([message.binning_x, message.binning_y], 1)
    matrix[:2, 2] -= roi.x_offset, roi.y_offset
    matrix[:2] /= binning[:, None]
    width, height = (size // binning).astype(int).tolist()
    if not width * height:
        raise ValueError("its picture has no pixels")
    return matrix, (width, height)
