"""The tables in the READMEs are those of the declarations, of the nodes on the wire, the commands.

An entry such as "each of `source_list`" stands for the topics that the test makes the node use.
"""

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import yaml
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from nav_msgs.msg import Path as PlannedPath
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from std_msgs.msg import String

from onebot_bringup.viewer.displays import MESSAGE_DRAWINGS
from onebot_description.description import load_description
from tests import readme_tables
from tests.benchmarks.__main__ import BENCHMARKS
from tests.readme import CHECKOUT
from tests.ros_support import LATCHED, NodeProcess, Peer
from tests.support import wait_for

TEXTS = dict(readme_tables.readmes())
ONEBOT = load_description(CHECKOUT / "onebot_description/urdf/onebot.urdf.xacro").urdf

# What every ROS node has.
COMMON_TOPICS = {"/rosout", "/parameter_events"}
COMMON_SERVICES = re.compile(r".*/(\w*_parameters?\w*|get_type_description)")


@dataclass(frozen=True)
class Documented:
    """A node as its package's documentation describes it, and how to start it."""

    module: str
    # Parameters with which it has all there is to have; "TMP" in a text is the test's folder.
    most: Mapping[str, Any] = field(default_factory=dict)
    argument: str = ""
    description: str = ""  # on the topic robot_description
    topics: Mapping[str, tuple[str, ...]] = field(default_factory=dict)  # of entries in words
    others: tuple[str, ...] = ()  # nodes of the same process, which have only services

    @property
    def name(self) -> str:
        return self.module.rpartition(".")[2]

    def table(self, heading: str) -> list[list[str]]:
        """The cells of the table below this heading; none if there is no such heading."""
        [node] = filter(None, (_section(text, f"## {self.name}") for text in TEXTS.values()))
        return _rows(_section(node, f"### {heading}"))

    def documented(self, heading: str) -> dict[str, list[str]]:
        """The other cells of a table of topics or services, by full name."""
        return {
            _full(name, self.name): cells
            for entry, *cells in self.table(heading)
            for name in self.topics.get(entry) or _names(entry)
        }


def _section(text: str, heading: str) -> str:
    """What is below a heading, down to the next one of its level or above."""
    level = heading.index(" ")
    match = re.search(rf"^{heading}\n(.*?)(?=^#{{2,{level}}} |\Z)", text, re.MULTILINE | re.DOTALL)
    return match[1] if match else ""


def _rows(text: str) -> list[list[str]]:
    """The cells of all tables, without their heads."""
    tables = re.findall(r"^\|---.*\n((?:\|.*\n)+)", text, re.MULTILINE)
    lines = "".join(tables).replace(r"\|", "/").splitlines()
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


def _names(cell: str) -> list[str]:
    """The names in backticks."""
    return re.findall(r"`([^`]+)`", cell)


def _full(name: str, node: str) -> str:
    return f"/{node}{name[1:]}" if name[0] == "~" else f"/{name.lstrip('/')}"


NODES = (
    Documented(
        "onebot_description.robot_state_publisher",
        argument=str(CHECKOUT / "mrm_description/urdf/mrm.xacro"),
    ),
    Documented(
        "onebot_description.joint_state_publisher",
        most={"source_list": ["more"]},
        description=ONEBOT,
        topics={"each of `source_list`": ("more",)},
    ),
    Documented(
        "onebot_control.velocity_controller",
        most={"publish_limited_velocity": True, "real_time_factor": 2.0, "world": "maze"},
        description=ONEBOT,
        others=("simulation",),
    ),
    Documented(
        "onebot_control.joint_trajectory_controller",
        argument=str(CHECKOUT / "mrm_description/urdf/mrm.xacro"),
    ),
    Documented("onebot_control.navigator"),
    Documented(
        "onebot_bringup.viewer.rerun_viewer",
        most={"viewer": "none", "save": "TMP/run.rrd", "view": "TMP/view.yaml"},
        topics={
            "topics of the view": ("trail", "commanded"),
            "topics of types that have a display": ("plan",),
        },
    ),
    Documented(
        "onebot_bringup.steering.steering_page",
        most={"odom_topic": "where"},
        topics={"`odom_topic` (parameter)": ("where",)},
    ),
    Documented(
        "onebot_bringup.bags.bag_recorder",
        most={"folder": "TMP/run"},
        topics={
            "every topic": ("chatter", "plan", "robot_description", "velocity_controller/cmd_vel")
        },
    ),
)
VIEW = {
    "trails": {"odometry": {"topic": "trail"}},
    "speeds": {"lines": {"commanded": {"topic": "commanded", "type": "Twist"}}},
}


@pytest.fixture
def peer(ros_domain: int, monkeypatch: pytest.MonkeyPatch) -> Iterator[Peer]:
    for display in ("DISPLAY", "WAYLAND_DISPLAY"):  # no node opens a page
        monkeypatch.delenv(display, raising=False)
    with Peer(ros_domain) as peer:
        yield peer


