"""What one list of joint names means for one robot, worked out once and then reused."""

from collections import OrderedDict
from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from onebot_description.model import RobotModel
from onebot_description.tf.kernel import MODERATE, Motion, make_kernel
from onebot_description.tf.wire import STAMP, Floats, TfTemplate

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
