"""Converts JointStates to TFMessages, by robot_state_publisher's rules.

There are two paths, with the same result:

- One compiled call (_state_converter.c) takes the bytes of a JointState and returns the bytes of a
  TFMessage. It recognises the frame_id and joint names of earlier messages, compared as bytes.
- Python code with RobotModel's arrays handles messages that the call does not recognise: the first
  message of a publisher, broken bytes, positions that are not finite or enormous, stamps of 0 or
  set back, a clock that was set back. Where possible, it teaches the compiled call to recognise
  the next such message.
"""

import ctypes
import functools
import itertools
import struct
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from builtin_interfaces.msg import Time
from numpy.typing import NDArray
from rclpy.serialization import serialize_message

from onebot_description.arrays import Floats
from onebot_description.compiled.library import load_library
from onebot_description.errors import listing
from onebot_description.model import RobotModel
from onebot_description.ros.wire.cdr import DOUBLES_PER_TRANSFORM, STAMP, WireError, Writer
from onebot_description.ros.wire.interfaces import TFMessage
from onebot_description.ros.wire.message_arrays import (
    LARGEST_KEPT,
    JointStateArrays,
    one_joint_state,
)
from onebot_description.ros.wire.messages import time_message, transforms_message
from onebot_description.timing import NS_PER_S

Warn = Callable[[str, str], None]
ConvertBytes = Callable[[bytes, int], bytes | None]

# Publishers of one topic, times the subsets of joints that each sends; more only cost time. It is
# the same in _state_converter.c.
_KNOWN = 16
# A stamp this much older than the last one comes from another clock, or the last one was wrong.
# Messages are in transit for less, and tf2 ignores older ones.
_OTHER_CLOCK_NS = 10 * NS_PER_S

# struct joint in _state_converter.c.
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


