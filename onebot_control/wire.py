"""The messages of each control cycle as CDR bytes. No ROS here.

All that never changes is written beforehand; a cycle puts its stamp and its numbers in between. For
an Odometry that takes 0.3 us, and 12 us as an object that ROS converts. A publisher sends the bytes
as they are. The layout is that of onebot_description.wire.cdr (plain CDR, little endian; OMG
DDSI-RTPS 2.5, section 10); the order of the fields is that of the .msg files. In bytes from the
body's start, where N stands for names, each with its length before it and padded to 4:

=============  ===========================================================================
Odometry       stamp 8, N frame_id and child_frame_id, (to 8), position 3 and orientation 4
               doubles, covariance 36, linear 3 and angular 3, covariance 36
TFMessage      number of transforms 4, stamp 8, N frame_id and child_frame_id, (to 8),
               translation 3 and rotation 4 doubles
JointState     stamp 8, N frame_id, number 4, N name, then position, velocity and effort:
               number 4, (to 8), doubles
TwistStamped   stamp 8, N frame_id, (to 8), linear 3 and angular 3 doubles
Clock          stamp 8
=============  ===========================================================================

Stamps are bytes, too (see ``pack_stamp``), because all messages of a cycle have the same.
"""

import struct
from collections.abc import Sequence

from onebot_description.wire.cdr import ENCAPSULATION, NANO

_STAMP = 8  # bytes
_U32 = struct.Struct("<I")
_DIMENSIONS = 6  # of a pose or a twist

# Translation x y z in m, then rotation x y z w.
PoseValues = Sequence[float]
# Linear x y z in m/s, then angular x y z in rad/s.
TwistValues = Sequence[float]


def pack_stamp(stamp_ns: int) -> bytes:
    """Return a builtin_interfaces/Time as it lies on the wire."""
    return struct.pack("<iI", *divmod(stamp_ns, NANO))


class OdometryTemplate:
    """A nav_msgs/Odometry of fixed frames and covariances."""

    def __init__(
        self,
        frame: str,
        child: str,
        pose_variances: Sequence[float] = (0.0,) * _DIMENSIONS,
        twist_variances: Sequence[float] = (0.0,) * _DIMENSIONS,
    ) -> None:
        """Write what never changes; the variances are the covariances' diagonals."""
        self._names = _to_doubles(_STAMP, frame, child)
        self._pose_covariance = _diagonal(pose_variances)
        self._twist_covariance = _diagonal(twist_variances)
        sizes = len(self._names), len(self._pose_covariance), len(self._twist_covariance)
        self._form = struct.Struct("<4s8s{}s7d{}s6d{}s".format(*sizes))

    def fill(self, stamp: bytes, pose: PoseValues, twist: TwistValues) -> bytes:
        """Return the serialized message; ``twist`` is in the child's frame."""
        return self._form.pack(
            ENCAPSULATION,
            stamp,
            self._names,
            *pose,
            self._pose_covariance,
            *twist,
            self._twist_covariance,
        )


class TransformTemplate:
    """A tf2_msgs/TFMessage of one transform between fixed frames."""

    def __init__(self, parent: str, child: str) -> None:
        """Write what never changes."""
        self._before = ENCAPSULATION + _U32.pack(1)
        self._names = _to_doubles(_U32.size + _STAMP, parent, child)
        self._form = struct.Struct(f"<8s8s{len(self._names)}s7d")

    def fill(self, stamp: bytes, pose: PoseValues) -> bytes:
        """Return the serialized message."""
        return self._form.pack(self._before, stamp, self._names, *pose)


class TwistTemplate:
    """A geometry_msgs/TwistStamped of a fixed frame."""

    def __init__(self, frame: str) -> None:
        """Write what never changes."""
        self._names = _to_doubles(_STAMP, frame)
        self._form = struct.Struct(f"<4s8s{len(self._names)}s6d")

    def fill(self, stamp: bytes, twist: TwistValues) -> bytes:
        """Return the serialized message."""
        return self._form.pack(ENCAPSULATION, stamp, self._names, *twist)


class JointStateTemplate:
    """A sensor_msgs/JointState of fixed joints, all of its arrays as long as there are joints."""

    def __init__(self, frame: str, joints: Sequence[str]) -> None:
        """Write what never changes."""
        count = len(joints)
        before = _names(_STAMP, frame)
        before += _U32.pack(count)
        before += _names(_STAMP + len(before), *joints)
        # An empty sequence of doubles is not padded before the doubles it has not.
        pad = bytes(4) if count else b""
        self._between = _U32.pack(count) + pad
        before += _U32.pack(count)
        self._before = before + (bytes(-(_STAMP + len(before)) % 8) if count else b"")
        doubles, between = f"{count}d", f"{len(self._between)}s"
        form = f"<4s8s{len(self._before)}s{doubles}{between}{doubles}{between}{doubles}"
        self._form = struct.Struct(form)

    def fill(
        self,
        stamp: bytes,
        positions: Sequence[float],
        velocities: Sequence[float],
        efforts: Sequence[float],
    ) -> bytes:
        """Return the serialized message; one number a joint of each, in rad, rad/s and Nm."""
        return self._form.pack(
            ENCAPSULATION,
            stamp,
            self._before,
            *positions,
            self._between,
            *velocities,
            self._between,
            *efforts,
        )


def clock(stamp: bytes) -> bytes:
    """Return a serialized rosgraph_msgs/Clock."""
    return ENCAPSULATION + stamp


def _names(offset: int, *texts: str) -> bytes:
    """Strings ``offset`` bytes into the body, with what is needed for a number to follow."""
    written = b""
    for text in texts:
        encoded = text.encode() + b"\x00"
        written += _U32.pack(len(encoded)) + encoded
        written += bytes(-(offset + len(written)) % 4)
    return written


def _to_doubles(offset: int, *texts: str) -> bytes:
    """The same, with what is needed for doubles to follow."""
    written = _names(offset, *texts)
    return written + bytes(-(offset + len(written)) % 8)


def _diagonal(variances: Sequence[float]) -> bytes:
    """A covariance of 36 doubles, row by row."""
    size = _DIMENSIONS
    values = [0.0] * size**2
    values[:: size + 1] = variances
    return struct.pack(f"<{size**2}d", *values)
