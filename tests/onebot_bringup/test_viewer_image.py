"""Pictures: the bytes and formats in the file, and that none is copied."""

import io

import numpy as np
import pytest
import rerun.blueprint as rrb
from PIL import Image as Pillow
from sensor_msgs.msg import CompressedImage, Image

from onebot_bringup.viewer.blueprint import Layout, make_blueprint
from onebot_bringup.viewer.core.display import LayoutPart
from onebot_bringup.viewer.displays.image import ImageView
from onebot_bringup.viewer.view_config import ViewConfig
from tests.onebot_bringup.drive_support import column
from tests.onebot_bringup.viewer_support import START_NS, drawn, show, stamped

ENTITY = "/image/cam/image_raw"
TOPIC = "/cam/image_raw"
L, RGB, RGBA, BGR, BGRA = range(1, 6)
U8, U16, F32 = 6, 8, 34
RNG = np.random.default_rng(1)


def image(encoding, pixels, padding=0, *, big=False) -> Image:
    """A picture of (height, width, ...) numbers, with so many bytes after each row."""
    rows, width = pixels.shape[:2]
    pixels = pixels.astype(pixels.dtype.newbyteorder(">")) if big else pixels
    lines = np.frombuffer(pixels.tobytes(), np.uint8).reshape(rows, -1)
    data = np.pad(lines, ((0, 0), (0, padding)), constant_values=0xEE)
    message = Image(height=rows, width=width, encoding=encoding, step=data.shape[1])
    message.is_bigendian, message.data = int(big), data.tobytes()
    return stamped(message, frame="nowhere")


def random(*shape, dtype=np.uint8):
    """Numbers of any size."""
    return RNG.integers(0, 250, shape).astype(dtype)


@pytest.mark.parametrize(
    ("encoding", "channels", "model", "padding"),
    [
        *[("rgb8", 3, RGB, 0), ("rgb8", 3, RGB, 5), ("bgr8", 3, BGR, 0), ("8UC3", 3, BGR, 5)],
        *[("rgba8", 4, RGBA, 0), ("bgra8", 4, BGRA, 5), ("8UC4", 4, BGRA, 0)],
        *[("mono8", 1, L, 0), ("8UC1", 1, L, 5)],
        *[("bayer_rggb8", 1, 128, 0), ("bayer_bggr8", 1, 129, 0), ("bayer_gbrg8", 1, 130, 5)],
        *[("bayer_grbg8", 1, 131, 0), ("yuv422_yuy2", 2, 27, 0)],
    ],
)
def test_colors_are_logged_as_they_come(encoding, channels, model, padding, tmp_path):
    """Without what lies between rows; also where no transform leads to the frame.

    Rerun makes colors of the formats of cameras, which have numbers of their own.
    """
    pixels = random(4, 6, channels)
    file = drawn(tmp_path, "", (TOPIC, image(encoding, pixels, padding)))
    assert column(file, ENTITY, "Image:buffer") == [[pixels.ravel().tolist()]]
    [[found]] = column(file, ENTITY, "Image:format")
    assert (found["width"], found["height"]) == (6, 4)
    if found["pixel_format"] is None:
        assert (found["color_model"], found["channel_datatype"]) == (model, U8)
    else:
        assert found["pixel_format"] == model > BGRA
    [time] = np.array(column(file, ENTITY, "ros_time"), "datetime64[ns]").astype(np.int64)
    assert time == START_NS


def test_uyvy_is_yuy2_with_its_bytes_swapped(tmp_path):
    """The only one that Rerun has."""
    pixels = random(2, 4, 2)
    file, _ = show(tmp_path, "", (TOPIC, image("yuv422", pixels)))
    assert column(file, ENTITY, "Image:buffer") == [[pixels[..., ::-1].ravel().tolist()]]


@pytest.mark.parametrize(("big", "padding"), [(False, 0), (True, 6)])
@pytest.mark.parametrize(
    ("encoding", "dtype", "datatype", "meter"),
    [("16UC1", np.uint16, U16, 1000.0), ("32FC1", np.float32, F32, 1.0)],
)
def test_depth_is_in_meters(encoding, dtype, datatype, meter, big, padding, tmp_path):
    """REP-118: integers are millimeters; either byte order."""
    pixels = random(3, 5, dtype=dtype) * dtype(7)
    view = "image: {normalize_range: false, min_value: 1.0, max_value: 5.0}"
    file = drawn(tmp_path, view, (TOPIC, image(encoding, pixels, padding, big=big)))
    [[found]] = column(file, ENTITY, "DepthImage:buffer")
    np.testing.assert_array_equal(np.array(found, np.uint8).view(dtype), pixels.ravel())
    [[found]] = column(file, ENTITY, "DepthImage:format")
    assert (found["width"], found["height"], found["channel_datatype"]) == (5, 3, datatype)
    assert column(file, ENTITY, "DepthImage:meter") == [[meter]]
    assert column(file, ENTITY, "DepthImage:depth_range") == [[[1.0, 5.0]]]


@pytest.mark.parametrize("big", [False, True])
@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        ("{visible: true}", [0, 127, 255]),
        ("{normalize_range: false, max_value: 2000}", [127, 255, 255]),
    ],
)
def test_grey_of_16_bits_is_scaled_as_in_rviz(settings, expected, big, tmp_path):
    """From the least to the greatest value, or by the bounds of the settings."""
    pixels = np.array([[1000, 2000, 3000]], np.uint16)
    file, _ = show(tmp_path, f"image: {settings}", (TOPIC, image("mono16", pixels, big=big)))
    assert column(file, ENTITY, "Image:buffer") == [[expected]]


def compressed(kind, form, data=None) -> CompressedImage:
    """A picture in a file's format."""
    file = io.BytesIO()
    Pillow.fromarray(random(4, 6, 3)).save(file, kind)
    return stamped(CompressedImage(format=form, data=file.getvalue() if data is None else data))


@pytest.mark.parametrize(
    ("kind", "form", "media_type"),
    [
        ("jpeg", "jpeg", "image/jpeg"),
        ("jpeg", "rgb8; jpeg compressed bgr8", "image/jpeg"),
        ("png", "bgr8; png compressed bgr8", "image/png"),
        ("png", "", "image/png"),
    ],
)
def test_files_are_logged_as_they_come(kind, form, media_type, tmp_path):
    """What they are is in their first bytes."""
    message = compressed(kind, form)
    file = drawn(tmp_path, "", ("/cam/image_raw/compressed", message))
    entity = f"{ENTITY}/compressed"
    assert column(file, entity, "EncodedImage:blob") == [[list(message.data)]]
    assert column(file, entity, "EncodedImage:media_type") == [[media_type]]


def _layout(*parts):
    view = ViewConfig()
    settings = view.grid, view.background, view.camera, view.panels
    return Layout(*settings, parts, "base", complete=True, robots=())


@pytest.mark.parametrize(("count", "kind", "shares"), [(4, rrb.Vertical, 1), (5, rrb.Grid, 2)])
def test_many_pictures_are_in_two_columns(count, kind, shares):
    """So that each is still seen."""
    views = tuple(ImageView(f"image/{number}", f"/{number}") for number in range(count))
    root = make_blueprint(_layout(LayoutPart(views=views))).root_container
    assert isinstance(root.contents[1], kind) and list(root.column_shares) == [3, shares]
    assert len(root.contents[1].contents) == count
