"""OneBot drives about for 30 s of simulated time: no gap, no leak, odometry that holds."""

import math
import random
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress

import numpy as np
import psutil
import pytest
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from sensor_msgs.msg import JointState

from onebot_description.geometry.poses import PlanarPose
from tests.ros_support import NodeProcess, Peer
from tests.support import wait_for

BRINGUP = "onebot_bringup.launch.onebot_bringup"
# In simulated time a slow machine makes it last longer, and nothing else.
WORDS = ("viewer:=none", "steer:=true", "port:=0")
SIMULATED = ("--ros-args", "-p", "use_sim_time:=true")
BEGIN, END = 10.0, 40.0  # s of simulated time; before, memory may grow
LONGEST_GAP = 0.5  # s of simulated time
MOST_GROWTH = {"memory": 8.0, "handles": 8.0, "threads": 4.0}  # memory in MB
LEAK = """
import os, threading, time
kept = []
while True:
    kept.append(b"x" * 1_000_000)
    os.dup(0)
    threading.Thread(target=time.sleep, args=(1e6,), daemon=True).start()
    time.sleep(0.1)
"""


class Drive:
    """Drives OneBot by random commands, as its odometry comes, and judges what it publishes."""

    def __init__(self, peer: Peer) -> None:
        self.problems: list[str] = []
        self.now = self.worst = self.driven = 0.0  # s, m and m
        self._chance, self._twist, self._next = random.Random(1), Twist(), 0.0
        self._stamps: dict[str, float] = {}
        self._odometry: dict[float, PlanarPose] = {}
        self._origins: tuple[PlanarPose, PlanarPose] | None = None
        self._last: PlanarPose | None = None
        self._commands = peer.publisher(Twist, "/velocity_controller/cmd_vel")
        for kind, topic, judge in (
            (JointState, "/joint_states", self._judge_joints),
            (Odometry, "/velocity_controller/odom", self._judge_odometry),
            (Odometry, "/velocity_controller/ground_truth", self._judge_truth),
        ):
            peer.node.create_subscription(
                kind, topic, lambda m, t=topic, j=judge: j(self._stamp(t, m), m), 1000
            )

    def _stamp(self, topic: str, message: Odometry | JointState) -> float:
        stamp = message.header.stamp.sec + message.header.stamp.nanosec * 1e-9
        step = stamp - self._stamps.get(topic, stamp)
        if not 0.0 <= step <= LONGEST_GAP:
            self.problems.append(f"{topic}: {step:.3f} s between two stamps, at {stamp:.3f}")
        self._stamps[topic] = self.now = stamp
        return stamp

    def _judge_joints(self, stamp: float, message: JointState) -> None:
        self._judge_numbers("/joint_states", [*message.position, *message.velocity])

    def _judge_odometry(self, stamp: float, message: Odometry) -> None:
        self._odometry[stamp] = self._pose(message)
        if stamp >= self._next:  # now and then none: the driver dies at full speed
            self._next = stamp + 4.0
            chance = self._chance
            self._twist.linear.x, self._twist.angular.z = (
                chance.uniform(-0.5, 0.5),
                chance.uniform(-1, 1),
            )
            self._silent = chance.random() < 0.3
        if not self._silent:
            self._commands.publish(self._twist)

    def _judge_truth(self, stamp: float, message: Odometry) -> None:
        truth, pose = self._pose(message), self._odometry.pop(stamp, None)
        if self._last is not None:
            self.driven += math.hypot(truth.x - self._last.x, truth.y - self._last.y)
        self._last = truth
        if pose is None:
            return
        self._origins = self._origins or (pose, truth)
        a, b = (o.inverse().compose(p) for o, p in zip(self._origins, (pose, truth), strict=True))
        error, turn = math.hypot(a.x - b.x, a.y - b.y), abs(math.remainder(a.yaw - b.yaw, math.tau))
        self.worst = max(self.worst, error)
        if error > 0.02 + 0.01 * self.driven or turn > 0.05:
            self.problems.append(f"odometry is off by {error:.3f} m, {turn:.3f} rad at {stamp:.3f}")

    def _pose(self, message: Odometry) -> PlanarPose:
        place, turn = message.pose.pose.position, message.pose.pose.orientation
        self._judge_numbers("odometry", [place.x, place.y, place.z, turn.z, turn.w])
        return PlanarPose(place.x, place.y, 2.0 * math.atan2(turn.z, turn.w))

    def _judge_numbers(self, topic: str, numbers: Sequence[float]) -> None:
        if not np.isfinite(numbers).all():
            self.problems.append(f"{topic}: NaN or infinite")


class Usage:
    """What processes use, sampled over time."""

    def __init__(self) -> None:
        self.times: dict[int, list[float]] = defaultdict(list)
        self.names: dict[int, str] = {}
        self._values: dict[tuple[int, str], list[float]] = defaultdict(list)

    def sample(self, processes: Sequence[psutil.Process]) -> None:
        for process in processes:
            with suppress(psutil.Error):
                used = {
                    "memory": process.memory_full_info().pss / 1e6,
                    "handles": float(process.num_fds()),
                    "threads": float(process.num_threads()),
                }
                self.names[process.pid] = " ".join(process.cmdline()[-3:])[:200]
                self.times[process.pid].append(time.monotonic())
                for kind, value in used.items():
                    self._values[process.pid, kind].append(value)

    def grown(self, pid: int) -> set[str]:
        """What has grown steadily: by the lower quartile of the slopes between its samples.

        A leak grows between nearly all samples, but not what grows once, or goes up and down.
        """
        times = np.array(self.times[pid])
        first, second = np.triu_indices(len(times), 1)
        return {
            kind
            for kind, most in MOST_GROWTH.items()
            if len(times) > 8
            and np.percentile(
                np.subtract.outer(values := np.array(self._values[pid, kind]), values)[
                    second, first
                ]
                / (times[second] - times[first]),
                25,
            )
            * (times[-1] - times[0])
            > most
        }


@contextmanager
def leaking() -> Iterator[psutil.Process]:
    """A process that leaks memory, handles and threads: the measure must find it."""
    child = subprocess.Popen([sys.executable, "-c", LEAK])
    try:
        yield psutil.Process(child.pid)
    finally:
        child.kill()
        child.wait()


@pytest.mark.slow
def test_driving_about(ros_domain: int) -> None:
    """Stamps without gaps, finite numbers, odometry on the truth, no process that grows."""
    usage = Usage()
    with Peer(ros_domain) as peer, NodeProcess(BRINGUP, *WORDS, *SIMULATED) as bringup:
        drive = Drive(peer)
        launcher = psutil.Process(bringup.process.pid)
        wait_for(lambda: drive.now > BEGIN, "the robot to drive")
        nodes = [launcher, *launcher.children(recursive=True)]
        with leaking() as leak:

            def arrived() -> bool:
                usage.sample([*nodes, leak])
                time.sleep(0.5)
                return drive.now > END

            wait_for(arrived, "the end of the drive")
        assert all(node.is_running() for node in nodes)
    assert not drive.problems, drive.problems[:5]
    assert drive.driven > 3.0
    assert usage.grown(leak.pid) == set(MOST_GROWTH)
    for node in nodes:
        assert not usage.grown(node.pid), usage.names[node.pid]
