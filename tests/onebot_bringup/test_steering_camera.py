"""The steering page's picture of a camera."""

import io

import numpy as np
import pytest
from PIL import Image
from sensor_msgs.msg import Image as ImageMessage

from onebot_bringup.steering.camera import jpeg


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
