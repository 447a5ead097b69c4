"""Runs nodes of others, unmodified, in lockstep: ``python -m tests.third_party_nodes FOLDER [S]``.

FOLDER has checkouts of the repositories in third_party_nodes.yaml, by their names. Each node runs
twice in the maze, for S simulated seconds; its row says where the robot was at the end, how many
messages the node published, and whether both runs, including these messages, were bit-identical.
"""

import builtins
import hashlib
import importlib
import math
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from itertools import count, cycle
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple
from unittest.mock import patch

import yaml
from rclpy.lifecycle import LifecycleNode
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import CameraInfo, LaserScan, PointCloud2
from sensor_msgs_py.point_cloud2 import create_cloud_xyz32

from onebot_control import OneBotError, Simulation
from onebot_description.ros.domains import used_domain
from onebot_description.ros.wire.codec import pack

_SECONDS = 20.0  # of simulated time, by default


class Tried(NamedTuple):
    """A node of a repository; third_party_nodes.yaml explains the fields."""

    repository: str
    file: str
    nodes: str
    arguments: Sequence[str] = ()
    answers: Sequence[str] = ()
    clouds: str = ""


NODES = [Tried(**row) for row in yaml.safe_load(Path(__file__).with_suffix(".yaml").read_text())]
_PACKAGES = count()


class Clouds(Node):
    """Publishes each scan as a cloud, with the info of a camera at the same time."""

    def __init__(self, topic: str) -> None:
        super().__init__("clouds")
        self.clouds = self.create_publisher(PointCloud2, topic, 10)
        self.infos = self.create_publisher(CameraInfo, "/camera/camera_info", 10)
        self.create_subscription(LaserScan, "scan", self.on_scan, qos_profile_sensor_data)

    def on_scan(self, scan: LaserScan) -> None:
        angles = [scan.angle_min + scan.angle_increment * i for i in range(len(scan.ranges))]
        pairs = zip(scan.ranges, angles, strict=True)
        points = [(far * math.cos(a), far * math.sin(a), 0.0) for far, a in pairs if far < 9.0]
        self.clouds.publish(create_cloud_xyz32(scan.header, points))
        self.infos.publish(CameraInfo(header=scan.header))


@contextmanager
def _typing(answers: Sequence[str]) -> Iterator[None]:
    """Answer questions on a terminal of its own."""
    primary, secondary = os.openpty()
    try:
        texts = cycle(answers)
        with open(secondary) as terminal, patch.object(sys, "stdin", terminal):
            with patch.object(builtins, "input", lambda _="": next(texts)):
                yield
    finally:
        os.close(primary)


@contextmanager
def _published() -> Iterator[list[tuple[Publisher, bytes]]]:
    """Yield the messages that are published, each with its publisher."""
    messages, publish = list[tuple[Publisher, bytes]](), Publisher.publish

    def record(publisher: Publisher, message: Any) -> None:
        # OneBot's own are bytes; rclpy stamps events of parameters with the system's time. ``pack``
        # fills the gaps between fields with zeros, where Fast DDS leaves what was in its memory.
        if not isinstance(message, bytes) and publisher.topic_name != "/parameter_events":
            data = pack(type(message), message)
            messages.append((publisher, publisher.topic_name.encode() + data))
        publish(publisher, message)

    with patch.object(Publisher, "publish", record):
        yield messages


def _loaded(file: Path) -> Any:
    """Return the module of a file, in a new package with its neighbors."""
    package = ModuleType(f"tried_{next(_PACKAGES)}")
    package.__path__ = [str(file.parent)]
    sys.modules[package.__name__] = package
    return importlib.import_module(f"{package.__name__}.{file.stem}")


def outcome(folder: Path, tried: Tried, seconds: float) -> tuple[float, float, float, int, str]:
    """Return where the robot is after a run, x, y and yaw, and the number and hash of messages."""
    with ExitStack() as stack:
        stack.enter_context(used_domain())
        stack.enter_context(_typing(tried.answers))
        simulation = stack.enter_context(Simulation(world="maze", x=1.3, y=0.8, sensors=True))
        ros = stack.enter_context(simulation.ros(nav2_topics=True))
        messages = stack.enter_context(_published())
        file = folder / tried.repository.rpartition("/")[2] / tried.file
        module = _loaded(file)
        nodes = [getattr(module, name)(*tried.arguments) for name in tried.nodes.split()]
        for node in nodes:
            if isinstance(node, LifecycleNode):
                node.trigger_configure()
                node.trigger_activate()
        ros.add(*nodes, *([Clouds(tried.clouds)] if tried.clouds else []))
        publishers = [publisher for node in nodes for publisher in node.publishers]
        if "/cmd_vel" not in {publisher.topic_name for publisher in publishers}:
            simulation.robot.drive(0.1, 0.3)  # a circle
        simulation.run(seconds)
        own = [data for publisher, data in messages if publisher in publishers]
        pose, digest = simulation.robot.pose, hashlib.sha256(b"".join(own)).hexdigest()
        return pose.x, pose.y, pose.yaw, len(own), digest


def main(folder: Path, seconds: float) -> int:
    """Print a row for each node; return how many runs differed or failed."""
    failures = 0
    print(
        "| Repository | Node | x, y, yaw at the end | Messages | Two runs |\n|---|---|---|---|---|"
    )
    for tried in NODES:
        try:
            first, second = (outcome(folder, tried, seconds) for _ in range(2))
            ends = ", ".join(f"{value:.3f}" for value in first[:3]) + f" | {first[3]}"
            result = "identical" if first == second else "different"
        except (OneBotError, OSError, ImportError) as error:
            ends, result = " | ", str(error)
        failures += result != "identical"
        print(f"| {tried.repository} | {Path(tried.file).name} | {ends} | {result} |", flush=True)
    return failures


if __name__ == "__main__":
    if len(sys.argv) not in (2, 3):
        sys.exit(__doc__)
    sys.exit(main(Path(sys.argv[1]), float(sys.argv[2]) if len(sys.argv) > 2 else _SECONDS))
