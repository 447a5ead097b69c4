"""The variables by which ROS and Fast DDS discover nodes."""

import os
import subprocess
import sys
from pathlib import Path
from subprocess import PIPE

import psutil
import pytest

from onebot_description.errors import OneBotError
from onebot_description.ros import discovery
from onebot_description.ros.discovery import (
    RANGE,
    SERVER,
    configure_discovery,
    discovery_variables,
    question,
    use_local_discovery,
)
from tests.ros_support import Peer
from tests.support import wait_for

PROFILE = "FASTRTPS_DEFAULT_PROFILES_FILE"
NAMES = (RANGE, SERVER, PROFILE, "FASTDDS_DEFAULT_PROFILES_FILE", "FASTDDS_BUILTIN_TRANSPORTS")


@pytest.fixture(autouse=True)
def empty_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in (*NAMES, "ROS_SUPER_CLIENT"):
        monkeypatch.setenv(name, "")  # for what the code sets to be unset afterwards
        monkeypatch.delenv(name)


@pytest.mark.parametrize(
    ("argument", "expected"),
    [
        ("localhost", {RANGE: "LOCALHOST", SERVER: ""}),
        ("subnet", {RANGE: "SUBNET", SERVER: ""}),
        ("10.0.0.7:11811", {RANGE: "SUBNET", SERVER: "10.0.0.7:11811"}),
        ("localhost:1", {RANGE: "SUBNET", SERVER: "127.0.0.1:1"}),
    ],
)
def test_variables_of_an_argument(
    monkeypatch: pytest.MonkeyPatch, argument: str, expected: dict[str, str]
) -> None:
    """Which overrides the environment."""
    monkeypatch.setenv(RANGE, "OFF")
    assert discovery_variables(argument, None, forced=True) == expected


def test_a_server_on_an_unknown_host() -> None:
    argument = "no-such-host.invalid:1"
    with pytest.raises(OneBotError, match=f"discovery:={argument}: no host no-such-host.invalid"):
        discovery_variables(argument, None, forced=True)


@pytest.mark.parametrize("chosen", [{RANGE: "SUBNET"}, {SERVER: "10.0.0.7:11811"}])
def test_the_environment_overrides_the_default(
    monkeypatch: pytest.MonkeyPatch, chosen: dict[str, str]
) -> None:
    [(name, value)] = chosen.items()
    monkeypatch.setenv(name, value)
    assert discovery_variables("localhost", 7, forced=False) == {"ROS_DOMAIN_ID": "7"}
    use_local_discovery()
    assert {name: os.environ[name] for name in (RANGE, SERVER) if name in os.environ} == chosen


@pytest.mark.parametrize(
    ("variables", "expected"),
    [
        ({RANGE: "LOCALHOST"}, "one_computer.xml"),
        ({RANGE: "LOCALHOST", SERVER: "10.0.0.7:11811"}, "network.xml"),
        ({RANGE: "SUBNET"}, "network.xml"),
        ({}, "network.xml"),
        ({RANGE: "SUBNET", "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4"}, ""),
        ({RANGE: "SUBNET", PROFILE: "/mine.xml"}, "mine.xml"),
    ],
)
def test_profiles(
    monkeypatch: pytest.MonkeyPatch, variables: dict[str, str], expected: str
) -> None:
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    configure_discovery()
    found = Path(os.environ.get(PROFILE, ""))
    assert found.name == expected
    assert expected in ("", "mine.xml") or found.is_file()


def test_introspection_by_a_server(monkeypatch: pytest.MonkeyPatch) -> None:
    configure_discovery(whole_graph=True)
    assert "ROS_SUPER_CLIENT" not in os.environ and discovery.server() == ""
    monkeypatch.setenv(SERVER, ";10.0.0.7:11812")
    configure_discovery()
    assert "ROS_SUPER_CLIENT" not in os.environ
    configure_discovery(whole_graph=True)
    assert os.environ["ROS_SUPER_CLIENT"] == "TRUE"
    assert "the discovery server at 10.0.0.7:11812 run" in question()
    monkeypatch.setenv("ROS_SUPER_CLIENT", "FALSE")
    configure_discovery(whole_graph=True)
    assert os.environ["ROS_SUPER_CLIENT"] == "FALSE"


_NODE = """
import sys, rclpy
from onebot_description.ros.discovery import configure_discovery
configure_discovery()
rclpy.init()
node = rclpy.create_node("local")
print("ready", flush=True)
sys.stdin.read()
"""


def test_the_default_listens_on_loopback_only(
    ros_domain: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    command = [sys.executable, "-c", _NODE]
    with subprocess.Popen(command, stdin=PIPE, stdout=PIPE, text=True) as process:
        assert process.stdout.readline() == "ready\n"
        first = 7400 + 250 * ros_domain  # of DDSI-RTPS, section 9.6.2.3
        ends = [each.laddr for each in psutil.Process(process.pid).net_connections("udp")]
        listens = {end.ip for end in ends if first <= end.port < first + 250}
        assert listens == {"127.0.0.1"}
        monkeypatch.delenv(RANGE)
        with Peer(ros_domain) as peer:
            wait_for(lambda: "local" in peer.node.get_node_names(), "the node")
        process.communicate()
