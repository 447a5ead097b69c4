"""tf2 and point clouds for users' nodes: look-ups, memory, and what a node's start takes longer.

The floor of a look-up is to make the message that it returns, as every tf2 in Python has to: tf2's
C++ takes 2.4 times that with its binding, for the same chain on the same computer.
"""

import subprocess
import sys
import timeit
from collections.abc import Callable
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import psutil
import pytest
from geometry_msgs.msg import TransformStamped
from rclpy.time import Time
from sensor_msgs_py.point_cloud2 import create_cloud_xyz32, read_points
from std_msgs.msg import Header
from tf2_py import BufferCore

import onebot_description  # noqa: F401  (finds the packages)
from tests.benchmarks.chains import Chain
from tests.benchmarks.measuring import WrongAnswer, in_turn, median, over
from tests.benchmarks.report import Report, Result

_FRAMES, _RATE_NS, _POINTS = 10, 1_000_000, 100_000
_MOST_OVER, _MOST_MEMORY, _MOST_READ, _MOST_START = 7.0, 50.0, 1.0, 1.2
_NODE = "import onebot_description, rclpy; rclpy.init(); node = rclpy.create_node('node'); "
_LISTENER = "import tf2_ros; b = tf2_ros.Buffer(); l = tf2_ros.TransformListener(b, node); "
_END = "import os; os._exit(0)"


def run(quick: bool) -> Report:
    """Measure all of it."""
    return [*_lookups(quick), _memory(quick), _clouds(quick), *_start(quick)]


def _message(parent: str, child: str, stamp_ns: int, pose: Any) -> TransformStamped:
    message = TransformStamped()
    message.header.frame_id, message.child_frame_id = parent, child
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, 1_000_000_000)
    at, turn = message.transform.translation, message.transform.rotation
    at.x, at.y, at.z, turn.x, turn.y, turn.z, turn.w = pose
    return message


def _lookups(quick: bool) -> Report:
    """Look up the tip of a chain in which every frame is interpolated."""
    chain, core = Chain(_FRAMES), BufferCore()
    poses = chain.transforms(chain.positions(100))
    for number, state in enumerate(poses):
        for (parent, child), pose in zip(chain.frames, state.tolist(), strict=True):
            core.set_transform(_message(parent, child, 10**9 + number * 10**8, pose), "me")
    root, tip, time = chain.frames[0][0], chain.frames[-1][1], Time(nanoseconds=5_050_000_000)
    found = core.lookup_transform_core(root, tip, time).transform
    back = core.lookup_transform_core(tip, root, time).transform
    turn = abs(np.dot(*([q.x, q.y, q.z, -q.w] for q in (found.rotation, back.rotation))))
    if not np.isfinite(turn):
        raise WrongAnswer("a look-up is not finite")
    pose, count = poses[0, 0].tolist(), 100 if quick else 20_000
    variants: dict[str, Callable[[], float]] = {
        name: lambda function=function: timeit.timeit(function, number=count) / count * 1e6
        for name, function in {
            "lookup": lambda: core.lookup_transform_core(root, tip, time),
            "floor": lambda: _message(root, tip, 5_050_000_000, pose),
        }.items()
    }
    times = in_turn(variants, 1 if quick else 9)
    return [
        Result(f"look-up down {_FRAMES} moving frames", median(times["lookup"]), unit="µs"),
        Result("over its message alone", over(times["lookup"], times["floor"]), _MOST_OVER),
    ]


def _memory(quick: bool) -> Result:
    """Keep 10 s of 1,000 transforms a second, after as long before."""
    core, process = BufferCore(), psutil.Process()
    message, before = _message("a", "b", 0, [0.0] * 6 + [1.0]), process.memory_info().rss
    for number in range(200 if quick else 20_000):
        stamp_ns = 10**9 + number * _RATE_NS
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, 10**9)
        core.set_transform(message, "me")
    used = (process.memory_info().rss - before) / 1e6
    return Result("10 s of 1,000 transforms a second, RSS", used, _MOST_MEMORY, unit="MB")


def _clouds(quick: bool) -> Result:
    points = np.random.default_rng(1).uniform(-9, 9, (_POINTS, 3)).astype(np.float32)
    cloud = create_cloud_xyz32(Header(), points)
    if not (read_points(cloud)["z"] == points[:, 2]).all():
        raise WrongAnswer("points were read wrongly")
    count = 10 if quick else 1_000
    took = timeit.timeit(lambda: read_points(cloud), number=count) / count * 1e3
    return Result(f"read_points of {_POINTS:,} points", took, _MOST_READ, unit="ms")


def _start(quick: bool) -> Report:
    """Start nodes with and without a listener; their processor time, as a loaded machine waits."""
    with TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPYCACHEPREFIX", folder)
        patch.setenv("PYTHONDONTWRITEBYTECODE", "")
        variants = {
            "floor": lambda: _cpu_s(_NODE + _END),
            "listener": lambda: _cpu_s(_NODE + _LISTENER + _END),
        }
        in_turn(variants, 1)  # which compiles the bytecode
        times = in_turn(variants, 1 if quick else 9)
    longer = (median(times["listener"]) - median(times["floor"])) * 1e3
    return [
        Result("a node's start with a listener, longer by", longer, unit="ms"),
        Result("over a node's start", over(times["listener"], times["floor"]), _MOST_START),
    ]


def _cpu_s(code: str) -> float:
    process = psutil.Popen([sys.executable, "-c", code], stdout=subprocess.DEVNULL)
    before = psutil.Process().cpu_times()
    process.wait()
    after = psutil.Process().cpu_times()
    return float(
        after.children_user + after.children_system - before.children_user - before.children_system
    )
