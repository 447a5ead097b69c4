"""JointState in, transforms out: robot_state_publisher's rules without ROS.

The hot path takes the bytes of a JointState and returns the bytes of a TFMessage: where its numbers
lie is known from messages before (layouts.py), and the answer is a template whose numbers are
overwritten. Where the library is built, the usual message never comes here (compiled_path.py).
"""

import ctypes
import functools
from collections import OrderedDict
from collections.abc import Callable, Sequence
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from onebot_description.model import RobotModel
from onebot_description.model.robot_model import JointArrays
from onebot_description.wire.cdr import (
    DOUBLES_PER_TRANSFORM,
    ENCAPSULATION,
    STAMP,
    Floats,
    JointStateArrays,
    TfTemplate,
    WireError,
    pack_stamp,
    unpack_stamp,
)
from onebot_description.wire.repeated import MarkingReader
from onebot_description.wire.tf_message import TypeSupportError, load_library

# The compiled way from joint positions to transforms, with arrays as the plain way beside it.

# Numbers up to this size stay finite when they are multiplied and added, as transforms are made.
MODERATE = 1e100

# struct joint in _joint_transforms.h.
_JOINT = np.dtype(
    [
        ("half_turn", "f8"),
        ("multiplier", "f8"),
        ("offset", "f8"),
        ("constant", "f8", DOUBLES_PER_TRANSFORM),
        ("sine", "f8", 4),
        ("slide", "f8", 3),
        ("column", "u8"),
        ("stamp_at", "u8"),
        ("values_at", "u8"),
    ]
)


class Motion(NamedTuple):
    """How the joints of a plan follow the positions of a message.

    Attributes:
        joints: K joints.
        columns: (K,) which of the message's positions each one takes.
        multiplier, offset: (K,), of that position; radians or metres.
    """

    joints: JointArrays
    columns: NDArray[np.intp]
    multiplier: Floats
    offset: Floats


class Kernel:
    """Writes a plan's transforms; one object a plan, because it holds where all of it lies.

    Attributes:
        joints: address and number of the plan's joints, as long as this object lives.
    """

    def __init__(self, library: ctypes.PyDLL, motion: Motion, template: TfTemplate) -> None:
        """Lay ``motion`` out for the ``library``, with the places of ``template``."""
        joints = motion.joints
        rows = np.zeros(len(motion.columns), _JOINT)
        rows["half_turn"] = joints.half_turns
        rows["multiplier"], rows["offset"] = motion.multiplier, motion.offset
        rows["constant"], rows["sine"], rows["slide"] = joints.constant, joints.sine, joints.slide
        rows["column"] = motion.columns
        rows["stamp_at"], rows["values_at"] = template.stamps_at, template.values_at
        self._rows, self._template = rows, template
        self.joints = (rows.ctypes.data, len(rows))
        self._fill = library.onebot_fill_message
        self._transforms = library.onebot_joint_transforms

    def message(self, data: bytes, at: int) -> bytes:
        """Return the serialized TFMessage for a JointState.

        Args:
            data: the serialized JointState; its positions are all finite.
            at: where they begin, in bytes.
        """
        blank, size = self._template.address, self._template.size
        message = ctypes.create_string_buffer(size)
        self._fill(message, blank, size, *self.joints, data, at)
        return message.raw

    def transforms(self, positions: Floats) -> Floats:
        """(K, 7) transforms for positions in the message's order."""
        values = np.empty((len(self._rows), DOUBLES_PER_TRANSFORM))
        self._transforms(values.ctypes.data, *self.joints, positions.astype("<f8").tobytes())
        return values


def make_kernel(motion: Motion, template: TfTemplate) -> Kernel | None:
    """Return what computes ``motion`` into ``template``; None where nothing is compiled."""
    library = compiled()
    return None if library is None else Kernel(library, motion, template)


def all_moderate(data: bytes, at: int, count: int) -> bool:
    """Say whether the ``count`` doubles that begin at byte ``at`` are finite and not enormous."""
    library = compiled()
    if library is None:
        return bool((np.abs(np.frombuffer(data, "<f8", count, at)) <= MODERATE).all())
    return bool(library.onebot_all_moderate(data, at, count))


