"""Point clouds: the points and colors in the file, whatever the layout of their bytes."""

import numpy as np
import pytest
from sensor_msgs.msg import PointCloud2, PointField

from tests.onebot_bringup.test_viewer_laser_scan import colors, points
from tests.onebot_bringup.viewer_support import show, stamped

ENTITY = "/point_cloud2/cloud"
RED, MAGENTA = 0xFF0000FF, 0xFF00FFFF
DATATYPES = {"i1": 1, "u1": 2, "i2": 3, "u2": 4, "i4": 5, "u4": 6, "f4": 7, "f8": 8}
XYZ = np.array([(1, 2, 3), (4, 5, 6), (-1, -2, -3), (0, 0, 0)], float)
IN_BASE = XYZ + (0.0, 0.5, 0.0)  # the frame "tip" of the clouds is there


def cloud(dtype, height=1, padding=0, frame="tip", **columns) -> PointCloud2:
    """A cloud of structs of ``dtype``, with so many bytes after each of its rows."""
    values = np.zeros(len(next(iter(columns.values()))), dtype)
    for name, column_of_it in columns.items():
        values[name] = column_of_it
    rows = values.view(np.uint8).reshape(height, -1)
    data = np.pad(rows, ((0, 0), (0, padding)), constant_values=0xFF)
    message = PointCloud2(
        height=height,
        width=len(values) // height,
        point_step=values.itemsize,
        row_step=data.shape[1],
        is_bigendian=dtype[dtype.names[0]].str[0] == ">",
        data=data.tobytes(),
    )
    stamped(message, frame=frame)
    for name, (kind, offset, *_) in dtype.fields.items():
        field = PointField(name=name, offset=offset, datatype=DATATYPES[kind.str[1:]], count=1)
        message.fields.append(field)
    return message


def packed(*names, kind="<f4", gap=0):
    """Structs of fields of one type, with ``gap`` bytes after each."""
    size = np.dtype(kind).itemsize
    offsets = [number * (size + gap) for number in range(len(names))]
    step = len(names) * (size + gap)
    formats = [kind] * len(names)
    return np.dtype(
        {"names": names, "formats": formats, "offsets": offsets, "itemsize": max(step, 1)}
    )


def xyz(values=XYZ):
    """The columns of positions."""
    return dict(zip("xyz", values.T, strict=True))


def shown(tmp_path, view, *messages):
    """Show clouds; return points and colors of each, and the warnings."""
    file, said = show(tmp_path, view, *(("/cloud", message) for message in messages))
    return points(file, ENTITY), colors(file, ENTITY), said


@pytest.mark.parametrize(
    ("kind", "gap", "height", "padding"),
    [
        *[("<f4", 0, 1, 0), ("<f8", 3, 1, 0), (">f4", 0, 2, 0), (">f8", 3, 2, 0)],
        *[("<i2", 0, 2, 5), (">i4", 3, 2, 5), ("<f4", 3, 2, 5), ("<f8", 0, 2, 0)],
    ],
)
def test_points_of_any_layout(kind, gap, height, padding, tmp_path):
    """Types, either byte order, gaps between fields, in rows with bytes after each."""
    message = cloud(packed("x", "y", "z", kind=kind, gap=gap), height, padding, **xyz())
    [found], _, said = shown(tmp_path, "", message)
    assert said == []
    np.testing.assert_array_equal(found, IN_BASE)


def test_points_that_are_not_finite_are_left_out(tmp_path):
    """With their colors."""
    values = np.vstack([XYZ, (np.nan, 0, 0), (0, np.inf, 0), (0, 0, -3.2e38), (7, 8, 9)])
    kind = packed("x", "y", "z", "intensity")
    message = cloud(kind, **xyz(values), intensity=[0, 1, 1, 1, 99, 99, 99, 2])
    [found], [rgba], said = shown(tmp_path, "", message)
    np.testing.assert_array_equal(found, [*IN_BASE, (7, 8.5, 9)])
    assert (len(rgba), rgba[0], rgba[-1], said) == (5, RED, MAGENTA, [])


