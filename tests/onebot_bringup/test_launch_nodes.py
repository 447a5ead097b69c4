"""Nodes of a launch: their ROS arguments and their parameter files."""

from pathlib import Path

import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from onebot_bringup.launch.nodes import VIEWER, RosNodes, write_parameters
from onebot_description.parameters.files import read_parameters


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
