"""Jitter of the control loop at 100 Hz, and the latency from a command to the wheels.

velocity_controller runs as it always does, beside robot_state_publisher, with the viewer and
without; timed_controller.py measures it. The floor is a thread that sleeps to the same grid beside
an rclpy node (sleeping_thread.py), and receives the same commands. All are measured in turn, each
started afresh in a ROS domain of its own.
"""

import sys
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from functools import partial
from typing import Any, NamedTuple

from tests.benchmarks.commander import PAUSES
from tests.benchmarks.lines import Lines
from tests.benchmarks.measuring import (
    Running,
    WrongAnswer,
    cpu_ns,
    in_turn,
    median,
    percentile,
    ros_domain,
)
from tests.benchmarks.report import Options, Report, Value, at_most

FLOOR, ALONE = "bare sleeping thread", "controller, viewer off"
VIEWED = "controller, viewer on"
_TOPIC = "/velocity_controller/cmd_vel"
_RATE = 100.0
_HOLD = 0.2  # m/s, that the robot must reach
_TOLERANCE = 0.01  # m/s
_TRIES = 20  # to hold that speed
_MOST_JITTER = 1000.0  # us
_MEASURABLE = 1.1
_IDLE = 500.0  # us, of the bare thread's p99; on a machine with nothing else to do it is less
_SETTLED = 2.0  # s


class Effort(NamedTuple):
    """How much to measure."""

    seconds: float
    # Of commands that a later one overtook before the next cycle, or that came after the window; on
    # a busy machine there is no saying how many.
    most_overtaken: float


class Window(NamedTuple):
    """Measurements of one start."""

    late_us: list[float]  # that each cycle began late, microseconds
    latency_us: list[float]  # from each command's sending until its velocity was set on the wheels
    cpu_us: float  # processor time of the process for each cycle
    left_out_ms: float  # time in which cycles were left out


def run(options: Options) -> Report:
    """Measure the three in turn."""
    rounds, effort = options.choose(9, 1), Effort(1.0, 1.0) if options.quick else Effort(6.0, 0.02)
    options.say(f"control_loop: {rounds} rounds of {effort.seconds:g} s for each of three")
    variants: dict[str, Callable[[], Window]] = {
        FLOOR: partial(_floor, effort),
        ALONE: partial(_controller, effort, "none"),
        VIEWED: partial(_controller, effort, "web"),
    }
    windows = in_turn(variants, rounds)
    jitter = median([percentile(window.late_us, 99) for window in windows[VIEWED]])
    goals = [
        at_most("p99 jitter with the viewer on", jitter, _MOST_JITTER, "us"),
        # What the viewer costs the loop: of nothing, a machine that is never the same shows this.
        at_most("CPU per cycle, viewer on over off", _over(windows, _cpu), _MEASURABLE),
        at_most("p50 jitter, viewer on over off", _over(windows, _usual_jitter), _MEASURABLE),
    ]
    notes = [
        "Jitter: how late a cycle begins. Latency: from the sending of a Twist, at any moment, to "
        "the cycle that commands the wheels; half a period, 5 ms, is waiting for that cycle. "
        f"All commands arrived, and the robot drove as commanded, {_HOLD:g} m/s."
    ]
    least = median([percentile(window.late_us, 99) for window in windows[FLOOR]])
    if least > _IDLE and not options.quick:
        notes.append(
            f"The machine was not idle, as the goal wants it: even the bare thread's p99 was "
            f"{least:.0f} us, and the controller's with the viewer {jitter / least:.2f} times that."
        )
    rows = [_row(name, each) for name, each in windows.items()]
    return Report("control_loop", rows, goals, notes)


def _cpu(window: Window) -> float:
    return window.cpu_us


def _usual_jitter(window: Window) -> float:
    return percentile(window.late_us, 50)


def _over(windows: Mapping[str, Sequence[Window]], value: Callable[[Window], float]) -> float:
    """With the viewer over without it, as the table's rows have them.

    Not the rounds' ratios: two starts have no more in common for being in the same round.
    """
    viewed, alone = (median(list(map(value, windows[name]))) for name in (VIEWED, ALONE))
    return viewed / alone


def _floor(effort: Effort) -> Window:
    with ExitStack() as stack:
        environment = stack.enter_context(ros_domain())
        return _measure(stack, "sleeping_thread", [_TOPIC], environment, effort)


