"""Jitter of the control loop at 100 Hz: with and without the viewer, with and without sensors.

velocity_controller runs as it always does, beside robot_state_publisher, while it is commanded.
The floor is a thread that sleeps to the same grid beside an rclpy node. All are measured in turn,
each started afresh in a ROS domain of its own (timed_loop.py).
"""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from sensor_msgs.msg import Image, LaserScan

from onebot_description.description import load_description
from onebot_description.ros.domains import used_domain
from tests.benchmarks.measuring import (
    MODEL,
    WrongAnswer,
    bringup,
    command,
    cpu_ns,
    in_turn,
    median,
    percentile,
)
from tests.benchmarks.report import Report, Result
from tests.ros_support import NodeProcess, Peer
from tests.support import PATIENCE

_RATE = 100.0
_SPEED, _TOLERANCE = 0.2, 0.01  # m/s
_MOST_JITTER = 1000.0  # us
_MEASURABLE = 1.1
_SETTLED = 2.0  # s


class Window(NamedTuple):
    """Measurements of one start, microseconds."""

    p50: float  # by how much half of the cycles began late at most
    p99: float
    cpu: float  # processor time of the process for each cycle


def run(quick: bool) -> Report:
    """Measure all in turn."""
    with TemporaryDirectory() as folder:
        urdf = Path(folder) / "onebot.urdf"
        urdf.write_text(load_description(MODEL, {"sensors_enabled": "true"}).urdf)
        controller = ["controller", str(urdf), "--ros-args", "-p", "world:=maze"]
        variants: dict[str, Callable[[], Window]] = {
            "floor": lambda: _measure(used_domain(), ["sleep"], quick),
            "alone": lambda: _measure(_beside("none"), ["controller"], quick),
            "viewed": lambda: _measure(_beside("web"), ["controller"], quick),
            "unheard": lambda: _measure(used_domain(), controller, quick),
            "heard": lambda: _measure(used_domain(), controller, quick, subscribed=True),
        }
        if quick:  # the other two answer for them
            del variants["alone"], variants["unheard"]
        windows = in_turn(variants, 1 if quick else 5)
    # Not the rounds' ratios: two starts have no more in common for being in the same round.
    middle = {
        name: Window(*(median(values) for values in zip(*starts, strict=True)))
        for name, starts in windows.items()
    }
    viewed, heard = middle["viewed"], middle["heard"]
    alone, unheard = middle.get("alone", viewed), middle.get("unheard", heard)
    return [
        Result("p99 jitter of a bare sleeping thread", middle["floor"].p99, unit="us"),
        Result("p99 jitter with the viewer on", viewed.p99, _MOST_JITTER, unit="us"),
        Result("CPU per cycle, viewer on over off", viewed.cpu / alone.cpu, _MEASURABLE),
        Result("p50 jitter, viewer on over off", viewed.p50 / alone.p50, _MEASURABLE),
        Result("p99 jitter, sensors subscribed to", heard.p99, _MOST_JITTER, unit="us"),
        Result("p99 jitter, sensors subscribed to over not", heard.p99 / unheard.p99, 1.5),
    ]


@contextmanager
def _beside(viewer: str) -> Iterator[int]:
    """The domain of a bringup without its simulation."""
    words = ["sim:=false", "joint_states:=false", "fixed_frame:=odom", f"viewer:={viewer}"]
    with bringup(*words) as (domain, _):
        yield domain


def _measure(
    surroundings: Any, words: Sequence[str], quick: bool, *, subscribed: bool = False
) -> Window:
    """Start a loop in a domain, command it, and read what it has recorded.

    Raises:
        WrongAnswer: it left out cycles, or the robot did not drive as commanded.
    """
    with TemporaryDirectory() as folder:
        file = Path(folder) / "times"
        with ExitStack() as stack:
            domain = stack.enter_context(surroundings)
            loop = stack.enter_context(
                NodeProcess("tests.benchmarks.timed_loop", str(file), *words)
            )
            peer = stack.enter_context(Peer(domain))
            if subscribed:
                images = "camera/image_raw", "camera/depth/image_raw"
                for kind, topic in ((LaserScan, "scan"), *((Image, name) for name in images)):
                    peer.node.create_subscription(kind, topic, lambda data: None, 10, raw=True)
            drives = words[0] == "controller"
            publisher = peer.publisher(Twist, "/velocity_controller/cmd_vel")
            drive = partial(command, [publisher], _SPEED)
            odometry = peer.hear(Odometry, "/velocity_controller/odom", 1)
            if drives:
                _reach(drive, odometry)
            drive(0.0 if quick else _SETTLED)
            pid = loop.process.pid
            begin, cpu = time.monotonic(), cpu_ns(pid)
            drive(1.0 if quick else 6.0)
            end, cpu = time.monotonic(), cpu_ns(pid) - cpu
            if drives:
                _reach(drive, odometry)
        cycles = np.frombuffer(file.read_bytes()).reshape(-1, 3)
    cycles = cycles[(begin <= cycles[:, 0]) & (cycles[:, 0] < end)]
    due, late, left_out = cycles.T
    seconds = due[-1] - due[0] - left_out[1:].sum() if len(due) else 0.0
    if not len(due) > 0.98 * _RATE * seconds > 0.0:
        raise WrongAnswer(f"the loop ran {len(due)} times in {seconds:g} s, less what it left out")
    return Window(1e6 * median(late), 1e6 * percentile(late, 99), 1e-3 * cpu / len(due))


def _reach(drive: Callable[[float], None], odometry: list[Odometry]) -> None:
    """Drive until the speed is reached; where commands come late, the robot has braked."""
    speed, deadline = float("nan"), time.monotonic() + PATIENCE
    while not abs(speed - _SPEED) <= _TOLERANCE:
        if time.monotonic() > deadline:
            raise WrongAnswer(f"told to go at {_SPEED:g} m/s, the robot went at {speed:g}")
        drive(0.1)
        if odometry:
            speed = odometry[-1].twist.twist.linear.x
