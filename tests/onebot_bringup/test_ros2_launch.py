"""The launch files of ``ros2 launch``: the scripts' arguments, and the scripts themselves.

No package index has the Python package ``launch`` of ROS. What is used of it is replaced here by
classes of the same signatures.
"""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

from mrm_description.launch import mrm_bringup
from onebot_bringup.launch import onebot_bringup

CHECKOUT = Path(__file__).resolve().parents[2]
FILES = {
    mrm_bringup: CHECKOUT / "mrm_description/launch/mrm_bringup.launch.py",
    onebot_bringup: CHECKOUT / "onebot_bringup/launch/onebot_bringup.launch.py",
}


class OpaqueFunction:
    """Calls a function, and starts what it returns."""

    def __init__(self, *, function: Any) -> None:
        self.function = function

    def execute(self, context: Any) -> list[Any]:
        return self.function(context) or []


class DeclareLaunchArgument:
    """Gives an argument its default, unless it has a value."""

    def __init__(self, name: str, *, default_value: str, description: str) -> None:
        self.name, self.default_value, self.description = name, default_value, description

    def execute(self, context: Any) -> list[Any]:
        context.launch_configurations.setdefault(self.name, self.default_value)
        return []


@pytest.fixture(autouse=True)
def launch(monkeypatch: pytest.MonkeyPatch) -> None:
    package, actions = ModuleType("launch"), ModuleType("launch.actions")
    package.LaunchDescription = list  # type: ignore[attr-defined]
    actions.ExecuteProcess = SimpleNamespace  # type: ignore[attr-defined]
    for each in (DeclareLaunchArgument, OpaqueFunction):
        setattr(actions, each.__name__, each)
    monkeypatch.setitem(sys.modules, "launch", package)
    monkeypatch.setitem(sys.modules, "launch.actions", actions)


def context_of(**configurations: str) -> Any:
    """What the actions of one launch share."""
    return SimpleNamespace(launch_configurations=configurations)


def entities(script: ModuleType) -> list[Any]:
    """What the launch file of a script describes; it is loaded as ros2 launch does it."""
    spec = importlib.util.spec_from_file_location("python_launch_file", FILES[script])
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.generate_launch_description()


def visit(script: ModuleType, context: Any) -> list[str]:
    """Execute what is described, in order; the command that it starts."""
    (process,) = [action for each in entities(script) for action in each.execute(context)]
    assert process.output == "screen"
    return process.cmd


@pytest.mark.parametrize("script", FILES)
def test_it_declares_the_arguments_of_the_script(script, capsys):
    """Names, defaults and descriptions are those that the script shows."""
    declared = [each for each in entities(script) if isinstance(each, DeclareLaunchArgument)]
    assert script.main(["--show-args"]) == 0
    shown = " ".join(capsys.readouterr().out.split())
    for each in declared:
        assert f"{each.name}:={each.default_value} {each.description}".replace("  ", " ") in shown
    assert shown.count(":=") == len(declared)


def test_only_what_was_given_is_on_the_command_line(tmp_path: Path) -> None:
    """A default is no choice of the user's, and what another file declares is not ours.

    The model's arguments are known, also if they name one of its files.
    """
    model = tmp_path / "robot.xacro"
    model.write_text(
        '<robot name="a" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:arg name="own"/>'
        '<xacro:include filename="$(arg own).xacro"/></robot>'
    )
    given = {"model": str(model), "viewer": "none", "own": "part"}
    for script in FILES:
        python, _, module, *words = visit(script, context_of(**given, robot_ip="10.0.0.1"))
        assert (python, module) == (sys.executable, script.__name__)
        assert words == [f"{name}:={value}" for name, value in given.items()]
    context = context_of(mesh_enabled="false")  # of OneBot's own model
    assert visit(onebot_bringup, context)[3:] == ["mesh_enabled:=false"]


@pytest.mark.parametrize(
    ("pushed", "given", "expected"),
    [
        ("/r1", {}, "/r1/"),
        ("fleet/r1", {"namespace": "arm"}, "fleet/r1/arm"),
        ("/r1", {"namespace": "/r2"}, "/r2"),
    ],
)
def test_a_pushed_namespace_is_the_robots(
    pushed: str, given: dict[str, str], expected: str
) -> None:
    """PushRosNamespace around the included file, as it counts for a Node."""
    context = context_of(viewer="none", ros_namespace=pushed, **given)
    assert visit(onebot_bringup, context)[3:] == ["viewer:=none", f"namespace:={expected}"]


def test_two_in_one_launch_file_do_not_mix():
    """What the first one declares is no choice of the user's to the second."""
    context = context_of(viewer="none")
    first = visit(onebot_bringup, context)
    context.launch_configurations["namespace"] = "r2"
    assert visit(onebot_bringup, context) == [*first, "namespace:=r2"]
