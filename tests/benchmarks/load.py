"""Asks a node for transforms, times its answers and checks them."""

import gc
import time
from collections import deque
from typing import NamedTuple

import numpy as np
import rclpy
from rclpy.experimental import EventsExecutor
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message, serialize_message
from rclpy.task import Future
from sensor_msgs.msg import JointState

from onebot_description.ros.discovery import configure_discovery
from onebot_description.ros.wire.interfaces import TFMessage
from onebot_description.timing import NS_PER_S
from tests.benchmarks.chains import Chain, Floats
from tests.benchmarks.measuring import WrongAnswer, cpu_ns, median
from tests.ros_support import NodeProcess
from tests.support import PATIENCE

_VARIANTS = 64  # sets of positions
_IN_FLIGHT = 4  # joint states that may be unanswered at a time
_LOST_AFTER = 1.0  # s
_MOST_LOST = 0.001
_STAMP = slice(4, 12)  # of a serialized JointState
_NO_STAMP = b"\xff" * 8  # seconds before 1970 and too many nanoseconds: none that a node sends
_TOLERANCE = 1e-9  # of quaternions and meters; what double precision leaves is some 1e-15


class Window(NamedTuple):
    """Measurements of one window of time."""

    cpu_us: float  # of the node's process for each answer
    p50_us: float  # latency that half of the answers do not exceed


class Answers:
    """Checks serialized TFMessages against a chain's transforms.

    Reading is left to rclpy's own deserialisation, which shares nothing with the project's. What
    differs from a correct answer by nothing but its stamps is correct, too.
    """

    def __init__(self, chain: Chain, positions: Floats) -> None:
        self._frames, self._expected = chain.frames, chain.transforms(positions)
        self._correct: dict[int, bytes] = {}  # by row of the positions, with _NO_STAMP

    def check(self, data: bytes, row: int, stamp_ns: int) -> None:
        """Check the answer to positions ``row``, sent with ``stamp_ns``.

        Raises:
            WrongAnswer: frames, stamp or a number are wrong.
        """
        unstamped = data.replace(_stamp(stamp_ns), _NO_STAMP)
        if self._correct.get(row) != unstamped:
            self._read(data, row, divmod(stamp_ns, NS_PER_S))
            self._correct[row] = unstamped

    def _read(self, data: bytes, row: int, stamp: tuple[int, int]) -> None:
        transforms = deserialize_message(data, TFMessage).transforms
        frames = [(each.header.frame_id, each.child_frame_id) for each in transforms]
        if sorted(frames) != sorted(self._frames):
            raise WrongAnswer(f"it has the frames {frames[:5]}..., not {self._frames[:5]}...")
        expected = dict(zip(self._frames, self._expected[row], strict=True))
        for frame, each in zip(frames, transforms, strict=True):
            if (each.header.stamp.sec, each.header.stamp.nanosec) != stamp:
                raise WrongAnswer(f"{frame} is not stamped as the joint state was")
            xyz, q = each.transform.translation, each.transform.rotation
            pose = np.array([xyz.x, xyz.y, xyz.z, q.x, q.y, q.z, q.w])
            pose[3:] *= np.sign(pose[3:] @ expected[frame][3:])  # q and -q are the same rotation
            error = np.abs(pose - expected[frame]).max()
            if not error <= _TOLERANCE:  # lets no NaN pass
                raise WrongAnswer(f"{frame} is off by {error:.3g}")