@functools.cache
def compiled() -> ctypes.PyDLL | None:
    """Return the library with its functions declared; None if it is not built."""
    try:
        library = load_library()
    except TypeSupportError:
        return None
    pointer, size, text = ctypes.c_void_p, ctypes.c_size_t, ctypes.c_char_p
    library.onebot_all_moderate.argtypes = [text, size, size]
    library.onebot_fill_message.argtypes = [pointer, pointer, size, pointer, size, text, size]
    library.onebot_fill_message.restype = None
    library.onebot_joint_transforms.argtypes = [pointer, pointer, size, text]
    library.onebot_joint_transforms.restype = None
    library.onebot_state_converter.argtypes = [ctypes.py_object]
    library.onebot_state_converter.restype = ctypes.py_object
    return library


# What one list of joint names means for one robot, worked out once and then reused.

V = TypeVar("V")


class JointStatePlan:
    """Turns the positions of a JointState with given names into transforms.

    Unknown names are passed over, the first of a duplicate wins, mimic joints follow unless the
    message gives them a value of their own (robot_state_publisher's rules).

    Attributes:
        rows: (K,) the model's joints this plan moves.
        template: the TFMessage it fills.
        kernel: what fills it; None where nothing is compiled.
        moderate: positions that are ``all_moderate`` give finite transforms. A robot whose own
            numbers are so large that they might not is published all the same, but slower.
    """

    def __init__(self, model: RobotModel, names: Sequence[str], frame_prefix: str) -> None:
        """Resolve ``names`` against ``model``; ``frame_prefix`` is prepended to every frame."""
        first = {name: column for column, name in reversed(list(enumerate(names)))}
        followers = [
            (row, follower)
            for row, joint in enumerate(model.joints)
            if (follower := model.follower(joint, first)) is not None
        ]
        rows = [row for row, _ in followers]
        self.rows = np.array(rows, np.intp)
        self._joints = model.moving.take(rows)
        columns = [first[follower.source] for _, follower in followers]
        self._motion = Motion(
            self._joints,
            np.array(columns, np.intp),
            np.array([follower.multiplier for _, follower in followers], float),
            np.array([follower.offset for _, follower in followers], float),
        )
        self.template = TfTemplate(
            [frame_prefix + parent for parent in self._joints.parents],
            [frame_prefix + child for child in self._joints.children],
        )
        self.moderate = all(
            bool((np.abs(numbers) <= MODERATE).all())
            for numbers in (self._motion.multiplier, self._motion.offset, self._joints.constant)
        )
        self.kernel = make_kernel(self._motion, self.template)

    def transforms(self, positions: Floats) -> Floats:
        """(K, 7) transforms for positions in the message's order, (len(names),)."""
        if self.kernel is not None:
            return self.kernel.transforms(positions)
        motion = self._motion
        own = positions[motion.columns] * motion.multiplier + motion.offset
        return motion.joints.transforms(own)

    def usable(self, positions: Floats) -> NDArray[np.bool_]:
        """Say of each position, (len(names),), whether it gives finite transforms only.

        A joint that follows another one by a large multiplier may have none where that one has.
        """
        with np.errstate(all="ignore"):
            finite = np.isfinite(self.transforms(positions)).all(axis=1)
        usable: NDArray[np.bool_] = np.isfinite(positions)
        usable[self._motion.columns[~finite]] = False
        return usable

    def message(self, data: bytes, at: int, count: int) -> bytes:
        """Return the serialized TFMessage for a serialized JointState.

        Args:
            data: the JointState.
            at: where its positions begin, in bytes.
            count: of its positions, all of them ``usable``.
        """
        if self.kernel is not None:
            return self.kernel.message(data, at)
        positions = np.frombuffer(data, "<f8", count, at)
        return self.template.fill(data[STAMP], self.transforms(positions))


class RecentlyUsed(OrderedDict[object, V]):
    """A mapping that keeps the entries used last and makes those it lacks."""

    def __init__(self, capacity: int) -> None:
        """Keep at most ``capacity`` entries."""
        super().__init__()
        self._capacity = capacity

    def obtain(self, key: object, make: Callable[[], V]) -> V:
        """Return the entry of ``key``, made now if it is not there."""
        if key in self:
            self.move_to_end(key)
            return self[key]
        value = self[key] = make()
        if len(self) > self._capacity:
            self.popitem(last=False)
        return value


# Where the numbers lie in a serialized JointState.

