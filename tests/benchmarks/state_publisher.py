"""robot_state_publisher under load, beside the least that any rclpy node needs.

The floor is a relay (relay.py) that parses nothing and sends constant bytes of the same size, on
the events executor; beside it the same on the SingleThreadedExecutor, a node that builds message
objects (naive_publisher.py). Each node is a process of its own in a ROS domain of its own and has a
load generator (load_generator.py) of its own; they are measured in turn, while the others are idle.
"""

import json
import select
import shlex
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from onebot_description.errors import OneBotError
from tests.benchmarks.chains import Chain
from tests.benchmarks.load_generator import Order, Window, constant_answer
from tests.benchmarks.measuring import (
    Running,
    WrongAnswer,
    cpu_ns,
    in_turn,
    median,
    ros_domain,
    rss_bytes,
)
from tests.benchmarks.report import Goal, Options, Report, at_most

OURS, FLOOR = "robot_state_publisher", "relay, events executor (the floor)"
SLOW_FLOOR, NAIVE = "relay, SingleThreadedExecutor", "naive rclpy node"
CLOSED_LOOP, PACED = "closed loop", "100 Hz"
_IN_FLIGHT = 4
_RATE = 100.0
# Joints to the most CPU per message allowed, over the floor's.
_GOALS = {10: 1.25, 50: 1.3, 200: 1.4, 1000: 2.0}
_LATENCY_GOAL = 1.2
# Answers are kept until the window's end and then all checked.
_KEPT_BYTES = 300_000_000
_BYTES_PER_JOINT = 100
# Joint states are best effort: more than fit in the middleware's shared memory would be lost.
_SEGMENT = 500_000
_BYTES_PER_POSITION = 28
_MOST_LOST = 0.001


class Subject:
    """A node under load: its process, and its load generator's."""

    def __init__(self, node: Running, generator: Running) -> None:
        self.node = node
        self._generator = generator

    def interrupt(self) -> None:
        """Interrupt both, without waiting for their end."""
        self._generator.interrupt()
        self.node.interrupt()

    def wait(self) -> None:
        """Wait until the node answers.

        Raises:
            WrongAnswer: it does not.
            OneBotError: it ended.
        """
        self._read()

    def measure(self, order: Order) -> Window:
        """Have it answer; the processor time is that of all the node's processes.

        Raises:
            WrongAnswer: an answer was wrong, or too many were lost.
        """
        assert self._generator.process.stdin is not None
        order = Order(**{**asdict(order), "pids": self.node.pids})
        print(json.dumps(asdict(order)), file=self._generator.process.stdin, flush=True)
        window = Window(**self._read())
        if window.lost > _MOST_LOST * (window.answers + window.lost):
            raise WrongAnswer(
                f"{window.lost} of {window.answers + window.lost} got no answer with its stamp"
            )
        return window

    def rss(self) -> int:
        """Memory of the node's process in bytes; of several, of that which did the work."""
        return rss_bytes(max(self.node.pids, key=cpu_ns))

    def _read(self) -> dict[str, Any]:
        output = self._generator.process.stdout
        assert output is not None
        while not select.select([output], [], [], 0.2)[0]:
            self.node.check()
        line = output.readline()
        self.node.check()
        if not line:
            self._generator.process.wait()
            self._generator.check()
        result: dict[str, Any] = json.loads(line)
        if "wrong" in result:
            raise WrongAnswer(str(result["wrong"]))
        return result


class Measured(NamedTuple):
    """Measurements of one node under one load, a number a round."""

    windows: list[Window]
    rss: int

    def median(self, name: str) -> float:
        """The middle one of an attribute of the windows."""
        return median([getattr(window, name) for window in self.windows])

    def over(self, floor: "Measured", name: str) -> float:
        """The middle one of the ratios to the floor's window of the same round."""
        pairs = zip(self.windows, floor.windows, strict=True)
        return median([getattr(ours, name) / getattr(other, name) for ours, other in pairs])


@dataclass(frozen=True)
class Effort:
    """How long to measure."""

    rounds: int  # of each load
    messages: int  # in a window of the closed loop, at most
    seconds: float  # that a window takes, at most


def run(options: Options) -> Report:
    """Measure chains of 10 to 1000 joints."""
    # Many rounds: by which processor wakes which, a window of the relay's as of ours has one of two
    # latencies, at 1000 joints 270 or 360 us, all through.
    effort = Effort(1, 40, 0.3) if options.quick else Effort(21, 20_000, 0.5)
    counts = (10, 50) if options.quick else tuple(_GOALS)
    rows: list[dict[str, str | int | float | None]] = []
    goals: list[Goal] = []
    worst = 0.0
    for joints in counts:
        results = measure(joints, commands(), effort, options)
        for load, nodes in results.items():
            rows += [_row(joints, load, name, node, nodes[FLOOR]) for name, node in nodes.items()]
            worst = max([worst, *(max(n.windows, key=_error).worst_error for n in nodes.values())])
        goals += _goals(joints, results[CLOSED_LOOP])
    notes = [
        f"Every answer was checked: the largest error of a number is {worst:.1e}. Closed loop: "
        f"{_IN_FLIGHT} messages in flight. CPU is of the node's process with all its threads; "
        "ratios are medians of those to the floor's window of the same round.",
    ]
    return Report("state_publisher", rows, goals, notes)