class Load:
    """Sends joint states of a chain to the node of a domain, so many in flight; a context.

    ``constant``: the bytes that a relay answers with, which carry no stamp.
    """

    def __init__(
        self, domain: int, node: NodeProcess, chain: Chain, constant: bytes | None = None
    ) -> None:
        self._process, self._constant = node, constant
        positions = chain.positions(_VARIANTS)
        self._checker = Answers(chain, positions)
        self._messages = [bytearray(joint_state(chain, row)) for row in positions]
        # Stamps count up from here, so that each also numbers its message.
        self._sent = time.time_ns()
        self._unanswered: deque[tuple[int, int]] = deque()  # stamp, and when it was sent
        self._answers: list[tuple[int, bytes]] = []
        self._latencies: list[int] = []
        self._lost, self._until = 0, 0
        self._answered: Future = Future()
        configure_discovery()
        self._context = rclpy.Context()
        rclpy.init(context=self._context, domain_id=domain, args=[])
        self._node = rclpy.create_node(f"load_{domain}", context=self._context)
        self._publisher = self._node.create_publisher(JointState, "joint_states", 10)
        self._node.create_subscription(
            TFMessage, "/tf", self._receive, QoSProfile(depth=100), raw=True
        )
        self._executor = EventsExecutor(context=self._context)
        self._executor.add_node(self._node)

    def __enter__(self) -> "Load":
        return self

    def __exit__(self, *_: object) -> None:
        self._executor.remove_node(self._node)
        self._node.destroy_node()
        rclpy.shutdown(context=self._context)

    def wait(self) -> None:
        """Send now and then until an answer comes, and let those under way come in.

        Raises:
            WrongAnswer: none came.
        """
        deadline = time.monotonic() + PATIENCE
        while not self._latencies:
            if time.monotonic() > deadline or self._process.process.poll() is not None:
                raise WrongAnswer(f"no answer to a joint state; it said: {self._process.output}")
            self._send()
            self._spin(0.05)
        while self._unanswered:
            count = len(self._latencies)
            self._spin(0.3)
            if len(self._latencies) == count:
                break

    def measure(self, seconds: float) -> Window:
        """Send for so long, after some to get warm.

        Raises:
            WrongAnswer: an answer was wrong, or too many were lost.
        """
        self._window(seconds / 5.0)
        return self._window(seconds)

    def _window(self, seconds: float) -> Window:
        self._unanswered.clear()
        self._answers, self._latencies, self._lost = [], [], 0
        gc.collect()
        gc.disable()
        try:
            cpu = cpu_ns(self._process.process.pid)
            self._until = time.perf_counter_ns() + round(seconds * NS_PER_S)
            self._refill()
            while self._unanswered:
                count = len(self._latencies)
                self._spin(_LOST_AFTER)
                if len(self._latencies) == count:
                    self._lost += len(self._unanswered)
                    self._unanswered.clear()
                    self._refill()
            cpu = cpu_ns(self._process.process.pid) - cpu
        finally:
            gc.enable()
        count = len(self._latencies)
        if self._lost > _MOST_LOST * (count + self._lost):
            raise WrongAnswer(f"{self._lost} of {count + self._lost} joint states got no answer")
        for number, data in self._answers:
            if self._constant is None:
                self._checker.check(data, number % _VARIANTS, number)
            elif data != self._constant:
                raise WrongAnswer("the relay did not send the bytes it was given")
        return Window(1e-3 * cpu / count, 1e-3 * median(self._latencies))

    def _spin(self, timeout: float) -> None:
        """Spin until everything is answered, at most for ``timeout`` seconds."""
        self._answered = Future()
        self._executor.spin_until_future_complete(self._answered, timeout)

    def _refill(self) -> None:
        while len(self._unanswered) < _IN_FLIGHT and time.perf_counter_ns() < self._until:
            self._send()

    def _send(self) -> None:
        self._sent += 1
        message = self._messages[self._sent % _VARIANTS]
        message[_STAMP] = _stamp(self._sent)
        self._unanswered.append((self._sent, time.perf_counter_ns()))
        self._publisher.publish(bytes(message))

    def _receive(self, data: bytes) -> None:
        now = time.perf_counter_ns()
        if self._constant is None and self._unanswered:
            # The first transform's, behind the encapsulation and the count.
            stamp = int.from_bytes(data[8:12], "little") * NS_PER_S
            stamp += int.from_bytes(data[12:16], "little")
            if stamp < self._unanswered[0][0]:
                return
            while self._unanswered and self._unanswered[0][0] < stamp:
                self._unanswered.popleft()
                self._lost += 1
        if not self._unanswered:
            return  # to a joint state that was given up
        # Constant bytes carry no stamp: they answer what was sent first.
        number, sent = self._unanswered.popleft()
        self._latencies.append(now - sent)
        self._answers.append((number, data))
        self._refill()
        if not self._unanswered and not self._answered.done():
            self._answered.set_result(None)


def joint_state(chain: Chain, positions: Floats) -> bytes:
    """Return a serialized JointState of a chain at ``positions``, (N,), without a stamp."""
    return bytes(serialize_message(JointState(name=chain.joints, position=positions.tolist())))


def _stamp(nanoseconds: int) -> bytes:
    return b"".join(part.to_bytes(4, "little") for part in divmod(nanoseconds, NS_PER_S))