RGB = [0xFF112233, 0x00000000, 0x80FFFFFF, 0x01ABCDEF]


@pytest.mark.parametrize(("order", "kind"), [("<", "f4"), (">", "u4")])
@pytest.mark.parametrize(
    ("field", "expected"),
    [
        ("rgb", [0x112233FF, 0x000000FF, 0xFFFFFFFF, 0xABCDEFFF]),
        ("rgba", [0x112233FF, 0x00000000, 0xFFFFFF80, 0xABCDEF01]),
    ],
)
def test_colors_of_the_points_own(order, field, expected, kind, tmp_path):
    """A float32 holds the bytes of the color."""
    names = ("x", "y", "z", field, "intensity")
    formats = [order + "f4"] * 3 + [order + kind, order + "f4"]
    values = np.array(RGB, order + "u4").view(order + kind)
    message = cloud(
        np.dtype({"names": names, "formats": formats}),
        **xyz(),
        **{field: values},
        intensity=XYZ[0, 0],
    )
    _, [found], _ = shown(tmp_path, "", message)
    assert found == expected


@pytest.mark.parametrize("kind", ["<u1", "<i1", "<u2", ">u2", "<i4", "<u4", "<f4", ">f8"])
def test_any_field_as_color(kind, tmp_path):
    """Of the type that it has; the lowest is red, the highest magenta."""
    fields = {"names": ("x", "y", "z", "ring"), "formats": ["<f4"] * 3 + [kind]}
    message = cloud(np.dtype(fields), **xyz(), ring=[3, 7, 3, 5])
    message.is_bigendian = False
    if kind[0] == ">":
        message = cloud(packed("x", "y", "z", "ring", kind=kind), **xyz(), ring=[3, 7, 3, 5])
    view = "point_cloud2: {color_transformer: Intensity, channel_name: ring}"
    _, [found], _ = shown(tmp_path, view, message)
    assert found == [RED, MAGENTA, RED, found[3]]
    assert found[3] not in (RED, MAGENTA)


def test_a_cloud_without_colors_is_colored_by_height(tmp_path):
    """Of the fixed frame; also one whose intensities are all the same."""
    bare = cloud(packed("x", "y", "z"), **xyz())
    same = cloud(packed("x", "y", "z", "intensity"), **xyz(), intensity=[4.0] * 4)
    _, found, _ = shown(tmp_path, "", bare, same)
    assert found[0] == found[1]
    assert (found[0][2], found[0][1]) == (RED, MAGENTA)
    bounds = "autocompute_value_bounds: false, min_value: 0.0, max_value: 1.0, axis: Y"
    _, [found], _ = shown(tmp_path, f"{{fixed_frame: base, point_cloud2: {{{bounds}}}}}", bare)
    # In base they are 0.5 m further along y: from 0 on, the middle is 0.5.
    assert found[:3] == [MAGENTA, MAGENTA, RED] and found[3] not in (RED, MAGENTA)


def test_values_that_are_not_finite_have_a_color(tmp_path):
    """And do not spoil those of the others."""
    kind = packed("x", "y", "z", "intensity")
    message = cloud(kind, **xyz(), intensity=[0.0, np.nan, np.inf, 1.0])
    nothing = cloud(kind, **xyz(), intensity=[np.nan] * 4)
    _, (found, _), said = shown(tmp_path, "", message, nothing)
    assert (found[0], found[3], said) == (RED, MAGENTA, [])


def test_an_empty_cloud_clears_the_points(tmp_path):
    """Whatever its steps are."""
    full, empty = (cloud(packed("x", "y", "z"), 2, 4, **xyz()) for _ in range(2))
    empty.width, empty.data = 0, b""
    found, _, said = shown(tmp_path, "", full, empty)
    assert ([len(each) for each in found], said) == ([4, 0], [])