@contextmanager
def running(node: Documented, peer: Peer, folder: Path) -> Iterator[None]:
    """The node with all that it can have, among topics that it can use."""
    (folder / "view.yaml").write_text(yaml.safe_dump(VIEW))
    peer.node.create_publisher(String, "chatter", 10)
    peer.node.create_publisher(PlannedPath, "plan", 10)
    peer.node.create_subscription(Twist, "velocity_controller/cmd_vel", lambda _: None, 10)
    latched = peer.node.create_publisher(String, "robot_description", LATCHED)
    if node.description:
        latched.publish(String(data=node.description))
    if "odom_topic" in node.most:
        peer.node.create_publisher(Odometry, str(node.most["odom_topic"]), 10)
    if (world := "/world_description") in node.documented("Subscribed topics"):
        peer.node.create_publisher(String, world, LATCHED)
    file = folder / "parameters.yaml"
    parameters = yaml.safe_dump({"/**": {"ros__parameters": dict(node.most)}})
    file.write_text(parameters.replace("TMP", str(folder)))
    arguments = [node.argument] if node.argument else []
    with NodeProcess(node.module, *arguments, "--ros-args", "--params-file", str(file)):
        wait_for(lambda: node.name in peer.node.get_node_names(), node.name)
        yield


@pytest.mark.slow
@pytest.mark.parametrize("node", NODES, ids=lambda node: node.name)
def test_all_there_is(node: Documented, peer: Peer, tmp_path: Path) -> None:
    """The tables hold every topic and service of the node, and nothing else."""
    with running(node, peer, tmp_path):
        _check_topics(node, peer.node)
        for other in node.others:
            wait_for(lambda name=other: name in peer.node.get_node_names(), other)
            documented = Documented(other).documented("Services")
            ask = partial(_live, peer.node.get_service_names_and_types_by_node, other)
            live = _settled(ask, set(documented))
            assert live == {name: [cells[0]] for name, cells in documented.items()}


def test_declarations() -> None:
    """Parameters, arguments and commands: python -m tests.readme_tables writes them."""
    marks: list[str] = []
    for path, text in TEXTS.items():
        marks += re.findall(r"<!-- ([^\n]*) -->\n.*?<!-- /\1 -->", text, re.DOTALL)
        assert readme_tables.rewritten(text) == text, path
    made = [mark for mark in marks if not mark.startswith("accuracy")]  # those are measured
    assert sorted(made) == sorted(readme_tables.tables())


def _check_topics(node: Documented, graph: Node) -> None:
    for heading, ask, ends in (
        (
            "Published topics",
            graph.get_publisher_names_and_types_by_node,
            graph.get_publishers_info_by_topic,
        ),
        (
            "Subscribed topics",
            graph.get_subscriber_names_and_types_by_node,
            graph.get_subscriptions_info_by_topic,
        ),
        ("Services", graph.get_service_names_and_types_by_node, None),
    ):
        documented = node.documented(heading)
        live = _settled(lambda ask=ask: _live(ask, node.name), set(documented))
        assert set(live) == set(documented), heading
        for name, types in live.items():
            kinds = re.findall(r"\w+/\w+/\w+", documented[name][0])
            # "every topic" is of any type.
            assert not kinds or set(types) <= set(kinds), name
            if ends is not None:
                _check_qos(documented[name][1], node.name, ends(name))


def _live(ask: Any, node: str) -> dict[str, list[str]]:
    return {
        name: types
        for name, types in ask(node, "/")
        if name not in COMMON_TOPICS
        and not COMMON_SERVICES.fullmatch(name)
        and "/_action/" not in name
    }


def _settled(ask: Any, names: set[str]) -> Any:
    """What there is, as soon as it is what it should be, or after a long time."""
    with suppress(AssertionError):
        wait_for(lambda: set(ask()) == names, "the topics")
    return ask()


def _check_qos(documented: str, node: str, ends: Any) -> None:
    if documented == "as published":
        return
    [qos] = {
        (end.qos_profile.reliability, end.qos_profile.durability)
        for end in ends
        if end.node_name == node
    }
    assert qos == (
        ReliabilityPolicy.BEST_EFFORT
        if "best effort" in documented
        else ReliabilityPolicy.RELIABLE,
        DurabilityPolicy.TRANSIENT_LOCAL
        if "transient local" in documented
        else DurabilityPolicy.VOLATILE,
    ), documented


def test_displays() -> None:
    """Every display is in its table, with its message types, and no other."""
    text = TEXTS["onebot_bringup/docs/viewer.md"]
    rows = _rows(_section(text, "### Displays"))
    types = {name: cells[0] for entry, *cells in rows for name in _names(entry)}
    assert set(types) == {drawing.key for drawing in MESSAGE_DRAWINGS}
    for drawing in MESSAGE_DRAWINGS:
        for name in drawing.message_types:
            package, _, kind = name.split("/")
            assert package in types[drawing.key] and kind in types[drawing.key], name


def test_benchmarks() -> None:
    """Every benchmark is in the benchmarks' README, and no other."""
    text = (CHECKOUT / "tests/benchmarks/README.md").read_text()
    assert [_names(row[0]) for row in _rows(_section(text, "## Benchmarks"))] == [
        [name] for name in BENCHMARKS
    ]
