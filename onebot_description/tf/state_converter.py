"""JointState in, transforms out: robot_state_publisher's rules without ROS.

The hot path takes the bytes of a JointState and returns the bytes of a TFMessage: where its numbers
lie is known from messages before (layouts.py), and the answer is a template whose numbers are
overwritten. Where the library is built, the usual message never comes here (compiled_path.py).
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from onebot_description.model import RobotModel
from onebot_description.tf.compiled_path import make_compiled_path
from onebot_description.tf.joint_state_plan import JointStatePlan
from onebot_description.tf.kernel import all_moderate
from onebot_description.tf.layouts import Layouts
from onebot_description.tf.published_times import PublishedTimes, Warn
from onebot_description.tf.wire import (
    STAMP,
    Floats,
    JointStateArrays,
    TfTemplate,
    WireError,
    pack_stamp,
    unpack_stamp,
)


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
