"""From the command to the first messages, and the memory of all that was started.

A listener in a process of its own, started before, prints when the first message was received. The
floor is an rclpy node with PyBullet loaded that publishes an Odometry (empty_node.py). Commands are
started in turn, each in a ROS domain of its own. Their bytecode is compiled before, as pip does it.
"""

import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import NamedTuple

from tests.benchmarks.lines import Lines
from tests.benchmarks.measuring import (
    Running,
    WrongAnswer,
    in_turn,
    median,
    process_tree,
    ros_domain,
    rss_bytes,
)
from tests.benchmarks.recorded import frames_logged
from tests.benchmarks.report import Options, Report, Value, at_most

FLOOR, OURS, VIEWED = "empty rclpy node with PyBullet", "onebot_bringup", "with viewer"
_ODOM = "/velocity_controller/odom"
_TOPICS = ("/tf:tf2_msgs/TFMessage", f"{_ODOM}:nav_msgs/Odometry")
_BASE = ("odom", "base_link")
_WHEELS = ("left_wheel", "right_wheel", "caster_base2", "caswheel")
_BRINGUP = [sys.executable, "-m", "onebot_bringup.launch.onebot_bringup", "viewer:=none"]
_GOAL = 1.5
_MOST_MEMORY = 250.0  # MB
_SETTLED = 2.0  # s after the first messages, when memory is looked at


class Start(NamedTuple):
    """One start of a command."""

    odom: float  # s to the first message on odom
    # Seconds to the first message on /tf, to the wheels' transforms, and to the first frame in the
    # recording; None where there is none.
    tf: float | None
    wheels: float | None
    logged: float | None
    rss: float  # MB resident in all processes; what they share counts for each
    pss: float  # MB, what they share counted once


def run(options: Options) -> Report:
    """Start the commands in turn."""
    rounds = options.choose(9, 1)
    options.say(f"startup: {rounds} starts of each command")
    settled = 0.0 if options.quick else _SETTLED
    with tempfile.TemporaryDirectory() as folder:
        compiled = {"PYTHONPYCACHEPREFIX": folder, "PYTHONDONTWRITEBYTECODE": ""}
        floor = [sys.executable, "-m", "tests.benchmarks.empty_node", _ODOM]
        variants: dict[str, Callable[[], Start]] = {
            FLOOR: partial(_start, floor, compiled, settled, whole=False),
            OURS: partial(_start, _BRINGUP, compiled, settled),
            VIEWED: partial(_start_viewed, compiled, settled),
        }
        if not options.quick:
            in_turn(variants, 1)
        starts = in_turn(variants, rounds)
    ours, least = starts[OURS], [start.odom for start in starts[FLOOR]]
    goals = [
        at_most(f"first {what} over the floor's first message", _over(ours, name, least), _GOAL)
        for what, name in (("/odom", "odom"), ("/tf", "tf"))
    ]
    memory = median([start.rss for start in ours])
    goals.append(at_most("onebot_bringup without viewer, RSS", memory, _MOST_MEMORY, "MB"))
    notes = [
        "Seconds from the command until a subscriber that ran before it received the message; the "
        "middle one of all starts. RSS is that of all processes, the launcher's too, added up: "
        "what they share, such as Python and ROS, counts for each. PSS counts it once, and so is "
        "the memory that really is used. With viewer: into a recording, and until a frame is in it."
    ]
    return Report("startup", [_row(name, starts[name], least) for name in starts], goals, notes)


def _start_viewed(compiled: Mapping[str, str], settled: float) -> Start:
    with tempfile.TemporaryDirectory() as folder:
        recording = Path(folder) / "start.rrd"
        return _start([*_BRINGUP, f"save:={recording}"], compiled, settled, recording)


def _start(
    command: Sequence[str],
    compiled: Mapping[str, str],
    settled: float,
    recording: Path | None = None,
    *,
    whole: bool = True,
) -> Start:
    """Start a command, time its first messages, and end it.

    Args:
        command: to start.
        compiled: variables that say where its bytecode is.
        settled: s to wait before looking at its memory.
        recording: a file it will write; None for none.
        whole: it is a robot with /tf, not the floor.
    """
    with ExitStack() as stack:
        environment = {**stack.enter_context(ros_domain()), **compiled}
        words = [sys.executable, "-m", "tests.benchmarks.listener", *_TOPICS]
        listener = stack.enter_context(Running(words, environment, name="listener", pipes=True))
        lines = Lines(listener)
        lines.next(listener)
        began = time.monotonic()
        node = stack.enter_context(Running(command, environment))
        heard = _hear(lines, node, whole)
        first = {frame: at - began for frame, at in heard.items()}
        logged = None
        if recording is not None:
            file = recording
            node.wait_for(lambda: frames_logged(file), "the first frame in the recording")
            logged = time.monotonic() - began
            everything = {*_WHEELS, "base_link"}
            node.wait_for(lambda: everything <= frames_logged(file), "all links in the recording")
        time.sleep(settled)
        node.check()
        pids = process_tree(node.process.pid)
        memory = rss_bytes(*pids) / 1e6, pss_bytes(*pids) / 1e6
        of_tf = [at for (topic, _), at in first.items() if topic == "/tf"]
        wheels = [first[("/tf", name)] for name in _WHEELS] if whole else []
        return Start(
            first[(_ODOM, "base_link")],
            min(of_tf, default=None),
            max(wheels, default=None),
            logged,
            *memory,
        )


def _hear(lines: Lines, node: Running, whole: bool) -> dict[tuple[str, str], float]:
    """Wait for the first messages; return when each topic's child frame came.

    Raises:
        WrongAnswer: the messages are not those of the robot.
        OneBotError: the command ended, or publishes nothing.
    """
    wanted = {(_ODOM, "base_link")}
    if whole:
        wanted |= {("/tf", name) for name in (*_WHEELS, "base_link")}
    heard: dict[tuple[str, str], float] = {}
    while not wanted <= set(heard):
        line = lines.next(node)
        if not line["finite"]:
            raise WrongAnswer(f"{line['topic']} holds numbers that are not finite")
        for parent, child in line["frames"]:
            if (child == "base_link") != ((parent, child) == _BASE):
                raise WrongAnswer(f"{line['topic']} says {parent} -> {child}")
            heard[line["topic"], child] = line["at"]
    return heard


def pss_bytes(*pids: int) -> int:
    """Memory of processes in bytes, what several share divided among them."""
    total = 0
    for pid in pids:
        lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
        total += next(1024 * int(line.split()[1]) for line in lines if line.startswith("Pss:"))
    return total


def _middle(starts: Sequence[Start], name: str) -> float | None:
    values = [getattr(start, name) for start in starts]
    return None if None in values else median(values)


def _over(starts: Sequence[Start], name: str, floor: Sequence[float]) -> float:
    """The middle one of the ratios to the floor's start of the same round."""
    return median([getattr(one, name) / other for one, other in zip(starts, floor, strict=True)])


def _row(name: str, starts: Sequence[Start], floor: Sequence[float]) -> dict[str, Value]:
    return {
        "Command": name,
        "first /odom s": _middle(starts, "odom"),
        "over floor": _over(starts, "odom", floor),
        "first /tf s": _middle(starts, "tf"),
        "all of /tf s": _middle(starts, "wheels"),
        "first frame logged s": _middle(starts, "logged"),
        "RSS MB": _middle(starts, "rss"),
        "PSS MB": _middle(starts, "pss"),
    }
