"""OneBot drives about for 20 s of simulated time, in half of them: no gap, no leak."""

import itertools
import math
import time
from collections import defaultdict

import numpy as np
import psutil
import pytest
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from sensor_msgs.msg import JointState

from onebot_description.ros.wire.cdr import nanoseconds
from tests.ros_support import NodeProcess, Peer
from tests.support import wait_for

BRINGUP = "onebot_bringup.launch.onebot_bringup"
# In simulated time a slow machine makes it last longer, and nothing else.
WORDS = ("viewer:=none", "steer:=true", "port:=0", "real_time_factor:=2")
BEGIN, END = 8.0, 28.0  # s of simulated time; before, memory may grow
LONGEST_GAP = 0.5  # s of simulated time
MOST_GROWTH = {"memory": 5.0, "handles": 5.0, "threads": 3.0}  # memory in MB


def grown(times: list[float], values: list[float]) -> float:
    """How much has grown steadily: by the lower quartile of the slopes between the samples.

    A leak grows between nearly all samples, but not what grows once, or goes up and down.
    """
    first, second = np.triu_indices(len(times), 1)
    slopes = np.diff(np.array(values)[[first, second]], axis=0)
    slopes = slopes / np.diff(np.array(times)[[first, second]], axis=0)
    return float(np.percentile(slopes, 25)) * (times[-1] - times[0])


def test_what_a_leak_is() -> None:
    times = [*map(float, range(20))]
    assert grown(times, [0.5 * at + at % 2 for at in times]) > 5.0
    assert grown(times, [9.0 * (at > 10.0) + at % 2 for at in times]) <= 1.0


@pytest.mark.slow
def test_driving_about(peer: Peer) -> None:
    """Stamps without gaps, no process that grows."""
    used: dict[tuple[psutil.Process, str], list[float]] = defaultdict(list)
    times: list[float] = []
    with NodeProcess(BRINGUP, *WORDS) as bringup:
        odometry = peer.hear(Odometry, "/velocity_controller/odom", 1000)
        joints = peer.hear(JointState, "/joint_states", 1000)
        commands = peer.publisher(Twist, "/velocity_controller/cmd_vel")

        def now() -> float:
            return nanoseconds(odometry[-1].header.stamp) * 1e-9

        def drive() -> None:
            twist = Twist()
            twist.linear.x, twist.angular.z = 0.5 * math.sin(now()), math.cos(0.3 * now())
            if now() % 5.0 < 4.0:  # then none: the driver dies at full speed
                commands.publish(twist)

        wait_for(lambda: odometry and joints, "the robot")
        peer.node.create_timer(0.02, drive)
        wait_for(lambda: now() > BEGIN, "the robot to drive")
        launcher = psutil.Process(bringup.process.pid)
        nodes = [launcher, *launcher.children(recursive=True)]

        def arrived() -> bool:
            times.append(time.monotonic())
            for node in nodes:
                used[node, "memory"].append(node.memory_full_info().pss / 1e6)
                used[node, "handles"].append(float(node.num_fds()))
                used[node, "threads"].append(float(node.num_threads()))
            time.sleep(0.25)
            return now() > END

        wait_for(arrived, "the end of the drive")
        for (node, kind), values in used.items():
            assert grown(times, values) <= MOST_GROWTH[kind], node.cmdline()
    driven = max(abs(message.twist.twist.linear.x) for message in odometry)
    assert driven > 0.4
    for messages in (odometry, joints):
        stamps = [nanoseconds(message.header.stamp) * 1e-9 for message in messages]
        steps = [after - before for before, after in itertools.pairwise(stamps)]
        assert 0.0 <= min(steps) and max(steps) <= LONGEST_GAP
