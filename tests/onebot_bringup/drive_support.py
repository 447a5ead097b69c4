"""A trail's messages, and what lies on an entity of a file, for the tests of a driving robot."""

import warnings
from itertools import groupby
from pathlib import Path

import numpy as np
import rerun.chunk as rc
from geometry_msgs.msg import Point
from nav_msgs.msg import Odometry

from tests.support import wait_for


def odometry(x, y=0.0, *, frame="odom", speed=0.0, turn=0.0) -> Odometry:
    """A robot at (x, y) meters, at a time that follows."""
    message = Odometry(child_frame_id="base")
    message.header.frame_id = frame
    message.pose.pose.position = Point(x=float(x), y=float(y))
    message.twist.twist.linear.x, message.twist.twist.angular.z = float(speed), float(turn)
    return message


def chunks(path: Path, entity: str) -> list:
    """The chunks of ``entity`` in a file, the static ones first."""
    found = [chunk for chunk in _stream(path) if str(chunk.entity_path) == entity]
    return sorted(found, key=lambda chunk: not chunk.is_static)


def entities(path: Path) -> set[str]:
    """The entities in a file of which something is logged at a time."""
    return {str(chunk.entity_path) for chunk in _stream(path) if not chunk.is_static}


def _stream(path: Path):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a recording without a footer is our choice
        wait_for(lambda: rc.RrdReader(str(path)).recordings(), "the first message in the file")
        return rc.RrdReader(str(path)).stream()


def column(path: Path, entity: str, name: str) -> list:
    """All rows of a column of ``entity``, in the order they were logged."""
    return [
        row
        for chunk in chunks(path, entity)
        if name in chunk.to_record_batch().schema.names
        for row in chunk.to_record_batch().column(name).to_pylist()
    ]


def stamps(path: Path, entity: str) -> list[int]:
    """When the rows of ``entity`` were logged, nanoseconds, in the order they were."""
    return [
        stamp
        for chunk in chunks(path, entity)
        if not chunk.is_static
        for stamp in chunk.to_record_batch().column("ros_time").cast("int64").to_pylist()
    ]


def frames(path: Path, entity: str) -> list[str]:
    """The frames that an entity is in, one after the other."""
    rows = [frame for [frame] in column(path, entity, "CoordinateFrame:frame")]
    return [frame for frame, _ in groupby(rows)]


def while_written(read, *args) -> list:
    """``read(*args)`` of a file that a node writes to; nothing if it ends within a message."""
    try:
        return read(*args)
    except (RuntimeError, ValueError):  # as Rerun names an end within the header, or a message
        return []


def strips(path: Path, name: str) -> list:
    """The pieces of a trail, (2, 3) each."""
    rows = column(path, f"/trails/{name}", "LineStrips3D:strips")
    return [np.array(strip) for row in rows if row for strip in row]


def curve(path: Path, entity: str) -> list:
    """The values of a curve, NaN for a gap."""
    return [row[0] for row in column(path, entity, "Scalars:scalars") if row]
