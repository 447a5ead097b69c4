"""Messages with faults: whatever they are, the viewer goes on."""

import numpy as np
import pytest
from geometry_msgs.msg import PointStamped, PoseStamped
from sensor_msgs.msg import PointField

from tests.onebot_bringup.drive_support import column
from tests.onebot_bringup.test_viewer_camera_info import camera
from tests.onebot_bringup.test_viewer_image import compressed, image
from tests.onebot_bringup.test_viewer_imu import imu
from tests.onebot_bringup.test_viewer_laser_scan import scan
from tests.onebot_bringup.test_viewer_map import grid
from tests.onebot_bringup.test_viewer_point_cloud2 import cloud, packed, xyz
from tests.onebot_bringup.test_viewer_pose import point, pose
from tests.onebot_bringup.test_viewer_range import echo
from tests.onebot_bringup.viewer_support import (
    show,
    stamped,
)

INF, NAN = float("inf"), float("nan")
PIXELS = np.zeros((2, 2, 3), np.uint8)
HUGE = 2**32 - 1


def rgb(**changes):
    """A picture with other fields."""
    return changed(image("rgb8", PIXELS), changes)


def points_of(**changes):
    """A cloud with other fields."""
    return changed(cloud(packed("x", "y", "z"), 2, 4, **xyz()), changes)


def cells(**changes):
    """A map with another head."""
    message = grid([[0, 0]])
    changed(message.info, changes)
    return message


def changed(message, changes):
    """The message with other fields."""
    for name, value in changes.items():
        setattr(message, name, value)
    return message


@pytest.mark.parametrize(
    ("message", "reported"),
    [
        (scan((1.0,), intensities=[1.0, 2.0]), "1 ranges, but 2 intensities"),
        (rgb(step=5), "5 from row to row (step), do not fit into 12"),
        (rgb(width=0), "it has no pixels"),
        (image("64FC1", PIXELS), 'encoding "64FC1" is not supported, only rgb8, '),
        (
            compressed("png", "jpeg", b""),
            'format "jpeg" is not supported, only jpeg and png',
        ),
        (points_of(width=HUGE, height=HUGE), "do not fit into 56 bytes"),
        (points_of(row_step=23), "23 from row to row"),
        (points_of(point_step=0), 'the field "x" ends at byte 4 of a point, which has 0'),
        (points_of(fields=[]), "no fields x, y and z that can be read, but none"),
        (points_of(fields=[PointField(name=name, datatype=9) for name in "xyz"]), "but x, y, z"),
        (
            points_of(fields=[PointField(name=n, offset=HUGE, datatype=8) for n in "xyz"]),
            '"x" ends',
        ),
        (cells(width=2**31, height=2**31), "array of size 2"),
        (cells(resolution=0.0), "resolution is 0 m"),
        (grid([[0]], x=INF), "its origin [inf, 0.0,"),
        (imu((0, 0, 0, 0)), "its orientation [0.0, 0.0, 0.0, 0.0] is not a quaternion"),
        (imu(acceleration=(NAN, 0, 0)), "its acceleration is not finite"),
        (echo(1.0, view=NAN), "its field of view is "),
        (camera(k=[1e300, 0, 1, 0, 1e300, 1, 0, 0, 1]), "it is not calibrated"),
        (camera(binning_x=41), "its picture has no pixels"),
        (stamped(PoseStamped(pose=pose(NAN))), "not finite"),
        (stamped(point(INF)), "not finite"),
    ],
)
def test_what_cannot_be_drawn_is_reported_once(message, reported, tmp_path):
    """And costs nothing of the next message."""
    good = {
        "LaserScan": ("laser scan", "Points3D:positions", scan()),
        "Image": ("image", "Image:buffer", rgb()),
        "CompressedImage": ("image", "EncodedImage:blob", compressed("png", "png")),
        "PointCloud2": ("point cloud2", "Points3D:positions", points_of()),
        "OccupancyGrid": ("map", "GridMap:data", cells()),
        "Imu": ("imu", "Arrows3D:vectors", imu()),
        "Range": ("range", "Mesh3D:vertex_positions", echo(1.0)),
        "CameraInfo": ("camera info", "Pinhole:image_from_camera", camera()),
        "PoseStamped": ("pose", "Arrows3D:vectors", stamped(PoseStamped())),
        "PointStamped": ("point stamped", "Points3D:positions", stamped(PointStamped())),
    }
    display, component, usable = good[type(message).__name__]
    file, [warning] = show(tmp_path, "", *[("/t", each) for each in (message, message, usable)])
    assert warning.startswith(f'{display} "/t": ') and reported in warning
    assert len(column(file, f"/{display.replace(' ', '_')}/t", component)) == 1
