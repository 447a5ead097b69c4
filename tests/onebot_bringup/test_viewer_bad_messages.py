"""Messages with faults in their bytes: whatever they become, the viewer goes on."""

import random

import numpy as np
from rclpy.serialization import serialize_message

from tests.onebot_bringup.drive_support import column
from tests.onebot_bringup.test_viewer_camera_info import camera
from tests.onebot_bringup.test_viewer_image import compressed, image
from tests.onebot_bringup.test_viewer_imu import imu
from tests.onebot_bringup.test_viewer_laser_scan import points, scan
from tests.onebot_bringup.test_viewer_point_cloud2 import cloud, packed, xyz
from tests.onebot_bringup.test_viewer_range import echo
from tests.onebot_bringup.viewer_support import (
    START_NS,
    Shown,
    take,
    type_name,
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
