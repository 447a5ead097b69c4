"""Converts sensor_msgs/PointCloud2 messages to structured numpy arrays, and back.

The array of ``read_points`` is a view of the message, so nothing is copied.
"""

import array
import sys
from collections import namedtuple
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.lib.recfunctions import structured_to_unstructured
from numpy.typing import NDArray
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Header

DUMMY_FIELD_PREFIX = "unnamed_field"

# Constants of PointField, from INT8 to FLOAT64.
_DATATYPES: dict[int, np.dtype[Any]] = dict(enumerate(map(np.dtype, "bBhHiIfd"), 1))
_IS_LITTLE = sys.byteorder == "little"


def read_points(
    cloud, field_names=None, skip_nans=False, uvs=None, reshape_organized_cloud=False
) -> NDArray[Any]:
    """Return the points of a cloud as a structured array, with a name for each field.

    Args:
        cloud: the message.
        field_names: the fields to read; all by default.
        skip_nans: leave out points with a NaN in these fields, if the cloud is not dense.
        uvs: the numbers of the points to return.
        reshape_organized_cloud: return an array (width, height) if there are several rows.
    """
    assert isinstance(cloud, PointCloud2), "Cloud is not a sensor_msgs.msg.PointCloud2"
    dtype = dtype_from_fields(cloud.fields, cloud.point_step)
    points: NDArray[Any] = np.ndarray(cloud.width * cloud.height, dtype, cloud.data)
    if field_names is not None:
        assert set(field_names) <= set(points.dtype.names or ()), (
            "Requests field is not in the fields of the PointCloud!"
        )
        points = points[list(field_names)]
    if cloud.is_bigendian == _IS_LITTLE:
        points = points.byteswap()
    if skip_nans and not cloud.is_dense:
        is_nan = [np.isnan(points[name]) for name in points.dtype.names or ()]
        points = points[~np.logical_or.reduce(is_nan)]
    if uvs is not None:
        points = points[uvs if isinstance(uvs, np.ndarray) else np.fromiter(uvs, int)]
    if reshape_organized_cloud and cloud.height > 1:
        points = points.reshape(cloud.width, cloud.height)
    return points


def read_points_numpy(
    cloud, field_names=None, skip_nans=False, uvs=None, reshape_organized_cloud=False
) -> NDArray[Any]:
    """Return fields of one type as an array with a column each; see ``read_points``."""
    points = read_points(cloud, field_names, skip_nans, uvs, reshape_organized_cloud)
    types = {points.dtype[name] for name in points.dtype.names or ()}
    assert len(types) <= 1, (
        "All fields need to have the same datatype. Use `read_points()` otherwise."
    )
    return structured_to_unstructured(points)


def read_points_list(cloud, field_names=None, skip_nans=False, uvs=None) -> list[Any]:
    """Return the points as a list of named tuples; see ``read_points``, which is much faster."""
    points = read_points(cloud, field_names, skip_nans, uvs)
    point = namedtuple("Point", points.dtype.names or ())  # type: ignore[misc] # noqa: PYI024
    return [point._make(values) for values in points]


def dtype_from_fields(fields: Iterable[PointField], point_step: int | None = None) -> np.dtype[Any]:
    """Return the type of a point of ``point_step`` bytes, by default the size of its fields.

    A field of several numbers becomes several fields, with the suffixes _0, _1, ...
    """
    names: list[str] = []
    formats: list[str] = []
    offsets: list[int] = []
    for index, field in enumerate(fields):
        datatype = _DATATYPES[field.datatype]
        name = field.name or f"{DUMMY_FIELD_PREFIX}_{index}"
        assert field.count > 0, "Can't process fields with count = 0."
        for part in range(field.count):
            names.append(f"{name}_{part}" if field.count > 1 else name)
            offsets.append(field.offset + part * datatype.itemsize)
            formats.append(datatype.str)
    assert len(names) == len(set(names)), "Duplicate field names are not allowed!"
    layout: Any = {"names": names, "formats": formats, "offsets": offsets}
    if point_step is not None:
        layout["itemsize"] = point_step
    dtype: np.dtype[Any] = np.dtype(layout)
    return dtype


def create_cloud(header, fields, points, point_step=None) -> PointCloud2:
    """Return a cloud of points.

    Args:
        header: its header.
        fields: its fields.
        points: a structured array of these fields, an array with a column for each, or one sequence
            of numbers for each point. Two dimensions of points are width and height.
        point_step: bytes from one point to the next; by default the size of the fields.
    """
    dtype = dtype_from_fields(fields, point_step)
    if not isinstance(points, np.ndarray):
        values = list(map(tuple, points))
        points = np.zeros(len(values), dtype)  # padding of arbitrary bytes would differ each time
        points[:] = values
    elif points.dtype.names is None:
        assert len({field.datatype for field in fields}) <= 1, (
            "All fields need to have the same datatype. Pass a structured NumPy array with "
            "multiple dtypes otherwise."
        )
        columns, points = np.moveaxis(points, -1, 0), np.zeros(points.shape[:-1], dtype)
        for name, column in zip(dtype.names or (), columns, strict=True):
            points[name] = column
    assert points.dtype == dtype, (
        "PointFields and structured NumPy array dtype do not match for all fields! Check their "
        "field order, names and types."
    )
    assert points.ndim <= 2, (
        "Too many dimensions for organized cloud! Points can only be organized in max. two "
        "dimensional space"
    )
    width, height = (*points.shape, 1)[:2]
    cloud = PointCloud2(
        header=header,
        height=height,
        width=width,
        is_dense=False,
        is_bigendian=not _IS_LITTLE,
        fields=fields,
        point_step=dtype.itemsize,
        row_step=dtype.itemsize * width,
    )
    cloud.data = array.array("B", points.tobytes())
    return cloud


def create_cloud_xyz32(header: Header, points: Any) -> PointCloud2:
    """Return a cloud of points x, y, z as 32-bit floats."""
    fields = [
        PointField(name=name, offset=4 * index, datatype=PointField.FLOAT32, count=1)
        for index, name in enumerate("xyz")
    ]
    return create_cloud(header, fields, points)
