"""Where the numbers lie in a serialized JointState.

Between two messages of one publisher only the stamp and the numbers differ: the block from the
frame_id to the number of positions is compared as bytes with that of messages before.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from onebot_description.model import RobotModel
from onebot_description.tf.joint_state_plan import JointStatePlan, RecentlyUsed
from onebot_description.tf.marking import MarkingReader
from onebot_description.tf.wire import ENCAPSULATION, STAMP, WireError

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
