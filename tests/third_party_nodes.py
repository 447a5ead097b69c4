"""Runs nodes of others, unmodified, in lockstep: ``python -m tests.third_party_nodes FOLDER [S]``.

FOLDER has checkouts of the repositories in ``NODES``, by their names. Each node runs twice in the
maze, for S simulated seconds; its row says where the robot was at the end, and whether both runs
were bit-identical.
"""

import builtins
import importlib.util
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from itertools import cycle
from pathlib import Path
from typing import Any, NamedTuple
from unittest.mock import patch

from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import LaserScan

from onebot_control import OneBotError, Simulation
from onebot_description.ros.domains import used_domain

_TURTLEBOT3 = "turtlebot3_example/turtlebot3_example"
_SECONDS = 20.0  # of simulated time, by default


class Tried(NamedTuple):
    """A node of a repository."""

    repository: str
    file: str
    start: Callable[[Any], Node]  # given the module, returns the node
    answers: tuple[str, ...] = ()  # what a user types in answer to its questions, again and again


def _synchronized(message_filters: Any) -> Node:
    """Return a node that logs scans and odometry that belong together."""
    node = Node("synchronized")
    scans = message_filters.Subscriber(node, LaserScan, "scan", qos_profile=qos_profile_sensor_data)
    odometry = message_filters.Subscriber(node, Odometry, "odom")
    filters = message_filters.ApproximateTimeSynchronizer([scans, odometry], 10, 0.05)
    node.pairs, node.filters = [], filters  # type: ignore[attr-defined] # keeps it alive, too
    filters.registerCallback(lambda scan, odom: node.pairs.append((scan, odom)))  # type: ignore[attr-defined]
    return node


def _talker(module: Any) -> Node:
    """Return a lifecycle node that has been configured and activated."""
    node: Any = module.LifecycleTalker("talker")
    node.trigger_configure()
    node.trigger_activate()
    return node


NODES = (
    Tried(
        "ROBOTIS-GIT/turtlebot3",
        f"{_TURTLEBOT3}/turtlebot3_obstacle_detection/turtlebot3_obstacle_detection.py",
        lambda module: module.Turtlebot3ObstacleDetection(),
    ),
    Tried(
        "ROBOTIS-GIT/turtlebot3",
        f"{_TURTLEBOT3}/turtlebot3_absolute_move/turtlebot3_absolute_move.py",
        lambda module: module.Turtlebot3AbsoluteMove(),
        ("0.5", "0.2", "90"),
    ),
    Tried(
        "ROBOTIS-GIT/turtlebot3",
        f"{_TURTLEBOT3}/turtlebot3_relative_move/turtlebot3_relative_move.py",
        lambda module: module.Turtlebot3RelativeMove(),
        ("0.4", "0.1", "0"),
    ),
    *(
        Tried(
            "jlevitsky/comprobo-warmup-project",
            f"comprobo_warmup_project/{file}.py",
            lambda module, kind=kind: getattr(module, kind)(),
        )
        for file, kind in (
            ("wall_follower", "WallFollower"),
            ("obstacle_avoider", "ObstacleAvoider"),
            ("person_follower", "PersonFollower"),
            ("drive_square", "DriveSquare"),
            ("dance", "Dance"),
        )
    ),
    Tried("ros2/message_filters", "src/message_filters/__init__.py", _synchronized),
    Tried("ros2/demos", "lifecycle_py/lifecycle_py/talker.py", _talker),
    Tried(
        "ros2/demos", "demo_nodes_py/demo_nodes_py/topics/talker.py", lambda module: module.Talker()
    ),
)


@contextmanager
def _typing(answers: tuple[str, ...]) -> Iterator[None]:
    """Answer questions on a terminal of its own."""
    primary, secondary = os.openpty()
    try:
        texts = cycle(answers)
        with open(secondary) as terminal, patch.object(sys, "stdin", terminal):
            with patch.object(builtins, "input", lambda _="": next(texts)):
                yield
    finally:
        os.close(primary)


def outcome(folder: Path, tried: Tried, seconds: float) -> tuple[float, ...]:
    """Return where the robot is after a run: x, y and yaw."""
    file = folder / tried.repository.rpartition("/")[2] / tried.file
    spec = importlib.util.spec_from_file_location(f"tried_{file.parent.name}_{file.stem}", file)
    assert spec is not None and spec.loader is not None, file
    with ExitStack() as stack:
        stack.enter_context(used_domain())
        stack.enter_context(_typing(tried.answers))
        simulation = stack.enter_context(Simulation(world="maze", x=1.3, y=0.8, sensors=True))
        ros = stack.enter_context(simulation.ros(nav2_topics=True))
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        ros.add(tried.start(module))
        simulation.run(seconds)
        pose = simulation.robot.pose
        return pose.x, pose.y, pose.yaw


def main(folder: Path, seconds: float) -> int:
    """Print a row for each node; return how many runs differed or failed."""
    failures = 0
    print("| Repository | Node | x, y, yaw at the end | Two runs |\n|---|---|---|---|")
    for tried in NODES:
        try:
            first, second = (outcome(folder, tried, seconds) for _ in range(2))
            ends = ", ".join(f"{value:.3f}" for value in first)
            result = "identical" if first == second else "different"
        except (OneBotError, OSError) as error:
            ends, result = "", str(error)
        failures += result != "identical"
        print(f"| {tried.repository} | {Path(tried.file).name} | {ends} | {result} |", flush=True)
    return failures


if __name__ == "__main__":
    if len(sys.argv) not in (2, 3):
        sys.exit(__doc__)
    sys.exit(main(Path(sys.argv[1]), float(sys.argv[2]) if len(sys.argv) > 2 else _SECONDS))
