"""``BufferCore``: the interface of tf2_py to the transform buffer."""

import math
import struct
import warnings
from typing import Any

from geometry_msgs.msg import Quaternion, TransformStamped, Vector3
from rclpy.impl.rcutils_logger import RcutilsLogger

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
_NO_PARENT = "NO_PARENT"
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
        self._set(transform, authority, False, "have members x, y, z", "have members w, x, y, z")

    def set_transform_static(self, transform: TransformStamped, authority: str) -> None:
        """Add a transform that holds for all times."""
        self._set(transform, authority, True, "be of type Vector3", "be of type Quaternion")

    def _set(
        self, transform: Any, authority: str, static: bool, vector: str, quaternion: str
    ) -> None:
        header, pose = transform.header, transform.transform
        stamp_ns = _nanoseconds(header.stamp)
        at, turn = pose.translation, pose.rotation
        if not isinstance(at, Vector3):
            warnings.warn("translation should be of type Vector3", stacklevel=4)
            raise TypeError(f"transform.translation must {vector}")
        if not isinstance(turn, Quaternion):
            warnings.warn("translation should be of type Quaternion", stacklevel=4)
            if not all(hasattr(turn, name) for name in "wxyz"):
                raise TypeError(f"transform.rotation must {quaternion}")
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
        self._core.compose(outer, inner)
        inner.stamp_ns = outer.stamp_ns
        return _message(target_frame, source_frame, inner)

    def can_transform_core(
        self, target_frame: str, source_frame: str, time: Any
    ) -> tuple[int, str]:
        """Return whether there is a transform, 1 or 0, and why not."""
        time_ns = _nanoseconds(time)
        if target_frame == source_frame:
            return 1, ""
        problem = self._first_invalid(target=target_frame, source=source_frame)
        problem = problem or self._failure(target_frame, source_frame, time_ns)
        return int(not problem), problem

    def can_transform_full_core(
        self, target_frame, target_time, source_frame, source_time, fixed_frame
    ) -> tuple[int, str]:
        """Return whether there is a transform between two times, 1 or 0, and why not."""
        times = _nanoseconds(target_time), _nanoseconds(source_time)
        names = {"target": target_frame, "source": source_frame, "fixed": fixed_frame}
        problem = self._first_invalid(**names)
        problem = problem or self._failure(target_frame, fixed_frame, times[0])
        problem = problem or self._failure(fixed_frame, source_frame, times[1])
        return int(not problem), problem

    def get_latest_common_time(self, target_frame: str, source_frame: str) -> Any:
        """Return the latest time at which both frames are connected, as an rclpy Time."""
        from rclpy.time import Time

        for name in (target_frame, source_frame):
            self._validate(name, "get_latest_common_time")
        try:
            time_ns = self._core.common_time(target_frame, source_frame)
        except TransformException as error:
            raise TransformException(str(error)) from None  # no subclass, as in tf2_py
        return Time(nanoseconds=time_ns)

    def _find(self, target: str, source: str, time_ns: int) -> Found:
        if target != source:
            self._validate(target, "lookupTransform argument target_frame")
            self._validate(source, "lookupTransform argument source_frame")
        return self._core.find(target, source, time_ns)

    def _failure(self, target: str, source: str, time_ns: int) -> str:
        """Return why there is no transform between two frames; "" if there is one."""
        try:
            self._core.find(target, source, time_ns)
        except TransformException as error:
            return str(error)
        return ""

    def _validate(self, name: str, function: str) -> None:
        problem = _malformed(name)
        if problem:
            raise InvalidArgumentException(
                f'Invalid argument "{name}" passed to {function} - {problem}'
            )
        if not self._core.numbers.get(name):
            raise LookupException(f'"{name}" passed to {function} does not exist. ')

    def _first_invalid(self, **names: str) -> str:
        """Return what is wrong with the first invalid name of a frame; "" if all are valid."""
        for role, name in names.items():
            problem = _malformed(name)
            if problem or not self._core.numbers.get(name):
                return (
                    f'Invalid frame ID "{name}" passed to canTransform argument {role}_frame - '
                    + (problem or "frame does not exist")
                )
        return ""

    # --- velocities -----------------------------------------------------------------------------

    def lookupVelocityCore(  # noqa: N802
        self, tracking_frame: str, observation_frame: str, time: Any, averaging_interval: Any
    ) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Return the linear, m/s, and angular velocity, rad/s, of one frame in another."""
        return self.lookupVelocityFullCore(
            tracking_frame,
            observation_frame,
            observation_frame,
            (0.0, 0.0, 0.0),
            tracking_frame,
            time,
            averaging_interval,
        )

    def lookupVelocityFullCore(  # noqa: N802
        self,
        tracking_frame: str,
        observation_frame: str,
        reference_frame: str,
        reference_point: tuple[float, float, float],
        reference_point_frame: str,
        time: Any,
        averaging_interval: Any,
    ) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Return the velocity of a point that moves with a frame, in the axes of another."""
        interval = _nanoseconds(averaging_interval, "duration") / 1e9
        now = seconds(_nanoseconds(time))
        try:
            latest_ns = self._core.common_time(observation_frame, tracking_frame)
        except TransformException:
            latest_ns = 0
        end_time = min(now + interval * 0.5, seconds(latest_ns))
        start_time = max(0.00001 + interval, end_time) - interval
        start = self._find(observation_frame, tracking_frame, _from_seconds(start_time))
        end = self._find(observation_frame, tracking_frame, _from_seconds(end_time))
        reference = self._find(reference_frame, tracking_frame, _from_seconds(now))
        point = self._find(reference_frame, reference_point_frame, _from_seconds(now))
        x, y, z = reference_point
        rows = (point.basis[at : at + 3] for at in (0, 3, 6))
        delta = [
            a * x + b * y + c * z + to - origin
            for (a, b, c), to, origin in zip(rows, point.origin, reference.origin, strict=True)
        ]
        velocity = self._core.velocity(start, end, reference, end_time - start_time, delta)
        return tuple(velocity[:3]), tuple(velocity[3:])

    # --- the tree as text -----------------------------------------------------------------------

    def all_frames_as_yaml(self) -> str:
        """Return each frame with its parent, broadcaster and rate as YAML."""
        entries = (
            f"{name}: \n  parent: '{state.parent}'\n"
            f"  broadcaster: '{self._authority(name)}'\n"
            f"  rate: {_rate(state):.3f}\n"
            f"  most_recent_transform: {seconds_text(state.latest_ns)}\n"
            f"  oldest_transform: {seconds_text(state.oldest_ns)}\n"
            f"  buffer_length: {seconds(state.latest_ns - state.oldest_ns):.3f}\n"
            for name, state in self._core.states().items()
            if state.samples
        )
        return "[]" if len(self._core.frames) == 1 else "".join(entries)

    def all_frames_as_string(self) -> str:
        """Return a line for each frame with its parent."""
        return self._core.as_string()

    def _allFramesAsDot(self, time: Any = None) -> str:  # noqa: N802
        """Return the tree as a graph in Graphviz's language."""
        time_ns = _nanoseconds(time) if time is not None else 0
        recorded = ""
        if time_ns:
            recorded = f'"Recorded at time: {seconds_text(time_ns)}"[ shape=plaintext ] ;\n '
        states = self._core.states()
        lines = ["digraph G {\n"]
        if len(self._core.frames) == 1:
            lines.append('"no tf data recieved"')
        for name, state in states.items():
            if state.samples:
                age = f"( {seconds(time_ns - state.latest_ns):.3f} sec old)" if time_ns else ""
                lines.append(
                    f'"{state.parent}" -> "{name}"[label="Broadcaster: {self._authority(name)}\\n'
                    f"Average rate: {_rate(state):.3f} Hz\\n"
                    f"Most recent transform: {seconds_text(state.latest_ns)} {age}\\n"
                    f"Buffer length: {seconds(state.latest_ns - state.oldest_ns):.3f} sec\\n"
                    '"];\n'
                )
        for name in self._core.frames[1:]:
            if not states[name].samples if name in states else time_ns:
                lines.append(
                    "edge [style=invis];\n subgraph cluster_legend { style=bold; color=black; "
                    f'label ="view_frames Result";\n{recorded}}}->"{name}";\n'
                )
        return "".join([*lines, "}"])

    def _frameExists(self, frame_id: str) -> bool:  # noqa: N802
        """Return whether a frame was received."""
        return frame_id in self._core.numbers

    def _getFrameStrings(self) -> list[str]:  # noqa: N802
        """Return the names of all frames, in order of arrival."""
        return self._core.frames[1:]

    def _chain(
        self, target_frame, target_time, source_frame, source_time, fixed_frame
    ) -> list[str]:
        """Return the frames that a transform passes through, in tf2's order."""
        target_ns, source_ns = _nanoseconds(target_time), _nanoseconds(source_time)
        chain = self._way(fixed_frame, source_frame, source_ns)
        if source_ns == target_ns:
            return chain
        onward = self._way(target_frame, fixed_frame, target_ns)
        end = _prune(chain, onward)
        return chain + onward[: end + 1] if end < len(onward) else chain

    def _way(self, target: str, source: str, time_ns: int) -> list[str]:
        """Return the frames that lead from one to another, in tf2's order."""
        numbers = self._core.numbers
        target, source = (name if name in numbers else _NO_PARENT for name in (target, source))
        if target == source:
            return []
        if time_ns == 0 and _NO_PARENT in (target, source):
            raise LookupException("")
        stamp_ns = self._core.find(target, source, time_ns).stamp_ns
        up, down = [source], [target]
        while (parent := self._core.parent_at(up[-1], stamp_ns)) != _NO_PARENT:
            if up[-1] == target:
                return up
            up.append(parent)
        while down[-1] not in (up[-1], source):
            down.append(self._core.parent_at(down[-1], stamp_ns))
        if down[-1] != up[-1]:
            return down
        del down[-1]
        end = _prune(up, down)
        return up + down[end::-1] if end < len(down) else up

    def _authority(self, name: str) -> str:
        return self._authorities.get(name, "no recorded authority")


def _prune(chain: list[str], other: list[str]) -> int:
    """Cut the common end off a chain; return the index in ``other`` where they part."""
    at, end = len(chain), len(other)
    while at and end:
        at, end = at - 1, end - 1
        if chain[at] != other[end]:
            break
    if at:
        del chain[at - 1 :]
    return end


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
    try:
        return int(time.sec) * NS_PER_S + int(time.nanosec)
    except AttributeError:
        pass
    try:
        return int(time.nanoseconds)
    except AttributeError:
        message = f"{what} must have sec and nanosec, or nanoseconds."
        raise TypeError(message) from None


def _from_seconds(time: float) -> int:
    whole_seconds = math.floor(time)
    return whole_seconds * NS_PER_S + math.floor((time - whole_seconds) * 1e9 + 0.5)


def _rate(state: Any) -> float:
    span_ns = max(state.latest_ns - state.oldest_ns, _MIN_SPAN_NS)
    return float(state.samples * 1e9 / span_ns)
