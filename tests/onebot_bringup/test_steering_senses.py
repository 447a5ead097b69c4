"""The steering page's picture of a camera, and what a scan sees in the robot's way."""

import io
import math

import numpy as np
import pytest
from PIL import Image
from sensor_msgs.msg import Image as ImageMessage
from sensor_msgs.msg import LaserScan

from onebot_bringup.steering.senses import Footprint, jpeg

ROBOT = """<robot name="box">
  <link name="base"><visual><geometry><box size="0.4 0.2 0.1"/></geometry></visual></link>
  <link name="lidar"/>
  <joint name="mount" type="fixed"><parent link="base"/><child link="lidar"/>
    <origin xyz="0.1 0 0.1" rpy="0 0 3.141592653589793"/></joint>
</robot>"""


@pytest.mark.parametrize(
    ("point", "linear", "angular", "clearance"),
    [
        ((1.0, 0.05), 0.3, 0.0, 0.8),
        ((1.0, 0.05), -0.3, 0.0, math.inf),  # it goes the other way
        ((-1.0, 0.05), -0.3, 0.0, 0.8),
        ((1.0, 0.15), 0.3, 0.0, math.inf),  # it passes
        ((1.0, 1.0), 0.5, 0.5, math.pi / 2 - 0.2),  # a quarter of a circle of 1 m
        ((1.0, -1.0), 0.5, -0.5, math.pi / 2 - 0.2),
        ((1.0, 0.05), 0.5, 0.5, math.inf),  # it turns away
        ((0.1, 0.0), 0.3, 0.0, math.inf),  # a part of itself
    ],
)
def test_how_far_the_robot_can_go(point, linear, angular, clearance):
    """Of a scanner that looks backwards, in a frame with a prefix."""
    footprint = Footprint.of(ROBOT)
    seen = 0.1 - point[0], -point[1]  # by the scanner
    scan = LaserScan(
        angle_min=math.atan2(*reversed(seen)), angle_increment=3.0, range_min=0.0, range_max=9.0,
        ranges=[math.hypot(*seen), math.inf, math.nan],
    )  # fmt: skip
    scan.header.frame_id = "robot1/lidar"
    found = footprint.clearance(footprint.points(scan), linear, angular)
    assert found == pytest.approx(clearance, abs=1e-5)
    scan.header.frame_id = "unknown"
    assert not len(footprint.points(scan))
    assert (
        Footprint.of("<robot") is None
        and Footprint.of('<robot name="x"><link name="a"/></robot>') is None
    )


@pytest.mark.parametrize("encoding", ["rgb8", "bgr8", "rgba8", "bgra8", "mono8"])
def test_a_picture_becomes_a_small_jpeg(encoding):
    """Of each encoding for people, with padding; depth and broken ones become none."""
    color = (40, 40, 40) if encoding == "mono8" else (200, 100, 40)
    pixel = {"r": color, "b": color[::-1], "m": color[:1]}[encoding[0]] + (255,) * ("a" in encoding)
    rows = np.zeros((600, 800 * len(pixel) + 7), np.uint8)
    rows[:, :-7] = np.tile(pixel, 800)
    message = ImageMessage(
        encoding=encoding, width=800, height=600, step=rows.shape[1], data=rows.tobytes()
    )
    picture = Image.open(io.BytesIO(jpeg(message)))
    assert (picture.format, picture.size) == ("JPEG", (480, 360))
    assert picture.convert("RGB").getpixel((470, 200)) == pytest.approx(color, abs=4)
    message.data = message.data[:-8]
    assert jpeg(message) is None
    message.encoding = "32FC1"
    assert jpeg(message) is None
