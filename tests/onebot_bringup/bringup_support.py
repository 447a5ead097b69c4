"""Listens to a bringup as another program would, and finds every process that it started."""

import math
from collections.abc import Callable

from onebot_description.elements.packages import use_environment_prefix
from onebot_description.ros.wire.interfaces import TFMessage
from tests.ros_support import LATCHED, Peer
from tests.support import RunningProcess, wait_for


class Transforms(Peer):
    """A program of the user's own that receives /tf and /tf_static."""

    def __init__(self, domain: int) -> None:
        use_environment_prefix()
        super().__init__(domain, "listener")
        self.latest: dict[str, tuple[float, float]] = {}
        for topic, qos in (("/tf", 10), ("/tf_static", LATCHED)):
            self.node.create_subscription(TFMessage, topic, self._on_tf, qos)

    def _on_tf(self, message: TFMessage) -> None:
        for stamped in message.transforms:
            transform = stamped.transform
            self.latest[stamped.child_frame_id] = (transform.translation.z, transform.rotation.z)

    def of(self, frame: str) -> tuple[float, float] | None:
        """Return the latest height (m) and rotation.z of ``frame``, None if never received."""
        return self.latest.get(frame)

    def turned_to(self, angle: float, frame: str) -> Callable[[], bool]:
        """Return a condition: ``frame`` stands at ``angle`` rad about z."""

        def condition() -> bool:
            found = self.of(frame)
            return found is not None and abs(found[1] - math.sin(angle / 2)) < 1e-3

        return condition


def wait_for_robot(
    running: RunningProcess, transforms: Transforms, frame: str
) -> tuple[float, float]:
    """Wait for the first transform, but not if the command has given up."""

    def condition() -> tuple[float, float] | None:
        assert running.process.poll() is None, running.err
        return transforms.of(frame)

    found = wait_for(condition, "the first transform")
    assert found is not None
    return found