class _Layout(ctypes.Structure):
    """struct layout in _state_converter.c."""

    _fields_ = (
        ("block", ctypes.c_char_p),
        ("mask", ctypes.c_char_p),
        ("size", ctypes.c_uint64),
        ("first", ctypes.c_uint64),
        ("positions", ctypes.c_uint64),
        ("joints", ctypes.c_void_p),
        ("count", ctypes.c_uint64),
        ("rows", ctypes.c_void_p),
        ("message", ctypes.c_char_p),
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


class JointStatePlan:
    """Maps the positions of a JointState with given names to the joints of one robot.

    Unknown names are ignored, the first of a duplicate counts, and mimic joints follow unless the
    message contains a value for them (robot_state_publisher's rules).

    Attributes:
        names: names of the message's joints.
        rows: (K,) the moved joints, as indices in the model.
        joints: their arrays.
        columns: (K,) index of the message's position that each joint follows.
        multiplier, offset: (K,) of that position; radians or meters.
        parents, children: frames of the K transforms.
    """

    def __init__(self, model: RobotModel, names: Sequence[str], frame_prefix: str) -> None:
        first = {name: column for column, name in reversed(list(enumerate(names)))}
        followers = model.followers(first)
        rows = [model.row(joint) for joint in followers]
        self.names, self.rows = tuple(names), np.array(rows, np.int64)
        self.joints = model.moving.take(rows)
        self.columns = np.array([first[mimic.joint] for mimic in followers.values()], np.intp)
        self.multiplier = np.array([mimic.multiplier for mimic in followers.values()], float)
        self.offset = np.array([mimic.offset for mimic in followers.values()], float)
        self.parents = [frame_prefix + parent for parent in self.joints.parents]
        self.children = [frame_prefix + child for child in self.joints.children]

    def transforms(self, positions: Floats) -> Floats:
        """(K, 7) transforms for positions in the message's order, (len(names),)."""
        return self.joints.transforms(positions[self.columns] * self.multiplier + self.offset)

    def usable(self, positions: Floats) -> NDArray[np.bool_]:
        """Return for each position, (len(names),), whether all its transforms are finite.

        A joint that follows with a large multiplier may overflow although its leader does not.
        """
        with np.errstate(all="ignore"):
            finite = np.isfinite(self.transforms(positions)).all(axis=1)
        usable = np.ones(len(self.names), np.bool_)
        usable[self.columns[~finite]] = False
        return usable


class PublishedTimes:
    """Decides whether a message is published, by its stamp and its joints' last publication.

    Attributes:
        interval_ns: minimum time between two publications of a joint; 0 for every message.
        ignore_timestamp: publish whatever the stamp is.
        stamps: (joints,) stamp of each joint's last publication in nanoseconds; 0: never. The
            compiled call also reads and writes them.
        newest_call: (1,) the node's clock at the last message, shared in the same way.
    """

    def __init__(self, joints: int, interval_ns: int = 0, ignore_timestamp: bool = False) -> None:
        self.interval_ns = interval_ns
        self.ignore_timestamp = ignore_timestamp
        self.stamps: NDArray[np.int64] = np.zeros(joints, np.int64)
        self.newest_call: NDArray[np.int64] = np.zeros(1, np.int64)

    def forget(self) -> None:
        self.stamps[:] = 0

    def due(self, rows: NDArray[np.int64], stamp_ns: int, now_ns: int, warn: Warn) -> bool:
        """Return whether a message may be published; if so, note it as published.

        ``rows`` are the joints that it moves, ``now_ns`` is the node's clock; ``warn`` is called
        with the reason if it is not, unless it is merely early.
        """
        if now_ns < self.newest_call[0]:
            warn("clock", "the clock was set back; publishing the joints' transforms afresh")
            self.forget()
        self.newest_call[0] = now_ns
        if len(rows) == 0:
            return False
        if not self.ignore_timestamp:
            if stamp_ns <= 0:
                warn(
                    "stamp",
                    "joint states with stamp 0 or less are not published: set header.stamp, or "
                    "the parameter ignore_timestamp to true",
                )
                return False
            oldest = int(self.stamps[rows].min())
            if stamp_ns < oldest:
                if not _of_another_clock(oldest - stamp_ns, warn):
                    return False
            elif stamp_ns < oldest + self.interval_ns:
                return False
        self.stamps[rows] = stamp_ns
        return True


def _of_another_clock(older_ns: int, warn: Warn) -> bool:
    """Return whether a message is so old that its clock must have been set back."""
    seconds = f"{older_ns / NS_PER_S:.3f} s"
    if older_ns < _OTHER_CLOCK_NS:
        text = f"joint state {seconds} older than the last one of its joints, ignored"
        warn("old", f"{text}; do several nodes publish joint states?")
        return False
    warn("back", f"the stamps of joint states went back by {seconds}; using the new stamps")
    return True


class _Known(NamedTuple):
    """A layout that the compiled call recognises; holds the memory that it reads."""

    layout: _Layout  # holds addresses of the rest
    key: tuple[str, tuple[str, ...]]  # frame_id and names of its messages
    plan: JointStatePlan  # the names' meaning
    joints: NDArray[np.void]  # (K,) of ``_JOINT``

    @classmethod
    def from_plan(cls, frame_id: str, plan: JointStatePlan) -> "_Known":
        state = Writer()
        state.leave_out(STAMP.stop - STAMP.start, 4)
        state.string(frame_id)
        state.u32(len(plan.names))
        for name in plan.names:
            state.string(name)
        state.u32(len(plan.names))
        block, mask = bytes(state.data[STAMP.stop :]), bytes(state.mask[STAMP.stop :])
        first = state.leave_out(0, 8)
        joints, message = _blank_message(plan)
        counts = len(plan.names), joints.ctypes.data, len(joints), plan.rows.ctypes.data
        layout = _Layout(block, mask, len(block), first, *counts, message, len(message))
        return cls(layout, (frame_id, plan.names), plan, joints)


def _blank_message(plan: JointStatePlan) -> tuple[NDArray[np.void], bytes]:
    """Return a plan's joints for the compiled call, and their TFMessage with blank numbers."""
    joints = np.zeros(len(plan.rows), _JOINT)
    joints["half_turn"], joints["column"] = plan.joints.half_turns, plan.columns
    joints["multiplier"], joints["offset"] = plan.multiplier, plan.offset
    joints["constant"], joints["sine"] = plan.joints.constant, plan.joints.sine
    joints["slide"] = plan.joints.slide
    message = Writer()
    message.u32(len(joints))
    for joint, parent, child in zip(joints, plan.parents, plan.children, strict=True):
        joint["stamp_at"] = message.leave_out(STAMP.stop - STAMP.start, 4)
        message.string(parent)
        message.string(child)
        joint["values_at"] = message.leave_out(8 * DOUBLES_PER_TRANSFORM, 8)
    return joints, bytes(message.data)


class _CompiledCall:
    """Creates the builtin and the layouts that it recognises."""

    def __init__(self, times: PublishedTimes) -> None:
        self._times = times
        self._state = _State(
            times.interval_ns,
            times.ignore_timestamp,
            times.newest_call.ctypes.data,
            times.stamps.ctypes.data,
        )
        self._known: list[_Known] = []
        self._next = 0

    def bind(self, otherwise: ConvertBytes) -> ConvertBytes:
        """Return the builtin, which calls ``otherwise`` for messages that it does not recognise."""
        library = load_library()
        library.onebot_state_converter.argtypes = [ctypes.py_object]
        library.onebot_state_converter.restype = ctypes.py_object
        address = ctypes.addressof(self._state)
        convert: ConvertBytes = library.onebot_state_converter((address, otherwise, self))
        return convert

    def learn(self, frame_id: str, plan: JointStatePlan) -> None:
        """Recognise messages of this frame and plan, which moves joints, from now on.

        The oldest of too many is forgotten.
        """
        if any(entry.key == (frame_id, plan.names) for entry in self._known):
            return
        entry = _Known.from_plan(frame_id, plan)
        if entry.layout.size > LARGEST_KEPT:
            return
        place = self._next % _KNOWN
        self._next += 1
        # Replace the layout before its memory may be freed.
        self._state.layouts[place] = entry.layout
        self._known[place : place + 1] = [entry]
        self._state.known = len(self._known)


class StateConverter:
    """Applies one robot's description to its joint states.

    Attributes:
        convert_bytes: ``convert_bytes(data, now_ns)`` turns a serialized JointState into a
            serialized TFMessage, or into None if nothing has to be published. ``now_ns`` is the
            node's clock, to detect that it was set back.
    """

    convert_bytes: ConvertBytes

    def __init__(
        self,
        model: RobotModel,
        *,
        frame_prefix: str = "",
        interval_ns: int = 0,
        ignore_timestamp: bool = False,
        warn: Warn = lambda _key, _text: None,
    ) -> None:
        """Convert for ``model``.

        Args:
            model: the robot.
            frame_prefix: prepended to every frame.
            interval_ns: minimum time between two publications of a joint; 0 for every message.
            ignore_timestamp: publish whatever the stamp is.
            warn: called with a key and a text about input that is ignored.
        """
        self._model, self._prefix, self._warn = model, frame_prefix, warn
        self._plans = functools.lru_cache(_KNOWN)(
            lambda names: JointStatePlan(model, names, frame_prefix)
        )
        self._times = PublishedTimes(len(model.joints), interval_ns, ignore_timestamp)
        self._compiled = _CompiledCall(self._times)
        self.convert_bytes = self._compiled.bind(self.convert_message)

    def static_transforms(self, stamp_ns: int, *, floating: bool = False) -> TFMessage:
        """Return the TFMessage of the joints that never move.

        Args:
            stamp_ns: stamp of the transforms, ns.
            floating: whether to include floating joints; usually another node, such as an odometry
                node, publishes them.
        """
        links, moved_by_others = self._model.fixed.children, self._model.floating
        rows = [row for row, link in enumerate(links) if floating or link not in moved_by_others]
        fixed = self._model.fixed.take(rows)
        parents = [self._prefix + parent for parent in fixed.parents]
        children = [self._prefix + child for child in fixed.children]
        return transforms_message(time_message(stamp_ns), parents, children, fixed.constant)

    def forget_times(self) -> None:
        """Start afresh, after the clock was set back."""
        self._times.forget()

    def convert_message(self, data: bytes, now_ns: int) -> bytes | None:
        """Do the same as ``convert_bytes`` through ordinary messages."""
        try:
            state = one_joint_state(data)
        except WireError as error:
            self._warn("bytes", f"joint state that cannot be read is ignored: {error}")
            return None
        # The stamp is kept unchanged, even if its nanoseconds are a second or more.
        seconds, nanoseconds = struct.unpack("<iI", data[STAMP])
        stamp = Time(sec=seconds, nanosec=nanoseconds)
        transforms = self._convert(state, stamp, now_ns)
        return None if transforms is None else bytes(serialize_message(transforms))

    def _convert(self, state: JointStateArrays, stamp: Time, now_ns: int) -> TFMessage | None:
        if len(state.names) != len(state.positions):
            names, positions = len(state.names), len(state.positions)
            text = f"joint state with {names} names but {positions} positions; ignored"
            self._warn("sizes" if positions else "empty", text)
            return None
        state = self._without_unusable(state)
        if not state.names:
            return None
        plan = self._plan(state.names)
        if not self._times.due(plan.rows, state.stamp_ns, now_ns, self._warn):
            return None
        self._compiled.learn(state.frame_id, plan)
        values = plan.transforms(state.positions)
        return transforms_message(stamp, plan.parents, plan.children, values)

    def _without_unusable(self, state: JointStateArrays) -> JointStateArrays:
        """Leave out joints whose positions give no finite transforms, with a warning."""
        # Without its own position, a joint may follow another, again without a finite transform.
        while not (usable := self._plan(state.names).usable(state.positions)).all():
            bad = {name for name, good in zip(state.names, usable, strict=True) if not good}
            text = f"positions that are not finite, or too large, are ignored: {listing(bad)}"
            self._warn("finite", text)
            kept = [name not in bad for name in state.names]
            names = tuple(itertools.compress(state.names, kept))
            state = state._replace(names=names, positions=state.positions[kept])
        return state

    def _plan(self, names: tuple[str, ...]) -> JointStatePlan:
        plans = self._plans if sum(map(len, names)) <= LARGEST_KEPT else self._plans.__wrapped__
        return plans(names)
