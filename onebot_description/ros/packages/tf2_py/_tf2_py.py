"""``BufferCore``: the interface of tf2_py to the transform buffer."""

import math
import struct
from typing import Any

import numpy as np
from geometry_msgs.msg import Quaternion, TransformStamped, Vector3
from rclpy.impl.rcutils_logger import RcutilsLogger

from onebot_description.geometry import poses
from onebot_description.ros.transform_buffer import (
    CACHE_NS,
    Found,
    TransformBuffer,
    seconds,
    seconds_text,
    unit,
)
from onebot_description.ros.transform_buffer import (
    ConnectivityException as ConnectivityException,
)
from onebot_description.ros.transform_buffer import (
    ExtrapolationException as ExtrapolationException,
)
from onebot_description.ros.transform_buffer import (
    InvalidArgumentException as InvalidArgumentException,
)
from onebot_description.ros.transform_buffer import (
    LookupException as LookupException,
)
from onebot_description.ros.transform_buffer import (
    TimeoutException as TimeoutException,
)
from onebot_description.ros.transform_buffer import (
    TransformException as TransformException,
)
from onebot_description.timing import NS_PER_S

_ROW = struct.Struct("=3q7d")  # a row of transform_buffer.ROW
_MIN_SPAN_NS = 100_000  # minimum time over which a history's rate is computed
_logger = RcutilsLogger()


