"""JointState in, transforms out: robot_state_publisher's rules without ROS.

The hot path takes the bytes of a JointState and returns the bytes of a TFMessage. Between two
messages of one publisher only the stamp and the numbers differ: the block from the frame_id to the
last joint name is compared as bytes with that of the message before, the positions are viewed in
place, and the answer is a template whose numbers are overwritten.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from onebot_description.model import RobotModel
from onebot_description.stamps import NANO
from onebot_description.tf.joint_state_plan import JointStatePlan, LastPublished, RecentlyUsed
from onebot_description.tf.kernel import all_moderate
from onebot_description.tf.wire import (
    ENCAPSULATION,
    STAMP,
    Floats,
    JointStateArrays,
    Reader,
    TfTemplate,
    WireError,
    pack_stamp,
)

_NAMES_START = 12
# Publishers of one topic, times the subsets of joints each sends; more only costs time.
_KEPT_LAYOUTS = 64

Warn = Callable[[str, str], None]


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


class _Layout(NamedTuple):
    """Where the positions lie behind one particular block of names."""

    block: bytes
    text: NDArray[np.intp]
    first: int
    names: tuple[str, ...]
    counted: bytes
    counted_at: int
    plan: JointStatePlan

    def same_text(self, data: bytes) -> bool:
        """Whether ``data`` differs from the block in padding only, whose bytes are arbitrary."""
        end = _NAMES_START + len(self.block)
        if len(data) < end:
            return False
        theirs = np.frombuffer(data, np.uint8, len(self.block), _NAMES_START)
        ours = np.frombuffer(self.block, np.uint8)
        return bool((theirs[self.text] == ours[self.text]).all())


class StateConverter:
    """Applies one robot's description to its joint states.

    Attributes:
        interval_ns: least time between two publications of a joint; 0 for every message.
        ignore_timestamp: publish whatever the stamp says.
    """

    def __init__(
        self,
        model: RobotModel,
        *,
        frame_prefix: str = "",
        interval_ns: int = 0,
        ignore_timestamp: bool = False,
        warn: Warn = lambda _key, _text: None,
    ) -> None:
        """Serve ``model``; ``warn(key, text)`` is told of input that is passed over."""
        self._model = model
        self._prefix = frame_prefix
        self.interval_ns = interval_ns
        self.ignore_timestamp = ignore_timestamp
        self._warn = warn
        self._plans: RecentlyUsed[JointStatePlan] = RecentlyUsed(_KEPT_LAYOUTS)
        self._layouts: RecentlyUsed[_Layout] = RecentlyUsed(_KEPT_LAYOUTS)
        self._layout: _Layout | None = None
        self._last = LastPublished(len(model.joints))
        self._newest_call = 0

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
        self._last.forget()

    def convert_bytes(self, data: bytes, now_ns: int) -> bytes | None:
        """Turn a serialized JointState into a serialized TFMessage.

        Args:
            data: plain little-endian CDR.
            now_ns: the node's clock, to notice that it was set back.

        Returns:
            None when nothing is to be published.

        Raises:
            WireError: the bytes are of another encoding, or broken.
        """
        layout = self._layout_of(data)
        if data[layout.counted_at : layout.counted_at + 4] != layout.counted:
            reader = Reader(data)
            reader.offset = layout.counted_at
            self._complain_of_sizes(len(layout.names), reader.u32())
            return None
        count = len(layout.names)
        if count == 0:
            return None
        if layout.first + 8 * count > len(data):
            raise WireError("truncated positions")
        stamp = data[STAMP]
        seconds = int.from_bytes(stamp[:4], "little", signed=True)
        stamp_ns = seconds * NANO + int.from_bytes(stamp[4:], "little")
        plan = layout.plan
        if not (plan.moderate and all_moderate(data, layout.first, count)):
            positions = np.frombuffer(data, "<f8", count, layout.first)
            state = JointStateArrays(stamp_ns, "", layout.names, positions, positions, positions)
            result = self.convert(state, now_ns)
            return None if result is None else result.serialized()
        if not self._due(plan, stamp_ns, now_ns):
            return None
        return plan.message(data, layout.first, count)

    def convert(self, state: JointStateArrays, now_ns: int) -> Transforms | None:
        """Do the same for a JointState that was deserialised; the result is equal bit by bit."""
        names, positions = state.names, state.positions
        if len(names) != len(positions):
            self._complain_of_sizes(len(names), len(positions))
            return None
        usable = self._plan(names).usable(positions) if names else np.empty(0, bool)
        if not usable.all():
            bad = [name for name, good in zip(names, usable, strict=True) if not good]
            self._complain_of_positions(bad, np.isfinite(positions[~usable]))
            names = tuple(name for name in names if name not in bad)
            positions = positions[[name not in bad for name in state.names]]
        if not names:
            return None
        plan = self._plan(names)
        if not self._due(plan, state.stamp_ns, now_ns):
            return None
        return Transforms(plan, plan.transforms(positions), pack_stamp(state.stamp_ns))

    def _due(self, plan: JointStatePlan, stamp_ns: int, now_ns: int) -> bool:
        """Whether the throttle lets a message pass; if so, note it as published."""
        if now_ns < self._newest_call:
            self._warn("clock", "the clock was set back; publishing the joints' transforms afresh")
            self._last.forget()
        self._newest_call = now_ns
        if len(plan.rows) == 0:
            return False
        if not self.ignore_timestamp:
            if stamp_ns == 0:
                self._warn(
                    "stamp",
                    "joint states with stamp 0 are not published: set header.stamp, or the "
                    "parameter ignore_timestamp to true",
                )
                return False
            if stamp_ns < self._last.oldest(plan) + self.interval_ns:
                return False
        self._last.record(plan, stamp_ns)
        return True

    def _layout_of(self, data: bytes) -> _Layout:
        if not data.startswith(ENCAPSULATION[:2]):
            raise WireError("not plain little-endian CDR")
        layout = self._layout
        if layout is not None:
            if data.startswith(layout.block, _NAMES_START):
                return layout
            if layout.same_text(data):
                block = data[_NAMES_START : _NAMES_START + len(layout.block)]
                self._layout = layout._replace(block=block)
                return self._layout
        self._layout = self._parse_layout(data)
        return self._layout

    def _parse_layout(self, data: bytes) -> _Layout:
        reader = Reader(data)
        reader.stamp_ns()
        text: list[int] = []

        def string() -> str:
            reader.align(4)
            start = reader.offset
            value = reader.string()
            text.extend(range(start - _NAMES_START, reader.offset - _NAMES_START))
            return value

        key = [string()]
        count_at = reader.offset + -reader.offset % 4
        text.extend(range(count_at - _NAMES_START, count_at + 4 - _NAMES_START))
        names = tuple(string() for _ in range(reader.count(4)))
        reader.align(4)
        counted_at = reader.offset
        reader.u32()
        reader.align(8)

        def make() -> _Layout:
            return _Layout(
                data[_NAMES_START:counted_at],
                np.array(text, np.intp),
                reader.offset,
                names,
                len(names).to_bytes(4, "little"),
                counted_at,
                self._plan(names),
            )

        return self._layouts.obtain((*key, names), make)

    def _plan(self, names: tuple[str, ...]) -> JointStatePlan:
        return self._plans.obtain(names, lambda: JointStatePlan(self._model, names, self._prefix))

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
