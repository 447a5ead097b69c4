"""Cameras: the frustum in the file, and the picture that Rerun draws in it."""

import numpy as np
import pytest
from sensor_msgs.msg import CameraInfo

from tests.onebot_bringup.drive_support import column
from tests.onebot_bringup.test_viewer_image import image
from tests.onebot_bringup.viewer_support import (
    drawn,
    show,
    stamped,
)

ENTITY = "/camera_info/cam/camera_info"
TOPIC = "/cam/camera_info"


def camera(**fields) -> CameraInfo:
    """A camera of 40 x 30 pixels in the frame of the tip, calibrated but for what is given."""
    values = {"width": 40, "height": 30, "k": [50.0, 0, 20, 0, 60, 15, 0, 0, 1]} | fields
    return stamped(CameraInfo(**values))


def matrices(file):
    """The projection of each row, (3, 3)."""
    rows = column(file, ENTITY, "Pinhole:image_from_camera")
    return [np.array(row[0]).reshape(3, 3).T for row in rows if row]


def test_a_camera_is_a_frustum_in_its_frame(tmp_path):
    """Its picture is in the frame that the pinhole makes."""
    file = drawn(
        tmp_path,
        "",
        (TOPIC, camera()),
        ("/cam/image_raw", image("mono8", np.zeros((30, 40), np.uint8))),
    )
    [found] = matrices(file)
    np.testing.assert_allclose(found, [(50, 0, 20), (0, 60, 15), (0, 0, 1)])
    assert column(file, ENTITY, "Pinhole:resolution") == [[[40.0, 30.0]]]
    assert column(file, ENTITY, "Pinhole:parent_frame") == [["tip"]]
    child = column(file, ENTITY, "Pinhole:child_frame")
    assert child == column(file, "/image/cam/image_raw", "CoordinateFrame:frame")
    assert column(file, ENTITY, "Pinhole:image_plane_distance") == [[0.5]]


@pytest.mark.parametrize(
    ("fields", "expected", "size"),
    [
        ({"p": [70.0, 0, 21, 0, 0, 71, 16, 0, 0, 0, 1, 0]}, (70, 71, 21, 16), (40, 30)),
        ({"binning_x": 2, "binning_y": 5}, (25, 12, 10, 3), (20, 6)),
    ],
)
def test_the_projection_is_that_of_the_picture(fields, expected, size, tmp_path):
    """Of the rectified one if it is known, as it is binned."""
    file, _ = show(tmp_path, "", (TOPIC, camera(**fields)))
    [found] = matrices(file)
    np.testing.assert_allclose(found[[0, 1, 0, 1], [0, 1, 2, 2]], expected)
    assert column(file, ENTITY, "Pinhole:resolution") == [[list(size)]]


def test_a_part_of_the_picture(tmp_path):
    """The middle of the projection is where it was on the sensor."""
    message = camera()
    message.roi.x_offset, message.roi.y_offset, message.roi.width, message.roi.height = 5, 3, 10, 8
    file, _ = show(tmp_path, "", (TOPIC, message))
    [found] = matrices(file)
    np.testing.assert_allclose(found[:2, 2], (15, 12))
    assert column(file, ENTITY, "Pinhole:resolution") == [[[10.0, 8.0]]]