class BufferCore:
    """Stores transforms over time, and computes the transform between two frames.

    Times are objects with ``nanoseconds``, or with ``sec`` and ``nanosec``; time 0 is the latest
    time at which the frames are connected. ``set_transform`` logs transforms that it ignores.

    Args:
        cache_time: how long transforms are kept; 10 s by default.
    """

    def __init__(self, cache_time: Any = None) -> None:
        cache_ns = CACHE_NS if cache_time is None else _nanoseconds(cache_time, "duration")
        self._core = TransformBuffer(cache_ns)
        self._authorities: dict[str, str] = {}  # last sender of each frame

    # --- input ----------------------------------------------------------------------------------

    def set_transform(self, transform: TransformStamped, authority: str) -> None:
        """Add a transform at its time."""
        self._set(transform, authority, False)

    def set_transform_static(self, transform: TransformStamped, authority: str) -> None:
        """Add a transform that holds for all times."""
        self._set(transform, authority, True)

    def _set(self, transform: TransformStamped, authority: str, static: bool) -> None:
        header, pose = transform.header, transform.transform
        stamp_ns = _nanoseconds(header.stamp)
        at, turn = pose.translation, pose.rotation
        if not isinstance(at, Vector3) or not isinstance(turn, Quaternion):
            raise TypeError("transform.translation must be a Vector3, and rotation a Quaternion")
        values = at.x, at.y, at.z, turn.x, turn.y, turn.z, turn.w
        parent = header.frame_id.removeprefix("/")
        child = transform.child_frame_id.removeprefix("/")
        if _faults(parent, child, values, authority):
            return
        number = self._core.number(child)  # before the parent's, as tf2 does
        row = _ROW.pack(self._core.number(parent), number, stamp_ns, *values)
        if self._core.add_rows(row, 1, static) & 1:
            self._authorities[child] = authority
        else:
            _logger.warning(
                f"TF_OLD_DATA ignoring data from the past for frame {child} at time "
                f"{seconds_text(stamp_ns)} according to authority {authority}\nPossible reasons "
                "are listed at http://wiki.ros.org/tf/Errors%20explained"
            )

    def clear(self) -> None:
        """Forget all transforms, except static ones."""
        self._core.clear()

    # --- transforms -----------------------------------------------------------------------------

    def lookup_transform_core(
        self, target_frame: str, source_frame: str, time: Any
    ) -> TransformStamped:
        """Return the transform from the source frame to the target frame."""
        found = self._find(target_frame, source_frame, _nanoseconds(time))
        return _message(target_frame, source_frame, found)

    def lookup_transform_full_core(
        self, target_frame, target_time, source_frame, source_time, fixed_frame
    ) -> TransformStamped:
        """Return the transform between two times, through a frame that is fixed in between."""
        names = {"target": target_frame, "source": source_frame, "fixed": fixed_frame}
        for role, name in names.items():
            self._validate(name, f"lookupTransform argument {role}_frame")
        inner = self._find(fixed_frame, source_frame, _nanoseconds(source_time))
        outer = self._find(target_frame, fixed_frame, _nanoseconds(target_time))
        at, turn = poses.compose(outer.transform, inner.transform)
        return _message(target_frame, source_frame, Found(outer.stamp_ns, 0, (*at, *unit(turn))))

    def can_transform_core(
        self, target_frame: str, source_frame: str, time: Any
    ) -> tuple[int, str]:
        """Return whether there is a transform, 1 or 0, and why not."""
        time_ns = _nanoseconds(time)
        if target_frame == source_frame:
            return 1, ""
        names = {"target": target_frame, "source": source_frame}
        return self._can_transform(names, (target_frame, source_frame, time_ns))

    def can_transform_full_core(
        self, target_frame, target_time, source_frame, source_time, fixed_frame
    ) -> tuple[int, str]:
        """Return whether there is a transform between two times, 1 or 0, and why not."""
        times = _nanoseconds(target_time), _nanoseconds(source_time)
        names = {"target": target_frame, "source": source_frame, "fixed": fixed_frame}
        return self._can_transform(
            names, (target_frame, fixed_frame, times[0]), (fixed_frame, source_frame, times[1])
        )

    def _can_transform(
        self, names: dict[str, str], *lookups: tuple[str, str, int]
    ) -> tuple[int, str]:
        """Return whether frames, by their roles, are valid and look-ups succeed; and why not."""
        for role, name in names.items():
            is_known = self._core.numbers.get(name)
            if problem := _malformed(name) or ("" if is_known else "frame does not exist"):
                argument = f"canTransform argument {role}_frame"
                return 0, f'Invalid frame ID "{name}" passed to {argument} - {problem}'
        try:
            for lookup in lookups:
                self._core.find(*lookup)
        except TransformException as error:
            return 0, str(error)
        return 1, ""

    def get_latest_common_time(self, target_frame: str, source_frame: str) -> Any:
        """Return the latest time at which both frames are connected, as an rclpy Time."""
        from rclpy.time import Time

        for name in (target_frame, source_frame):
            self._validate(name, "get_latest_common_time")
        return Time(nanoseconds=self._core.common_time(target_frame, source_frame))

    def _find(self, target: str, source: str, time_ns: int) -> Found:
        if target != source:
            self._validate(target, "lookupTransform argument target_frame")
            self._validate(source, "lookupTransform argument source_frame")
        return self._core.find(target, source, time_ns)

    def _validate(self, name: str, function: str) -> None:
        if problem := _malformed(name):
            raise InvalidArgumentException(
                f'Invalid argument "{name}" passed to {function} - {problem}'
            )
        if not self._core.numbers.get(name):
            raise LookupException(f'"{name}" passed to {function} does not exist. ')

    # --- velocities -----------------------------------------------------------------------------

    def lookupVelocityCore(  # noqa: N802
        self, tracking_frame, observation_frame, time, averaging_interval
    ) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Return the linear, m/s, and angular velocity, rad/s, of one frame in another."""
        frames = tracking_frame, observation_frame, observation_frame
        point = (0.0, 0.0, 0.0), tracking_frame
        return self.lookupVelocityFullCore(*frames, *point, time, averaging_interval)

    def lookupVelocityFullCore(  # noqa: N802
        self,
        tracking_frame,
        observation_frame,
        reference_frame,
        reference_point,
        reference_point_frame,
        time,
        averaging_interval,
    ) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Return the velocity of a point that moves with a frame, in the axes of another."""
        from scipy.spatial.transform import Rotation  # slow to import

        interval = _nanoseconds(averaging_interval, "duration") / 1e9
        now = seconds(_nanoseconds(time))
        latest = self.get_latest_common_time(observation_frame, tracking_frame)
        end_time = min(now + interval * 0.5, seconds(latest.nanoseconds))
        start_time = max(0.00001 + interval, end_time) - interval
        start = self._pose_at(observation_frame, tracking_frame, start_time)
        end = self._pose_at(observation_frame, tracking_frame, end_time)
        reference = self._pose_at(reference_frame, tracking_frame, now)
        point = self._pose_at(reference_frame, reference_point_frame, now)
        turn = Rotation.from_quat(start.rotation)
        angular = turn.apply((turn.inv() * Rotation.from_quat(end.rotation)).as_rotvec())
        moved = np.subtract(end.translation, start.translation)
        axes = Rotation.from_quat(reference.rotation)
        linear, angular = (axes.apply(part / (end_time - start_time)) for part in (moved, angular))
        delta = np.subtract(point.at(reference_point), reference.translation)
        # tf2 multiplies by the distance component by component, where a cross product is meant.
        linear = linear + np.cross(reference.translation, angular) + angular * delta
        return tuple(linear.tolist()), tuple(angular.tolist())

    def _pose_at(self, target: str, source: str, time: float) -> poses.Transform:
        whole_seconds = math.floor(time)
        part_ns = math.floor((time - whole_seconds) * 1e9 + 0.5)
        time_ns = whole_seconds * NS_PER_S + part_ns
        return self._find(target, source, time_ns).transform

    # --- the tree as text -----------------------------------------------------------------------

    def all_frames_as_yaml(self) -> str:
        """Return each frame with its parent, broadcaster and rate as YAML."""
        if len(self._core.frames) == 1:
            return "[]"
        text = ""
        for name, state in self._core.states().items():
            if state.samples:
                span_ns = state.latest_ns - state.oldest_ns
                rate = state.samples * 1e9 / max(span_ns, _MIN_SPAN_NS)
                text += (
                    f"{name}: \n  parent: '{state.parent}'\n"
                    f"  broadcaster: '{self._authorities[name]}'\n"
                    f"  rate: {rate:.3f}\n"
                    f"  most_recent_transform: {seconds_text(state.latest_ns)}\n"
                    f"  oldest_transform: {seconds_text(state.oldest_ns)}\n"
                    f"  buffer_length: {seconds(span_ns):.3f}\n"
                )
        return text

    def all_frames_as_string(self) -> str:
        """Return a line for each frame with its parent."""
        return self._core.as_string()

    def _frameExists(self, frame_id: str) -> bool:  # noqa: N802
        """Return whether a frame was received."""
        return frame_id in self._core.numbers

    def _getFrameStrings(self) -> list[str]:  # noqa: N802
        """Return the names of all frames, in order of arrival."""
        return self._core.frames[1:]