BLOCK_AT = STAMP.stop
# Publishers of one topic, times the subsets of joints each sends; more only costs time.
_KEPT = 64


class Layout(NamedTuple):
    """Where the positions lie behind one particular block of names.

    Attributes:
        block: the bytes from ``BLOCK_AT`` on: frame_id, names and the number of positions.
        mask: 255 where the block's bytes tell something, 0 where they are padding.
        first: where the positions begin, in bytes.
        names: of the joints; as many as there are positions.
        plan: what is done with the positions.
    """

    block: bytes
    mask: NDArray[np.uint8]
    first: int
    names: tuple[str, ...]
    plan: JointStatePlan

    def fits(self, data: bytes) -> bool:
        """Whether ``data`` has this block; padding may hold anything."""
        if data.startswith(self.block, BLOCK_AT):
            return True
        if len(data) < BLOCK_AT + len(self.block):
            return False
        theirs = np.frombuffer(data, np.uint8, len(self.block), BLOCK_AT)
        ours = np.frombuffer(self.block, np.uint8)
        return not ((theirs ^ ours) & self.mask).any()


class Layouts:
    """The layouts of one robot's joint states, each worked out once."""

    def __init__(self, model: RobotModel, frame_prefix: str) -> None:
        """Serve ``model``, with ``frame_prefix`` prepended to every frame."""
        self._model, self._prefix = model, frame_prefix
        self._plans: RecentlyUsed[JointStatePlan] = RecentlyUsed(_KEPT)
        self._layouts: RecentlyUsed[Layout] = RecentlyUsed(_KEPT)
        self._latest: Layout | None = None

    def plan(self, names: tuple[str, ...]) -> JointStatePlan:
        """Return what is done with a message of these joints."""
        return self._plans.obtain(names, lambda: JointStatePlan(self._model, names, self._prefix))

    def of(self, data: bytes) -> tuple[Layout, int]:
        """Return a serialized JointState's layout and how many positions it says it has.

        Raises:
            WireError: the bytes are of another encoding, or broken.
        """
        if not data.startswith(ENCAPSULATION[:2]):
            raise WireError("not plain little-endian CDR")
        latest = self._latest
        if latest is not None and latest.fits(data):
            return latest, len(latest.names)
        self._latest, positions = self._parse(data)
        return self._latest, positions

    def _parse(self, data: bytes) -> tuple[Layout, int]:
        reader = MarkingReader(data)
        reader.stamp_ns()
        reader.string()
        names = tuple(reader.string() for _ in range(reader.count(4)))
        positions = reader.u32()
        end = reader.offset
        reader.align(8)
        block = data[BLOCK_AT : end - 4] + len(names).to_bytes(4, "little")
        mask = reader.mask[BLOCK_AT:end]

        def make() -> Layout:
            return Layout(block, mask, reader.offset, names, self.plan(names))

        # By its bytes, not by the names: an empty string may be written in two ways.
        text = (np.frombuffer(block, np.uint8) & mask).tobytes()
        return self._layouts.obtain((text, mask.tobytes()), make), positions


# When each joint was last published, and what follows from it: the throttle's rules.

Warn = Callable[[str, str], None]

# Longer than ROS time can count, and far enough from the end of int64 to be added to it.
_FOREVER_NS = 2**61


class PublishedTimes:
    """Decides whether a message is published, by its stamp and its joints' last publication.

    Both ways of a message, the long one and the compiled one, look at the same numbers here.

    Attributes:
        interval_ns: least time between two publications of a joint; 0 for every message.
        ignore_timestamp: publish whatever the stamp says.
        stamps: (joints,) stamp of each joint's last publication in nanoseconds; 0: never.
        newest_call: (1,) the node's clock at the last message.
    """

    def __init__(self, joints: int, interval_ns: int = 0, ignore_timestamp: bool = False) -> None:
        """Start with ``joints`` joints never published."""
        self.interval_ns = min(max(interval_ns, 0), _FOREVER_NS)
        self.ignore_timestamp = ignore_timestamp
        self.stamps: NDArray[np.int64] = np.zeros(joints, np.int64)
        self.newest_call: NDArray[np.int64] = np.zeros(1, np.int64)

    def forget(self) -> None:
        """Start afresh, after the clock was set back."""
        self.stamps[:] = 0

    def due(self, rows: NDArray[np.intp], stamp_ns: int, now_ns: int, warn: Warn) -> bool:
        """Whether a message may be published; if so, note it as published.

        Args:
            rows: the joints it moves.
            stamp_ns: its stamp.
            now_ns: the node's clock.
            warn: told why it is not, unless it is only early.
        """
        if now_ns < self.newest_call[0]:
            warn("clock", "the clock was set back; publishing the joints' transforms afresh")
            self.forget()
        self.newest_call[0] = now_ns
        if len(rows) == 0:
            return False
        if not self.ignore_timestamp:
            if stamp_ns == 0:
                warn(
                    "stamp",
                    "joint states with stamp 0 are not published: set header.stamp, or the "
                    "parameter ignore_timestamp to true",
                )
                return False
            if stamp_ns < int(self.stamps[rows].min()) + self.interval_ns:
                return False
        self.stamps[rows] = stamp_ns
        return True


