"""Nodes of a launch: their ROS arguments and their parameter files."""

from pathlib import Path

import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from onebot_bringup.launch.nodes import VIEWER, RosNodes, write_parameters
from onebot_description.parameters.files import read_parameters


def test_a_nodes_own_parameters_go_before_its_files(tmp_path):
    """ROS takes the later one; the user's arguments come last of all."""
    nodes = RosNodes(tmp_path, "/left/", ["-p", "a:=1"], "warn")
    node = nodes.process(VIEWER, {"b": 2}, ["x"], [tmp_path / "f.yaml"])
    start = node.command.index(VIEWER.module)
    own = tmp_path / "rerun_viewer.yaml"
    files = ["--params-file", str(tmp_path / "f.yaml"), "--params-file", str(own)]
    assert list(node.command[start + 1 :]) == [
        *["x", "--ros-args", "--log-level", "warn", *files],
        *["-r", "__ns:=/left", "-p", "a:=1"],
    ]
    assert own.read_text().startswith('"/left/rerun_viewer":')
    assert (node.on_exit, node.nice) == ("ignore", VIEWER.nice)


def test_no_argument_without_need(tmp_path):
    """Only a node that its module calls otherwise is renamed."""
    nodes = RosNodes(tmp_path, "")
    assert not {"-r", "--log-level"} & set(nodes.process(VIEWER, {}).command)
    assert "__node:=other" in nodes.process(VIEWER._replace(name="other"), {}).command


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
    """ROS would take 10 for an integer, and YAML 1.1 takes 1e-05 for a text."""
    path = write_parameters(tmp_path, "node", {"rate": 10.0, "small": 1e-5})
    values = read_parameters(path.read_text(), "node.yaml", "/node").values
    assert values == {"rate": 10.0, "small": 1e-5} and type(values["rate"]) is float
    assert yaml.safe_load(path.read_text())["/node"]["ros__parameters"] == values


def test_namespace_and_nesting(tmp_path: Path) -> None:
    """The key is the node's full name, and maps nest."""
    path = write_parameters(tmp_path, "node", {"a": {"b.c": {"d": 1}}}, "left/arm")
    loaded = yaml.safe_load(path.read_text())
    assert loaded == {"/left/arm/node": {"ros__parameters": {"a": {"b.c": {"d": 1}}}}}
