"""From the command to the first messages, and the memory of all that was started.

The floor is an rclpy node with PyBullet loaded that publishes an Odometry (empty_node.py). Both are
started in turn, each in a ROS domain of its own that a subscriber already listens in. Their
bytecode is compiled before, as pip does it.
"""

import math
import time
from collections.abc import Callable
from tempfile import TemporaryDirectory
from typing import Any

import pytest
from nav_msgs.msg import Odometry

from onebot_description.ros.domains import used_domain
from onebot_description.ros.wire.interfaces import TFMessage
from tests.benchmarks.measuring import WrongAnswer, in_turn, median, over, rss_mb
from tests.benchmarks.report import Report, Result
from tests.ros_support import NodeProcess, Peer
from tests.support import wait_for

_ODOM = "/velocity_controller/odom"
_FRAMES = (  # parent and child
    ("odom", "base_link"),
    *(("base_link", child) for child in ("left_wheel", "right_wheel", "caster_base2")),
    ("caster_base2", "caswheel"),
)
_GOAL, _MOST_MEMORY = 1.5, 250.0  # MB
_SETTLED = 2.0  # s after the first messages, when memory is looked at

Start = tuple[float, float, float]  # s to the first odometry, and to the first transform; MB


def run(quick: bool) -> Report:
    """Start both in turn."""
    with TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPYCACHEPREFIX", folder)
        patch.setenv("PYTHONDONTWRITEBYTECODE", "")
        variants: dict[str, Callable[[], Start]] = {
            "floor": lambda: _start("tests.benchmarks.empty_node", _ODOM, quick=quick),
            "ours": lambda: _start(
                "onebot_bringup.launch.onebot_bringup", "viewer:=none", quick=quick
            ),
        }
        if not quick:
            in_turn(variants, 1)
        starts = in_turn(variants, 1 if quick else 9)
    (odom, tf, memory), (floor, _, _) = (
        zip(*starts[name], strict=True) for name in ("ours", "floor")
    )
    return [
        Result("first /odom", median(odom), unit="s"),
        Result("first /odom over the floor's first message", over(odom, floor), _GOAL),
        Result("first /tf over the floor's first message", over(tf, floor), _GOAL),
        Result("onebot_bringup without viewer, RSS", median(memory), _MOST_MEMORY, unit="MB"),
    ]


def _start(module: str, word: str, *, quick: bool) -> Start:
    """Start a command, time its first messages, and end it.

    Raises:
        WrongAnswer: the messages are not those of the robot.
    """
    expected = {(_ODOM, "odom", "base_link")}
    if word != _ODOM:
        expected |= {("/tf", *frames) for frames in _FRAMES}
    times: dict[tuple[str, str, str], float] = {}

    def note(topic: str, message: Any) -> None:
        frames = message.header.frame_id, message.child_frame_id
        times.setdefault((topic, *frames), time.monotonic())

    with used_domain() as domain, Peer(domain) as peer:
        create = peer.node.create_subscription
        create(TFMessage, "/tf", lambda tf: [note("/tf", each) for each in tf.transforms], 100)
        create(Odometry, _ODOM, lambda odometry: note(_ODOM, odometry), 100)
        began = time.monotonic()
        with NodeProcess(module, word) as node:
            wait_for(lambda: expected <= times.keys(), "the messages")
            time.sleep(0.0 if quick else _SETTLED)
            memory = rss_mb(node.process.pid)
    if times.keys() != expected:
        raise WrongAnswer(f"there were transforms of other frames: {times.keys() - expected}")
    first_tf = min((at for (topic, *_), at in times.items() if topic == "/tf"), default=math.nan)
    return times[_ODOM, "odom", "base_link"] - began, first_tf - began, memory
