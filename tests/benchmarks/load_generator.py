"""Asks a node for transforms and times its answers; a process of its own beside the node's.

``python -m tests.benchmarks.load_generator JOINTS [CONSTANT]``: publishes joint states of a chain
(see chains.py), serialized beforehand, and checks every answer after each window; or, given a file
CONSTANT, that all answers are its bytes. Orders come as lines of JSON on standard input, of the
attributes of ``Order``; to each the results are a line on standard output, of those of ``Window``,
or ``{"wrong": ...}``. It ends when its input does.
"""

import gc
import json
import math
import sys
import time
from collections import deque
from dataclasses import asdict, dataclass, field
from pathlib import Path

import rclpy
from builtin_interfaces.msg import Time
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import serialize_message
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from onebot_description.description.packages import use_environment_prefix
from onebot_description.discovery import configure_discovery
from onebot_description.wire.tf_message import TFMessage
from tests.benchmarks.answers import AnswerChecker
from tests.benchmarks.chains import Chain, Floats
from tests.benchmarks.measuring import WrongAnswer, cpu_ns, percentile

_VARIANTS = 64
_STAMP = slice(4, 12)
_NANO = 1_000_000_000
_LOST_AFTER = 1.0  # seconds


@dataclass(frozen=True)
class Order:
    """The load to generate."""

    messages: int  # most joint states to send
    seconds: float  # most time to send them in
    in_flight: int = 4  # joint states that may be unanswered at a time
    rate: float = 0.0  # joint states a second at most; 0: without a pause
    pids: list[int] = field(default_factory=list)  # processes whose processor time counts


@dataclass(frozen=True)
class Window:
    """The results of one order."""

    answers: int  # received, each checked
    lost: int  # joint states that were not answered
    seconds: float  # from the first one sent to the last answer
    cpu_us: float  # of the processes for each answer
    own_cpu_us: float  # of this process, likewise
    p50_us: float  # latency that half of the answers do not exceed
    p99_us: float  # likewise, 99 %
    worst_error: float  # the largest error of a number