# The usual JointState in one compiled call: see _state_converter.c.

ConvertBytes = Callable[[bytes, int], bytes | None]

_KNOWN = 8  # as in _state_converter.c


class _Layout(ctypes.Structure):
    """struct layout in _state_converter.c."""

    _fields_ = (
        ("block", ctypes.c_char_p),
        ("mask", ctypes.c_void_p),
        ("size", ctypes.c_uint64),
        ("first", ctypes.c_uint64),
        ("positions", ctypes.c_uint64),
        ("joints", ctypes.c_void_p),
        ("count", ctypes.c_uint64),
        ("rows", ctypes.c_void_p),
        ("message", ctypes.c_void_p),
        ("message_size", ctypes.c_uint64),
    )


class _State(ctypes.Structure):
    """struct state in _state_converter.c."""

    _fields_ = (
        ("interval", ctypes.c_int64),
        ("ignore_timestamp", ctypes.c_int64),
        ("newest_call", ctypes.c_void_p),
        ("times", ctypes.c_void_p),
        ("known", ctypes.c_uint64),
        ("recent", ctypes.c_uint64),
        ("layouts", _Layout * _KNOWN),
    )


class CompiledPath:
    """Makes the builtin and tells it of layouts; holds the memory that it works on."""

    def __init__(self, library: ctypes.PyDLL, times: PublishedTimes) -> None:
        """Know no layout yet; ``times`` are shared with the long way."""
        self._library, self._times = library, times
        self._state = _State(
            times.interval_ns,
            times.ignore_timestamp,
            times.newest_call.ctypes.data,
            times.stamps.ctypes.data,
        )
        self._layouts: list[Layout] = []
        self._next = 0

    def bind(self, long_way: ConvertBytes) -> ConvertBytes:
        """Return the builtin, which calls ``long_way`` for what it does not handle."""
        address = ctypes.addressof(self._state)
        convert: ConvertBytes = self._library.onebot_state_converter((address, long_way, self))
        return convert

    def learn(self, layout: Layout) -> None:
        """Handle messages of this layout from now on; the oldest of too many is forgotten.

        Args:
            layout: moves joints, and finitely if positions are moderate.
        """
        writer, template = layout.plan.kernel, layout.plan.template
        if writer is None or any(known is layout for known in self._layouts):
            return
        place = self._next % _KNOWN
        self._next += 1
        # The place is written before the layout whose memory it held may go.
        self._state.layouts[place] = _Layout(
            layout.block,
            layout.mask.ctypes.data,
            len(layout.block),
            layout.first,
            len(layout.names),
            *writer.joints,
            layout.plan.rows.ctypes.data,
            template.address,
            template.size,
        )
        self._layouts[place : place + 1] = [layout]
        self._state.known = len(self._layouts)


def make_compiled_path(times: PublishedTimes) -> CompiledPath | None:
    """Return the compiled way for ``times``; None where nothing is compiled."""
    library = compiled()
    return None if library is None else CompiledPath(library, times)


class Transforms(NamedTuple):
    """What is to be published for one JointState.

    Attributes:
        plan: knows the frames.
        values: (K, 7) translations and rotations.
        stamp: eight bytes, as on the wire.
    """

    plan: JointStatePlan
    values: Floats
    stamp: bytes

    def serialized(self) -> bytes:
        """Return the bytes of the TFMessage."""
        return self.plan.template.fill(self.stamp, self.values)


