"""Nodes in lockstep with a Simulation, in its process: how fast they are, and whether runs differ.

Their floor is real time; goals are scaled as in ``from_python``. A busy computer may make a run
slow, but not another one; nor may a node of another process that subscribes to the same topics.
``python -m tests.benchmarks.lockstep RUNS`` makes only these runs, as many of each kind, and prints
where they end, so that they can be made in parts.
"""

import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack, contextmanager
from functools import partial
from multiprocessing import get_context

from nav_msgs.msg import Odometry
from rclpy.node import Node
from sensor_msgs.msg import JointState

from onebot_bringup.launcher.orphans import die_with_this_thread
from onebot_control import Simulation
from onebot_description.ros.domains import used_domain
from tests.benchmarks.measuring import BARE_STEP, WrongAnswer, bare_step, fastest
from tests.benchmarks.report import Report, Result
from tests.onebot_control.test_lockstep import Stopper, TimedStopper
from tests.orphans import end_with_this_process

_MAZE = {"world": "maze", "y": 0.8, "sensors": True}
_BUSY_LOOPS, _WORKERS = 8, 4
_PACE, _PACE_OF_THREE = 20.0, 12.0  # times real time, at least, on the computer of the goals
_PERIOD = 0.1  # s of simulated time: one scan
_ROUNDS = 20
_NEAREST = 0.3  # m, from the lidar to the wall at the end


class _Log(Node):
    """Logs where the robot is, 50 times a second."""

    def __init__(self) -> None:
        super().__init__("log")
        self._last: Odometry | None = None
        self.rows: list[tuple[int, float]] = []
        self.create_subscription(Odometry, "velocity_controller/odom", self._on_odometry, 10)
        self.create_timer(0.02, self._log)

    def _on_odometry(self, odometry: Odometry) -> None:
        self._last = odometry

    def _log(self) -> None:
        if self._last is not None:
            position = self._last.pose.pose.position
            self.rows.append((self.get_clock().now().nanoseconds, position.x))


class _Estimator(Node):
    """Estimates a pose by odometry, 50 times a second, and joint states, 100 times a second."""

    def __init__(self) -> None:
        super().__init__("estimator")
        self._turned = 0.0
        self._estimates = self.create_publisher(Odometry, "estimate", 10)
        self.create_subscription(JointState, "joint_states", self._on_joints, 10)
        self.create_subscription(Odometry, "velocity_controller/odom", self._on_odometry, 10)

    def _on_joints(self, joints: JointState) -> None:
        self._turned = joints.position[0]

    def _on_odometry(self, odometry: Odometry) -> None:
        odometry.pose.pose.position.z = 0.05 * self._turned
        self._estimates.publish(odometry)


def run(quick: bool) -> Report:
    """Measure the pace, and count the runs that end alike."""
    results: list[Result] = []
    for what, nodes, wanted in (
        ("by scans", (Stopper,), _PACE),
        ("by scans, with a log and an estimator", (Stopper, _Log, _Estimator), _PACE_OF_THREE),
    ):
        pace, bare_step = _pace(nodes, *((0.5, 1) if quick else (5.0, 6)))
        goal = round(wanted * BARE_STEP / bare_step, 1)
        results.append(Result(f"{what}, lidar, maze: times real time", pace, at_least=goal))
    return [*results, *(_loaded(0.2, 2, 0) if quick else _loaded(3.0, 500, _BUSY_LOOPS))]


def _loaded(seconds: float, runs: int, loops: int) -> Iterator[Result]:
    """Count the runs beside busy loops that end as one without them does."""
    for what, node in (("by scans", Stopper), ("by a timer", TimedStopper)):
        with used_domain():
            alone = _outcome(node, seconds)
        with _busy(loops):
            outcomes = _outcomes(node, seconds, runs)
        print(f"{what}: x, y, yaw, ahead: {alone}", file=sys.stderr)
        text = (
            f"{what}: equal outcomes of {runs} beside {loops} busy loops and a foreign subscriber"
        )
        yield Result(text, outcomes.count(alone), at_least=runs)


def _pace(nodes: Sequence[type[Node]], seconds: float, runs: int) -> tuple[float, float]:
    """Return the pace by the fastest periods of all runs, and what a bare step of OneBot took, s.

    The computer's speed changes in the meantime, so that bare steps are taken in turn.
    """
    taken, steps = list[float](), list[float]()
    for _ in range(runs):
        with Simulation() as bare:
            bare.run(1.0)
            steps += [bare_step(bare, time.perf_counter) for _ in range(_ROUNDS)]
        with used_domain(), Simulation(**_MAZE) as simulation:
            simulation.ros().add(*(node() for node in nodes))
            for _ in range(round(seconds / _PERIOD)):
                began = time.perf_counter()
                simulation.run(_PERIOD)
                taken.append(time.perf_counter() - began)
    return _PERIOD / fastest(taken), fastest(steps)


def _outcome(kind: type[Stopper], seconds: float) -> tuple[float, ...]:
    """Return where the robot is after so long, all its digits."""
    with Simulation(**_MAZE) as simulation:
        simulation.ros().add(kind())
        simulation.run(seconds)
        pose, ahead = simulation.robot.pose, simulation.robot.distance_ahead()
    if not ahead > _NEAREST:
        raise WrongAnswer(f"the robot is {ahead:g} m before the wall")
    return pose.x, pose.y, pose.yaw, ahead


_FOREIGN = """
from contextlib import suppress
import rclpy
from nav_msgs.msg import Odometry
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import LaserScan
rclpy.init()
node = Node("foreign")
for kind, topic in (Clock, "/clock"), (LaserScan, "scan"), (Odometry, "velocity_controller/odom"):
    node.create_subscription(kind, topic, lambda _: None, 10)
with suppress(ExternalShutdownException):
    rclpy.spin(node)
"""
_worker = ExitStack()  # ends with the worker


def _start_worker() -> None:
    """Begin a worker's life in a domain of its own, with a subscriber in another process."""
    _worker.enter_context(used_domain())
    command = [sys.executable, "-c", _FOREIGN]
    subprocess.Popen(command, preexec_fn=die_with_this_thread())


def _outcomes(kind: type[Stopper], seconds: float, runs: int) -> list[tuple[float, ...]]:
    """Return where the robot is after each run; some processes share the runs."""
    context = get_context("spawn")
    with ProcessPoolExecutor(min(runs, _WORKERS), context, _start_worker) as pool:
        return list(pool.map(partial(_outcome, kind), [seconds] * runs))


@contextmanager
def _busy(count: int) -> Iterator[None]:
    """Busy loops beside."""
    command = [sys.executable, "-c", "while True: pass"]
    loops = [subprocess.Popen(command, preexec_fn=die_with_this_thread()) for _ in range(count)]
    try:
        yield
    finally:
        for loop in loops:
            loop.kill()
            loop.wait()


if __name__ == "__main__":
    end_with_this_process()
    for result in _loaded(3.0, int(sys.argv[1]), _BUSY_LOOPS):
        print(f"{result.what}: {result.measured:g}", flush=True)
