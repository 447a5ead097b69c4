"""OneBots in one world as ``onebot_bringup robots:=N`` brings them up, all of them driven.

Each robot is commanded ten times a second, and the control cycles of one are counted. At the end
each must drive at the commanded speed, clear of the others.
"""

import time
from collections.abc import Callable
from functools import partial
from itertools import combinations
from math import hypot
from typing import Any, NamedTuple

from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from sensor_msgs.msg import JointState, LaserScan

from onebot_description.ros.wire.cdr import nanoseconds
from onebot_description.timing import NS_PER_S
from tests.benchmarks.measuring import WrongAnswer, bringup, command, median, rss_mb
from tests.benchmarks.report import Report, Result
from tests.ros_support import Peer
from tests.support import PATIENCE

_RATE, _SCANS = 100.0, 10.0  # Hz
_SPEED, _TOLERANCE = 0.2, 0.02  # m/s
_CLEAR = 0.3  # m between two robots, at least
_LEAST, _MOST = 0.99, 1000.0  # of real time, MB


class Window(NamedTuple):
    """What a fleet did."""

    pace: float  # of 100 cycles a second
    scans: float  # of those due
    rss: float  # MB


def run(quick: bool) -> Report:
    """Bring up fleets: with the viewer, without, and with lidars."""
    robots, rounds = (2, 1) if quick else (20, 3)
    fleets = [
        ("viewer none", ["viewer:=none"]),
        ("viewer web", ["viewer:=web"]),
        ("lidars", ["viewer:=none", "sensors_enabled:=true"]),
    ]
    results = []
    for what, words in fleets[-1:] if quick else fleets:  # the last one answers for the others
        windows = [_measure(robots, words, quick) for _ in range(rounds)]
        pace, scans, rss = (median(values) for values in zip(*windows, strict=True))
        name = f"{robots} robots, {what}:"
        results.append(Result(f"{name} of real time at 100 Hz", pace, at_least=_LEAST))
        if what == "lidars":
            results.append(Result(f"{name} scans of those due", scans, at_least=_LEAST))
        else:
            results.append(Result(f"{name} memory, RSS", rss, _MOST, unit="MB"))
    return results


def _measure(robots: int, words: list[str], quick: bool) -> Window:
    """Bring a fleet up, drive it, and look at what it does meanwhile.

    Raises:
        WrongAnswer: a robot does not drive as commanded.
    """
    lidars = "sensors_enabled:=true" in words
    names = [f"/robot{row + 1}" for row in range(robots)]
    with (
        bringup(f"robots:={robots}", "reload:=false", *words) as (domain, process),
        Peer(domain) as peer,
    ):
        topics = [f"{name}/velocity_controller/cmd_vel" for name in names]
        drive = partial(command, [peer.publisher(Twist, topic) for topic in topics], _SPEED)
        states = peer.hear(JointState, f"{names[-1]}/joint_states")
        scans: list[Any] = []
        for name in names if lidars else ():
            peer.node.create_subscription(LaserScan, f"{name}/scan", scans.append, 10, raw=True)
        drive(1.0 if quick else 2.0)
        _driving(domain, names, drive)
        states.clear()
        scans.clear()
        drive(1.0 if quick else 8.0)
        stamps, heard = [nanoseconds(state.header.stamp) for state in list(states)], len(scans)
        _check(_driving(domain, names, drive))
        simulated = (stamps[-1] - stamps[0]) / NS_PER_S
        return Window(
            (len(stamps) - 1) / simulated / _RATE,
            heard / (robots * _SCANS * simulated),
            rss_mb(process.process.pid),
        )


def _driving(domain: int, names: list[str], drive: Callable[[float], None]) -> dict[str, Odometry]:
    """Return the truth of all once they drive, slower than in real time if there are many."""
    deadline = time.monotonic() + PATIENCE
    while True:
        truths = _truths(domain, names, drive)
        if all(map(_drives, truths.values())) or time.monotonic() > deadline:
            return truths


def _truths(domain: int, names: list[str], drive: Callable[[float], None]) -> dict[str, Odometry]:
    """Return the truth of all; only now, as to receive all odometry takes time."""
    topic = "velocity_controller/ground_truth"
    with Peer(domain, "observer") as peer:
        heard = {name: peer.hear(Odometry, f"{name}/{topic}", 1) for name in names}
        while not all(heard.values()):
            drive(0.1)
    return {name: truths[-1] for name, truths in heard.items()}


def _drives(truth: Odometry) -> bool:
    # Slow motion shows in the speed, which is by the system's clock. No NaN passes.
    return _TOLERANCE < truth.twist.twist.linear.x <= _SPEED + _TOLERANCE


def _check(truths: dict[str, Odometry]) -> None:
    for name, truth in truths.items():
        if not _drives(truth):
            speed = truth.twist.twist.linear.x
            raise WrongAnswer(f"commanded {_SPEED:g} m/s, {name} drives at {speed:g}")
    places = {name: truth.pose.pose.position for name, truth in truths.items()}
    for (one, a), (other, b) in combinations(places.items(), 2):
        if not hypot(a.x - b.x, a.y - b.y) >= _CLEAR:
            raise WrongAnswer(f"{one} and {other} are in the same place, {a} and {b}")
