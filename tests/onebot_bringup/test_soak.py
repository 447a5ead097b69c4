"""OneBot drives about for 28 s of simulated time: no gap, no leak."""

import random
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import partial

import numpy as np
import psutil
import pytest
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from sensor_msgs.msg import JointState

from tests.ros_support import NodeProcess, Peer
from tests.support import wait_for

BRINGUP = "onebot_bringup.launch.onebot_bringup"
# In simulated time a slow machine makes it last longer, and nothing else.
WORDS = ("viewer:=none", "steer:=true", "port:=0")
SIMULATED = ("--ros-args", "-p", "use_sim_time:=true")
BEGIN, END = 8.0, 28.0  # s of simulated time; before, memory may grow
LONGEST_GAP = 0.5  # s of simulated time
MOST_GROWTH = {"memory": 5.0, "handles": 5.0, "threads": 3.0}  # memory in MB
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
    """Drives OneBot by random commands, as its odometry comes, and looks for gaps."""

    def __init__(self, peer: Peer) -> None:
        self.problems: list[str] = []
        self.now = self.driven = 0.0  # s and m
        self._chance, self._twist, self._next = random.Random(1), Twist(), 0.0
        self._stamps: dict[str, float] = {}
        self._commands = peer.publisher(Twist, "/velocity_controller/cmd_vel")
        peer.node.create_subscription(
            JointState, "/joint_states", lambda message: self._step("/joint_states", message), 1000
        )
        odometry = "/velocity_controller/odom"
        peer.node.create_subscription(Odometry, odometry, partial(self._drive, odometry), 1000)

    def _step(self, topic: str, message: Odometry | JointState) -> float:
        """The time since the message before, s."""
        stamp = message.header.stamp.sec + message.header.stamp.nanosec * 1e-9
        step = stamp - self._stamps.get(topic, stamp)
        if not 0.0 <= step <= LONGEST_GAP:
            self.problems.append(f"{topic}: {step:.3f} s between two stamps, at {stamp:.3f}")
        self._stamps[topic] = self.now = stamp
        return step

    def _drive(self, topic: str, message: Odometry) -> None:
        self.driven += abs(message.twist.twist.linear.x) * self._step(topic, message)
        if self.now >= self._next:  # now and then none: the driver dies at full speed
            self._next = self.now + 4.0
            self._twist.linear.x = self._chance.uniform(-0.5, 0.5)
            self._twist.angular.z = self._chance.uniform(-1, 1)
            self._silent = self._chance.random() < 0.3
        if not self._silent:
            self._commands.publish(self._twist)


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
def test_driving_about(peer: Peer) -> None:
    """Stamps without gaps, no process that grows."""
    usage = Usage()
    with NodeProcess(BRINGUP, *WORDS, *SIMULATED) as bringup:
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
    assert drive.driven > 2.0
    assert usage.grown(leak.pid) == set(MOST_GROWTH)
    for node in nodes:
        assert not usage.grown(node.pid), usage.names[node.pid]