class StateConverter:
    """Applies one robot's description to its joint states.

    Attributes:
        convert_bytes: ``convert_bytes(data, now_ns)`` turns a serialized JointState, in plain
            little-endian CDR, into a serialized TFMessage, or into None when nothing is to be
            published. ``now_ns`` is the node's clock, to notice that it was set back. Raises
            WireError for bytes of another encoding, or broken ones. It is a builtin where the
            library is built.
    """

    convert_bytes: Callable[[bytes, int], bytes | None]

    def __init__(
        self,
        model: RobotModel,
        *,
        frame_prefix: str = "",
        interval_ns: int = 0,
        ignore_timestamp: bool = False,
        warn: Warn = lambda _key, _text: None,
    ) -> None:
        """Serve ``model``.

        Args:
            model: the robot.
            frame_prefix: prepended to every frame.
            interval_ns: least time between two publications of a joint; 0 for every message.
            ignore_timestamp: publish whatever the stamp says.
            warn: ``warn(key, text)`` is told of input that is passed over.
        """
        self._model = model
        self._prefix = frame_prefix
        self._warn = warn
        self._layouts = Layouts(model, frame_prefix)
        self._times = PublishedTimes(len(model.joints), interval_ns, ignore_timestamp)
        self._compiled = make_compiled_path(self._times)
        path = self._compiled
        self.convert_bytes = path.bind(self._convert_bytes) if path else self._convert_bytes

    def static_transforms(self, stamp_ns: int) -> bytes:
        """Return the serialized TFMessage of the joints that never move."""
        fixed = self._model.fixed
        template = TfTemplate(
            [self._prefix + parent for parent in fixed.parents],
            [self._prefix + child for child in fixed.children],
        )
        return template.fill(pack_stamp(stamp_ns), fixed.constant)

    def forget_times(self) -> None:
        """Start afresh, after the clock was set back."""
        self._times.forget()

    def _convert_bytes(self, data: bytes, now_ns: int) -> bytes | None:
        """The long way of ``convert_bytes``, for every message."""
        layout, count = self._layouts.of(data)
        if count != len(layout.names):
            self._complain_of_sizes(len(layout.names), count)
            return None
        if count == 0:
            return None
        if layout.first + 8 * count > len(data):
            raise WireError("truncated positions")
        stamp_ns, plan = unpack_stamp(data[STAMP]), layout.plan
        if not (plan.moderate and all_moderate(data, layout.first, count)):
            positions = np.frombuffer(data, "<f8", count, layout.first)
            state = JointStateArrays(stamp_ns, "", layout.names, positions, positions, positions)
            result = self.convert(state, now_ns)
            return None if result is None else result.serialized()
        if not self._times.due(plan.rows, stamp_ns, now_ns, self._warn):
            return None
        if self._compiled is not None:
            self._compiled.learn(layout)
        return plan.message(data, layout.first, count)

    def convert(self, state: JointStateArrays, now_ns: int) -> Transforms | None:
        """Do the same for a JointState that was deserialised; the result is equal bit by bit."""
        names, positions = state.names, state.positions
        if len(names) != len(positions):
            self._complain_of_sizes(len(names), len(positions))
            return None
        usable = self._layouts.plan(names).usable(positions) if names else np.empty(0, bool)
        if not usable.all():
            bad = [name for name, good in zip(names, usable, strict=True) if not good]
            self._complain_of_positions(bad, np.isfinite(positions[~usable]))
            names = tuple(name for name in names if name not in bad)
            positions = positions[[name not in bad for name in state.names]]
        if not names:
            return None
        plan = self._layouts.plan(names)
        if not self._times.due(plan.rows, state.stamp_ns, now_ns, self._warn):
            return None
        return Transforms(plan, plan.transforms(positions), pack_stamp(state.stamp_ns))

    def _complain_of_positions(self, names: list[str], finite: NDArray[np.bool_]) -> None:
        """Tell of joints that are not moved, some of which have a finite position."""
        why = ", or one too large for what follows it" if finite.any() else ""
        text = f"joint state without a finite position{why}: {', '.join(names)}; ignored"
        self._warn("finite", text)

    def _complain_of_sizes(self, names: int, positions: int) -> None:
        self._warn(
            "sizes" if positions else "empty",
            f"joint state with {names} names but {positions} positions; ignored",
        )