def _controller(effort: Effort, viewer: str) -> Window:
    with ExitStack() as stack:
        environment = stack.enter_context(ros_domain())
        for display in ("DISPLAY", "WAYLAND_DISPLAY"):
            environment.pop(display, None)  # no browser is to be opened
        words = ["sim:=false", "joint_states:=false", "fixed_frame:=odom", f"viewer:={viewer}"]
        module = "onebot_bringup.launch.onebot_bringup"
        stack.enter_context(Running([sys.executable, "-m", module, *words], environment))
        window, speed = _measured(stack, "timed_controller", [], environment, effort, drives=True)
        # Unlike >, this lets no NaN pass.
        if not abs(speed - _HOLD) <= _TOLERANCE:
            raise WrongAnswer(f"the robot was told to go at {_HOLD:g} m/s, and went at {speed:g}")
        return window


def _measure(
    stack: ExitStack, module: str, words: Sequence[str], environment: dict[str, str], effort: Effort
) -> Window:
    return _measured(stack, module, words, environment, effort)[0]


def _measured(
    stack: ExitStack,
    module: str,
    words: Sequence[str],
    environment: dict[str, str],
    effort: Effort,
    *,
    drives: bool = False,
) -> tuple[Window, float]:
    """Start a loop, command it; return what came of it, and its last speed."""
    python = [sys.executable, "-m"]
    command = [*python, f"tests.benchmarks.{module}", *words]
    node = stack.enter_context(Running(command, environment, name=module, pipes=True))
    commander = stack.enter_context(
        Running([*python, "tests.benchmarks.commander", _TOPIC], environment, pipes=True)
    )
    loop, orders = Lines(node), Lines(commander)
    orders.next(node)  # it has found the loop
    while not loop.ask({}, node)["late"]:
        time.sleep(0.1)
    time.sleep(_SETTLED)
    loop.ask({}, node)
    began = cpu_ns(node.process.pid)
    sent = orders.ask({"seconds": effort.seconds, "hold": _HOLD}, node)
    spent = cpu_ns(node.process.pid) - began
    seen = loop.ask({}, node)
    speed = float(seen["speed"])
    for _ in range(_TRIES if drives else 0):
        # On a busy machine commands come late, and the robot has braked.
        if abs(speed - _HOLD) <= _TOLERANCE:
            break
        orders.ask({"seconds": 0.0, "hold": _HOLD}, node)
        speed = float(loop.ask({}, node)["speed"])
    latencies = _latencies(sent, seen["told"], effort.most_overtaken, seen["left_out"])
    _check_count(len(seen["late"]), seen["left_out"], sent)
    window = Window(
        [1e6 * late for late in seen["late"]],
        [1e6 * latency for latency in latencies],
        1e-3 * spent / len(seen["late"]),
        1e3 * seen["left_out"],
    )
    return window, speed


def _latencies(
    sent: Sequence[Any], told: Sequence[Any], most_overtaken: float, left_out: float
) -> list[float]:
    """Seconds from each command to the wheels.

    While the machine leaves cycles out, for ``left_out`` seconds, commands overtake each other.

    Raises:
        WrongAnswer: too many never reached them, or one did before it was sent.
    """
    arrived = dict(map(tuple, told))
    latencies = [arrived[command] - at for command, at in sent if command in arrived]
    lost = len(sent) - len(latencies)
    bearable = max(1.0, most_overtaken * len(sent)) + left_out / PAUSES[0]
    if not latencies or lost > bearable:
        raise WrongAnswer(f"{lost} of {len(sent)} commands never reached the wheels")
    if min(latencies) < 0.0:
        raise WrongAnswer("a command reached the wheels before it was sent")
    return latencies


def _check_count(cycles: int, left_out: float, sent: Sequence[Any]) -> None:
    """Refuse a loop that did not run a hundred times a second."""
    least = _RATE * (sent[-1][1] - sent[0][1] - left_out) * 0.98
    if cycles < least:
        raise WrongAnswer(f"the loop ran {cycles} times, and should have at least {least:.0f}")


def _row(name: str, windows: Sequence[Window]) -> dict[str, Value]:
    def middle(percent: float, field: str) -> float:
        return median([percentile(getattr(window, field), percent) for window in windows])

    return {
        "Loop": name,
        "jitter p50 us": middle(50, "late_us"),
        "jitter p99 us": middle(99, "late_us"),
        "worst us": max(max(window.late_us) for window in windows),
        "latency p50 ms": 1e-3 * middle(50, "latency_us"),
        "latency p99 ms": 1e-3 * middle(99, "latency_us"),
        "CPU us/cycle": median([window.cpu_us for window in windows]),
        "left out ms": sum(window.left_out_ms for window in windows),
    }
