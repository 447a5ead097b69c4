"""MRM from the command that users type to transforms in another process, and back to nothing."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from onebot_description.description.packages import package_share
from tests.onebot_bringup.bringup_support import (
    Transforms,
    bringups,
    left_behind,
    stop,
    wait_for_robot,
)
from tests.onebot_bringup.launcher_support import RunningCommand
from tests.support import wait_for

Start = Callable[..., RunningCommand]

JOINTS = """/**/joint_state_publisher:
  ros__parameters:
    rate: 50.0
    motions:
      base_link__link_01: {{type: constant, position: {position}}}
"""


@pytest.fixture
def transforms(ros_domain: int) -> Iterator[Transforms]:
    with Transforms(ros_domain) as listener:
        yield listener


@pytest.fixture
def start(tmp_path: Path, ros_domain: int) -> Iterator[Start]:
    """Start ``mrm_bringup`` with arguments; without a viewer unless they say otherwise."""
    with bringups(tmp_path, "mrm_description.launch.mrm_bringup", "viewer:=none") as make:
        yield make


def write_joints(folder: Path, position: float) -> str:
    """Write a joint file that holds MRM's joint at ``position`` rad, and return its path."""
    path = folder / "joints.yaml"
    path.write_text(JOINTS.format(position=position))
    return str(path)


def test_the_command_alone_moves_mrm(start: Start, transforms: Transforms) -> None:
    """Without arguments the joint moves, /tf says so elsewhere, and Ctrl-C leaves nothing."""
    running = start()
    first = wait_for_robot(running, transforms, "link1")
    assert abs(first[0] - 0.5) < 1e-9  # m, the top of the base
    wait_for(lambda: transforms.of("link1") != first, "a movement")
    assert 'Robot "mrm"' in running.out and "Ctrl-C stops everything" in running.out
    stop(running)


def test_editing_the_joints_moves_the_robot(
    start: Start, transforms: Transforms, tmp_path: Path
) -> None:
    """The YAML file is the robot's remote control, while it runs; the log names it alone."""
    file = write_joints(tmp_path, 0.25)
    running = start(f"joints:={file}")
    wait_for(transforms.turned_to(0.25, "link1"), "the first position")
    write_joints(tmp_path, -0.5)
    wait_for(transforms.turned_to(-0.5, "link1"), "the edited position")
    wait_for(lambda: f"] {file}: applied, changed: " in running.out + running.err, "the report")
    stop(running)


def test_editing_the_xacro_changes_the_robot(
    start: Start, transforms: Transforms, tmp_path: Path
) -> None:
    """An edit of the model takes effect at once; a broken one is reported and changes nothing.

    All nodes follow it, also when a joint has gone that the YAML names.
    """
    model = tmp_path / "my_mrm.xacro"
    good = (package_share("mrm_description") / "urdf/mrm.xacro").read_text()
    model.write_text(good)
    running = start(f"model:={model}", f"joints:={write_joints(tmp_path, 0.25)}")
    wait_for(transforms.turned_to(0.25, "link1"), "the robot")
    taller = good.replace('name="base_side" value="1.0"', 'name="base_side" value="2.0"')
    assert taller != good

    def height() -> float:
        found = transforms.of("link1")
        return found[0] if found else 0.0

    model.write_text(taller.replace("</robot>", ""))
    wait_for(lambda: "stays as it was" in running.err, "the report of the broken file")
    assert "my_mrm.xacro" in running.err
    transforms.latest.clear()
    wait_for(lambda: abs(height() - 0.5) < 1e-9, "the robot as it was")
    model.write_text(good)
    wait_for(lambda: f"{model}: mended" in running.out + running.err, "the mended robot")
    model.write_text(taller)
    wait_for(lambda: abs(height() - 1.0) < 1e-9, "the taller base")
    edited = f"{model}: edited, robot_state_publisher publishes the new robot"
    wait_for(lambda: edited in running.out + running.err, "the report of the edit")
    model.write_text(good.replace("base_link__link_01", "elbow"))
    wait_for(transforms.turned_to(0.0, "link1"), "the renamed joint, which nothing moves")
    gone = 'motions.base_link__link_01: the robot has no joint "base_link__link_01"'
    wait_for(lambda: gone in running.out + running.err, "the warning of the YAML")
    stop(running)


def test_a_killed_command_leaves_nothing(
    start: Start,
    transforms: Transforms,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Even after SIGKILL of the command itself no process of it stays."""
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    running = start()
    wait_for_robot(running, transforms, "link1")
    (parameters,) = tmp_path.glob("onebot-*")
    assert (parameters / "robot_state_publisher.yaml").is_file()
    running.process.kill()
    wait_for(lambda: not left_behind(), "the end of all nodes")
    assert not parameters.exists()