class LoadGenerator(Node):
    """Sends and receives; see the module's docstring."""

    def __init__(self, joints: int, constant: bytes | None) -> None:
        super().__init__("load_generator")
        chain = Chain(joints)
        positions = chain.positions(_VARIANTS)
        self._constant = constant
        self._checker = AnswerChecker(chain, positions)
        messages = [joint_state(chain, row, 0) for row in positions]
        self._heads = [message[: _STAMP.start] for message in messages]
        self._tails = [message[_STAMP.stop :] for message in messages]
        # Stamps count up from here, so that each also numbers its message.
        self._base = self._sent = time.time_ns()
        self._outstanding: deque[tuple[int, int]] = deque()
        self._answers: list[tuple[int, bytes]] = []
        self._latencies: list[int] = []
        self._lost = 0
        self._order = Order(0, 0.0)
        self._left, self._until = 0, 0
        self._answered: Future = Future()
        self._publisher = self.create_publisher(JointState, "joint_states", QoSProfile(depth=10))
        self.create_subscription(TFMessage, "/tf", self._receive, QoSProfile(depth=100), raw=True)
        self._executor = EventsExecutor()
        self._executor.add_node(self)

    def wait_until_answered(self, timeout: float = 60.0) -> None:
        """Send now and then until an answer comes, and let those under way come in.

        Raises:
            WrongAnswer: none came.
        """
        deadline = time.monotonic() + timeout
        while not self._latencies:
            if time.monotonic() > deadline:
                raise WrongAnswer(
                    f"within {timeout:g} s no answer with the stamp of a joint state that was sent"
                )
            self._send()
            self._spin(0.05)
        while self._outstanding and time.monotonic() < deadline:
            before = len(self._latencies)
            self._spin(0.3)
            if len(self._latencies) == before:
                break

    def run(self, order: Order) -> Window:
        """Carry out ``order``.

        Raises:
            WrongAnswer: an answer is not what it has to be.
        """
        self._outstanding.clear()
        self._answers, self._latencies, self._lost = [], [], 0
        self._order, self._left = order, order.messages
        gc.collect()
        gc.disable()
        cpu, own, began = cpu_ns(*order.pids), time.process_time_ns(), time.perf_counter_ns()
        self._until = began + round(order.seconds * _NANO)
        (self._paced if order.rate else self._closed_loop)()
        took = time.perf_counter_ns() - began
        own, cpu = time.process_time_ns() - own, cpu_ns(*order.pids) - cpu
        gc.enable()
        count = len(self._latencies)
        self._check()
        return Window(
            count,
            self._lost,
            took / _NANO,
            _share(cpu, count),
            _share(own, count),
            percentile(self._latencies, 50.0) / 1e3,
            percentile(self._latencies, 99.0) / 1e3,
            self._checker.worst,
        )

    def _closed_loop(self) -> None:
        """Keep so many in flight; each answer sends the next joint state (see ``_receive``)."""
        self._refill()
        while self._outstanding:
            before = len(self._latencies)
            self._answered = Future()
            self._executor.spin_until_future_complete(self._answered, _LOST_AFTER)
            if len(self._latencies) == before and self._outstanding:
                self._give_up()
                self._refill()

    def _paced(self) -> None:
        """Send one at a time, each when it is due."""
        due, step = time.perf_counter_ns(), round(_NANO / self._order.rate)
        while self._may_send():
            self._left -= 1
            self._send()
            sent = time.perf_counter_ns()
            while self._outstanding:
                self._spin(_LOST_AFTER)
                if time.perf_counter_ns() > sent + _LOST_AFTER * _NANO:
                    self._give_up()
            due = max(due + step, time.perf_counter_ns())
            time.sleep(max(0.0, (due - time.perf_counter_ns()) / _NANO))

    def _spin(self, timeout: float) -> None:
        """Spin until the next answer, at most for ``timeout`` seconds."""
        self._answered = Future()
        self._executor.spin_until_future_complete(self._answered, timeout)

    def _refill(self) -> None:
        while len(self._outstanding) < self._order.in_flight and self._may_send():
            self._left -= 1
            self._send()

    def _may_send(self) -> bool:
        return self._left > 0 and time.perf_counter_ns() < self._until

    def _give_up(self) -> None:
        self._lost += len(self._outstanding)
        self._outstanding.clear()

    def _send(self) -> None:
        self._sent += 1
        variant = self._sent % _VARIANTS
        seconds, nanoseconds = divmod(self._sent, _NANO)
        stamp = seconds.to_bytes(4, "little") + nanoseconds.to_bytes(4, "little")
        message = b"".join((self._heads[variant], stamp, self._tails[variant]))
        self._outstanding.append((self._sent, time.perf_counter_ns()))
        self._publisher.publish(message)

    def _receive(self, data: bytes) -> None:
        now = time.perf_counter_ns()
        outstanding = self._outstanding
        if not outstanding:
            return  # of an earlier window
        if self._constant is None:
            # The first transform's, behind the encapsulation and the count.
            stamp = int.from_bytes(data[8:12], "little") * _NANO
            stamp += int.from_bytes(data[12:16], "little")
            if stamp < outstanding[0][0]:
                return
            while outstanding and outstanding[0][0] < stamp:
                outstanding.popleft()
                self._lost += 1
            if not outstanding:
                return
        # Constant bytes carry no stamp: they answer what was sent first.
        number, sent = outstanding.popleft()
        self._latencies.append(now - sent)
        self._answers.append((number, data))
        if not self._order.rate and self._left:
            self._refill()
        if self._order.rate or not outstanding:
            if not self._answered.done():
                self._answered.set_result(None)

    def _check(self) -> None:
        for number, data in self._answers:
            if self._constant is None:
                self._checker.check(data, number % _VARIANTS, number)
            elif data != self._constant:
                raise WrongAnswer("the relay did not send the bytes it was given")
        self._answers = []


def joint_state(chain: Chain, positions: Floats, stamp_ns: int) -> bytes:
    """Return a serialized JointState of a chain at ``positions``, (N,)."""
    sec, nanosec = divmod(stamp_ns, _NANO)
    header = Header(stamp=Time(sec=sec, nanosec=nanosec))
    message = JointState(header=header, name=chain.joints, position=positions.tolist())
    return bytes(serialize_message(message))


def constant_answer(joints: int) -> bytes:
    """Return a serialized TFMessage of the size that a chain's answers have."""
    from geometry_msgs.msg import TransformStamped

    chain = Chain(joints)
    return bytes(
        serialize_message(
            TFMessage(
                transforms=[
                    TransformStamped(
                        header=Header(stamp=Time(sec=1), frame_id=parent), child_frame_id=child
                    )
                    for parent, child in zip(chain.links[:-1], chain.links[1:], strict=True)
                ]
            )
        )
    )


def _share(nanoseconds: int, count: int) -> float:
    return nanoseconds / count / 1e3 if count else math.nan


def main() -> int:
    """Carry out orders until there are no more; returns the exit code."""
    joints = int(sys.argv[1])
    constant = Path(sys.argv[2]).read_bytes() if len(sys.argv) > 2 else None
    use_environment_prefix()
    configure_discovery()
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    generator = LoadGenerator(joints, constant)
    try:
        generator.wait_until_answered()
        print(json.dumps({"ready": True}), flush=True)
        for line in sys.stdin:
            print(json.dumps(asdict(generator.run(Order(**json.loads(line))))), flush=True)
    except WrongAnswer as error:
        print(json.dumps({"wrong": str(error)}), flush=True)
    except KeyboardInterrupt:
        pass
    finally:
        generator.destroy_node()
        rclpy.try_shutdown()
    return 0


if __name__ == "__main__":
    sys.exit(main())