def measure(
    joints: int,
    names: Mapping[str, str],
    effort: Effort,
    options: Options,
    loads: Sequence[str] = (CLOSED_LOOP, PACED),
) -> dict[str, dict[str, Measured]]:
    """Measure some nodes with a chain of ``joints``.

    Args:
        joints: in the chain.
        names: the nodes; name to command, see ``commands``.
        effort: how long to measure.
        options: how to report progress.
        loads: under which.

    Returns:
        Of each load each node's results.
    """
    with ExitStack() as stack:
        options.say(f"state_publisher: starting {len(names)} nodes for {joints} joints")
        files = stack.enter_context(_files(joints))
        subjects = {
            name: _start(stack, name, command, joints, files) for name, command in names.items()
        }
        for name, subject in subjects.items():
            with _blamed(name, joints):
                subject.wait()
        results: dict[str, dict[str, Measured]] = {}
        for load in loads:
            options.say(f"state_publisher: {joints} joints, {load}, {effort.rounds} rounds")
            windows = _windows(subjects, joints, load, effort)
            results[load] = {
                name: Measured(windows[name], subject.rss()) for name, subject in subjects.items()
            }
        return results


def commands() -> dict[str, str]:
    """Return the nodes that are measured, name to command.

    ``{file}`` and ``{answer}`` in a command stand for files, see ``_files``.
    """
    python = shlex.quote(sys.executable)
    relay = f"{python} -m tests.benchmarks.relay {{answer}}"
    return {
        FLOOR: f"{relay} events",
        OURS: f"{python} -m onebot_description.robot_state_publisher {{file}}",
        SLOW_FLOOR: f"{relay} single",
        NAIVE: f"{python} -m tests.benchmarks.naive_publisher {{file}}",
    }


def _windows(
    subjects: Mapping[str, Subject], joints: int, load: str, effort: Effort
) -> dict[str, list[Window]]:
    kept = _KEPT_BYTES // (_BYTES_PER_JOINT * joints)
    fitting = max(1, _SEGMENT // (_BYTES_PER_POSITION * joints))
    order = Order(min(effort.messages, kept), effort.seconds, min(_IN_FLIGHT, fitting))
    if load == PACED:
        order = Order(kept, effort.seconds, 1, _RATE)
    warm_up = Order(max(1, order.messages // 20), effort.seconds / 5.0, order.in_flight, order.rate)

    def one(name: str) -> Window:
        with _blamed(name, joints):
            subjects[name].measure(warm_up)
            return subjects[name].measure(order)

    return in_turn({name: partial(one, name) for name in subjects}, effort.rounds)


@contextmanager
def _files(joints: int) -> Iterator[dict[str, str]]:
    """What the commands read: the URDF, and the relay's answer."""
    with tempfile.TemporaryDirectory() as folder:
        file, answer = Path(folder) / "a.urdf", Path(folder) / "answer"
        file.write_text(Chain(joints).urdf())
        answer.write_bytes(constant_answer(joints))
        yield {"file": str(file), "answer": str(answer)}


def _start(
    stack: ExitStack, name: str, command: str, joints: int, files: Mapping[str, str]
) -> Subject:
    environment = stack.enter_context(ros_domain())
    words = shlex.split(command)
    for placeholder, file in files.items():
        words = [word.replace(f"{{{placeholder}}}", file) for word in words]
    node = stack.enter_context(Running(words, environment, name=name))
    constant = [files["answer"]] if name in (FLOOR, SLOW_FLOOR) else []
    module = [sys.executable, "-m", "tests.benchmarks.load_generator"]
    generator = Running(
        [*module, str(joints), *constant], environment, name="load generator", pipes=True
    )
    return Subject(node, stack.enter_context(generator))


@contextmanager
def _blamed(name: str, joints: int) -> Iterator[None]:
    """Name the node in its errors."""
    try:
        yield
    except OneBotError as error:
        raise type(error)(f"{name}, {joints} joints: {error}") from None


def _row(
    joints: int, load: str, name: str, node: Measured, floor: Measured
) -> dict[str, str | int | float | None]:
    return {
        "Joints": joints,
        "Load": load,
        "Node": name,
        "CPU us/message": node.median("cpu_us"),
        "over floor": node.over(floor, "cpu_us"),
        "messages/s": float(np.median([w.answers / w.seconds for w in node.windows])),
        "p50 us": node.median("p50_us"),
        "p50 over floor": node.over(floor, "p50_us"),
        "p99 us": node.median("p99_us"),
        "RSS MB": node.rss / 1e6,
    }


def _goals(joints: int, nodes: Mapping[str, Measured]) -> list[Goal]:
    if joints not in _GOALS:
        return []
    ours, floor = nodes[OURS], nodes[FLOOR]
    return [
        at_most(
            f"{joints} joints, closed loop: CPU per message over the floor",
            ours.over(floor, "cpu_us"),
            _GOALS[joints],
        ),
        at_most(
            f"{joints} joints, closed loop: p50 latency over the floor",
            ours.over(floor, "p50_us"),
            _LATENCY_GOAL,
        ),
    ]


def _error(window: Window) -> float:
    return window.worst_error