def _malformed(name: str) -> str:
    """Return why a frame's name is not valid; "" if it is."""
    if not isinstance(name, str):
        raise TypeError(f"a frame must be str, not {type(name).__name__}")
    if not name:
        return "in tf2 frame_ids cannot be empty"
    return "in tf2 frame_ids cannot start with a '/'" if name.startswith("/") else ""


def _faults(parent: str, child: str, values: tuple[float, ...], authority: str) -> bool:
    """Log why a transform is ignored; return whether it is."""
    x, y, z, w = values[3:]
    is_placed = all(value == value for value in values[:3])
    is_sound = is_placed and 0.5 < w * w + x * x + y * y + z * z < 2.0
    turn = values[3:] if is_sound else unit(values[3:])  # only the direction matters
    is_turn = all(value == value for value in turn)
    if parent and child and parent != child and is_placed and is_turn:
        return False
    faults = []
    if child == parent:
        faults.append(
            f'TF_SELF_TRANSFORM: Ignoring transform from authority "{authority}" with frame_id and '
            f' child_frame_id "{child}" because they are the same'
        )
    if not child:
        faults.append(
            f'TF_NO_CHILD_FRAME_ID: Ignoring transform from authority "{authority}" because '
            "child_frame_id not set "
        )
    if not parent:
        faults.append(
            f'TF_NO_FRAME_ID: Ignoring transform with child_frame_id "{child}"  from authority '
            f'"{authority}" because frame_id not set'
        )
    at, rotation = (" ".join(f"{value:f}" for value in part) for part in (values[:3], turn))
    if not (is_placed and is_turn):
        faults.append(
            f'TF_NAN_INPUT: Ignoring transform for child_frame_id "{child}" from authority '
            f'"{authority}" because of a nan value in the transform ({at}) ({rotation})'
        )
    if not is_turn:
        faults.append(
            f'TF_DENORMALIZED_QUATERNION: Ignoring transform for child_frame_id "{child}" from '
            f'authority "{authority}" because of an invalid quaternion in the transform '
            f"({rotation})"
        )
    for fault in faults:
        _logger.error(fault)
    return True


def _message(target: str, source: str, found: Found) -> TransformStamped:
    """Return a transform as a message; setting its fields is twice as fast as passing them."""
    message = TransformStamped()
    header, transform = message.header, message.transform
    header.frame_id, message.child_frame_id = target, source
    header.stamp.sec, header.stamp.nanosec = divmod(found.stamp_ns, NS_PER_S)
    at, turn = transform.translation, transform.rotation
    at.x, at.y, at.z, turn.x, turn.y, turn.z, turn.w = found.pose
    return message


def _nanoseconds(time: Any, what: str = "time") -> int:
    """Return the nanoseconds of a time or duration of any type that tf2_py accepts."""
    if hasattr(time, "nanoseconds"):
        return int(time.nanoseconds)
    if hasattr(time, "nanosec"):
        return int(time.sec) * NS_PER_S + int(time.nanosec)
    raise TypeError(f"{what} must have sec and nanosec, or nanoseconds.")
