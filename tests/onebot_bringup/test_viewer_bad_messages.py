"""Messages with faults: whatever they are, the viewer goes on."""

import random

import numpy as np
import pytest
from geometry_msgs.msg import PointStamped, PoseStamped
from rclpy.serialization import serialize_message
from sensor_msgs.msg import PointField

from onebot_description.ros.wire.definition import type_name
from tests.onebot_bringup.drive_support import column
from tests.onebot_bringup.test_viewer_camera_info import camera
from tests.onebot_bringup.test_viewer_image import compressed, image
from tests.onebot_bringup.test_viewer_imu import imu
from tests.onebot_bringup.test_viewer_joint_trajectory import trajectory
from tests.onebot_bringup.test_viewer_laser_scan import points, scan
from tests.onebot_bringup.test_viewer_map import grid
from tests.onebot_bringup.test_viewer_point_cloud2 import cloud, packed, xyz
from tests.onebot_bringup.test_viewer_pose import point, pose
from tests.onebot_bringup.test_viewer_range import echo
from tests.onebot_bringup.viewer_support import (
    START_NS,
    Shown,
    show,
    stamped,
    take,
)

VIEW = """
fixed_frame: base
point_cloud2: {topics: {/doubles: {color_transformer: Intensity, channel_name: x, decay_time: 1.0}}}
"""
MESSAGES = {
    "/scan": scan((1.0, 2.0, 3.0), intensities=[1.0, 2.0, 3.0]),
    "/colors": cloud(packed("x", "y", "z", "rgb"), 2, 4, rgb=[1, 2, 3, 4], **xyz()),
    "/doubles": cloud(packed("x", "y", "z", kind="<f8"), 2, 4, **xyz()),
    "/grey": image("mono16", np.ones((4, 6), np.uint16), 3),
    "/colored": image("rgb8", np.ones((4, 6, 3), np.uint8)),
    "/depth": image("32FC1", np.ones((4, 6), np.float32), big=True),
    "/file": compressed("png", "png"),
    "/cam/camera_info": camera(),
    "/imu": imu(),
    "/sonar": echo(1.0),
    "/arm": trajectory(["slide"], [[0.0], [1.0]]),
}
WORDS = [bytes.fromhex(word) for word in ("ffffffff 00000000 0000c07f 0000807f ffffff7f".split())]
_ROUNDS = 60


def spoilt(data: bytes, chance: random.Random) -> bytes:
    """Return a message with some bytes or words replaced, or without its end."""
    found = bytearray(data)
    for _ in range(chance.choice((1, 1, 2, 4, 8))):
        at = chance.randrange(4, len(found))
        if chance.random() < 0.5:
            found[at] = chance.randrange(256)
        else:
            found[at & ~3 : (at & ~3) + 4] = chance.choice(WORDS)
    return bytes(found[: chance.randrange(len(found))] if chance.random() < 0.1 else found)


def test_faults_in_bytes_are_reported_and_nothing_else(tmp_path):
    """What cannot be read once a message, what cannot be drawn once a topic."""
    chance, shown = random.Random(3), Shown(tmp_path, VIEW)
    view = shown.view
    said = view.offer({topic: type_name(message) for topic, message in MESSAGES.items()})
    for number in range(_ROUNDS):
        for topic, message in MESSAGES.items():
            data = spoilt(bytes(serialize_message(message)), chance)
            view.take(topic, type_name(message), data, START_NS + number)
        said += view.tick(START_NS + number * 10**9)
    take(view, "/scan", scan((1.0, 2.0)))
    shown.end()
    assert shown.bad and {topic for topic, _ in shown.bad} <= set(MESSAGES)
    for topic in MESSAGES:
        assert len([one for one in said if f'"{topic}": ' in one]) <= 1
    assert len(points(tmp_path / "x.rrd")[-1]) == 2
    assert len(column(tmp_path / "x.rrd", "/image/colored", "Image:buffer")) > 10


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
        (rgb(width=HUGE, height=HUGE), "do not fit into 12"),
        (rgb(width=0), "it has no pixels"),
        (image("64FC1", PIXELS), 'encoding "64FC1" is not supported, only rgb8, '),
        (compressed("png", "16UC1; compressedDepth png", b"\0" * 30), '"16UC1; compressedDepth'),
        (
            compressed("png", "jpeg", b""),
            'format "jpeg" is not supported, only jpeg and png',
        ),
        (points_of(width=HUGE, height=HUGE), "do not fit into 56 bytes"),
        (points_of(row_step=23), "23 from row to row"),
        (points_of(point_step=0), 'the field "x" ends at byte 4 of a point, which has 0'),
        (points_of(point_step=HUGE), "do not fit into 56 bytes"),
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
        (imu((NAN, 0, 0, 1)), "is not a quaternion"),
        (imu(acceleration=(NAN, 0, 0)), "its acceleration is not finite"),
        (echo(1.0, view=0.0), "its field of view is "),
        (echo(1.0, view=NAN), "its field of view is "),
        (camera(k=[0.0] * 9), "it is not calibrated"),
        (camera(k=[1e300, 0, 1, 0, 1e300, 1, 0, 0, 1]), "it is not calibrated"),
        (camera(width=0), "its picture has no pixels"),
        (camera(binning_x=41), "its picture has no pixels"),
        (stamped(PoseStamped(pose=pose(NAN))), "not finite"),
        (stamped(PoseStamped(pose=pose(0, 0, (0.0, INF, 0.0, 0.0)))), "not finite"),
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
