"""Nodes of a launch: their ROS arguments and their parameter files."""

from pathlib import Path

import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from onebot_bringup.launch.nodes import RosNodes, write_parameters


def test_a_nodes_own_parameters_go_before_its_files(tmp_path):
    """ROS takes the later one; the user's arguments come last of all."""
    make = RosNodes(tmp_path, "/left/", ["-p", "a:=1"], "warn")
    node = make.node("wheel", "some.module", {"b": 2}, words=["x"], files=[tmp_path / "f.yaml"])
    start = node.command.index("some.module")
    own = tmp_path / "wheel.yaml"
    files = ["--params-file", str(tmp_path / "f.yaml"), "--params-file", str(own)]
    assert list(node.command[start + 1 :]) == [
        *["x", "--ros-args", "--log-level", "warn", *files],
        *["-r", "__ns:=/left", "-p", "a:=1"],
    ]
    assert own.read_text().startswith('"/left/wheel":')
    assert node.on_exit == "shutdown"


def test_no_argument_without_need(tmp_path):
    """Only a node that its module calls otherwise is renamed."""
    make = RosNodes(tmp_path, "")
    plain = make.node("viewer", "some.module", {}, on_exit="ignore")
    assert plain.on_exit == "ignore"
    assert not {"-r", "--log-level"} & set(plain.command)
    assert "__node:=viewer" in make.node("viewer", "some.module", {}, renamed=True).command


Text = st.text(st.characters(blacklist_categories=("Cs",)))
Name = st.text(st.characters(blacklist_categories=("Cs",)), max_size=50)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.dictionaries(Name, Text | st.booleans() | st.integers(-(2**31), 2**31), max_size=5))
def test_values_come_back_with_their_type(tmp_path: Path, values: dict[str, object]) -> None:
    """Any text (emoji, quotes, "1.0", "true"), boolean or whole number is read back unchanged."""
    path = write_parameters(tmp_path, "node", values)
    loaded = yaml.safe_load(path.read_text())["/node"]["ros__parameters"] or {}
    assert loaded == values
    assert {name: type(value) for name, value in loaded.items()} == {
        name: type(value) for name, value in values.items()
    }


def test_doubles_keep_their_point(tmp_path: Path) -> None:
    """ROS would take 10 for an integer, and 1e-05 for a text."""
    path = write_parameters(tmp_path, "node", {"rate": 10.0, "small": 1e-5})
    assert "10.000" in path.read_text() and "0.00001" in path.read_text()


def test_namespace_and_nesting(tmp_path: Path) -> None:
    """The key is the node's full name, and maps nest."""
    path = write_parameters(tmp_path, "node", {"a": {"b.c": {"d": 1}}}, "left/arm")
    loaded = yaml.safe_load(path.read_text())
    assert loaded == {"/left/arm/node": {"ros__parameters": {"a": {"b.c": {"d": 1}}}}}
