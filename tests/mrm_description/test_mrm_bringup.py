"""MRM from the command that users type to transforms in another process, and back to nothing."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from onebot_description.elements.packages import package_share
from tests.onebot_bringup.bringup_support import (
    Transforms,
    bringups,
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


def test_edits_of_the_joints_and_of_the_xacro_change_the_robot(
    start: Start, transforms: Transforms, tmp_path: Path
) -> None:
    """The YAML file is the robot's remote control, while it runs; the log names it alone.

    An edit of the model takes effect at once; a broken one is reported and changes nothing. All
    nodes follow it, also when a joint has gone that the YAML names.
    """
    model = tmp_path / "my_mrm.xacro"
    good = (package_share("mrm_description") / "urdf/mrm.xacro").read_text()
    model.write_text(good)
    joints = write_joints(tmp_path, 0.25)
    running = start(f"model:={model}", f"joints:={joints}")
    wait_for(transforms.turned_to(0.25, "link1"), "the robot")
    write_joints(tmp_path, -0.5)
    wait_for(transforms.turned_to(-0.5, "link1"), "the edited position")
    running.says(f"] {joints}: applied, changed: ")
    taller = good.replace('name="base_side" value="1.0"', 'name="base_side" value="2.0"')
    assert taller != good

    def height() -> float:
        found = transforms.of("link1")
        return found[0] if found else 0.0

    model.write_text(taller.replace("</robot>", ""))
    running.says("stays as it was")
    assert "my_mrm.xacro" in running.err
    transforms.latest.clear()
    wait_for(lambda: abs(height() - 0.5) < 1e-9, "the robot as it was")
    model.write_text(good)
    running.says(f"{model}: edited, the robot is unchanged")
    model.write_text(taller)
    wait_for(lambda: abs(height() - 1.0) < 1e-9, "the taller base")
    running.says(f"{model}: edited, robot_state_publisher publishes the new robot")
    model.write_text(good.replace("base_link__link_01", "elbow"))
    wait_for(transforms.turned_to(0.0, "link1"), "the renamed joint, which nothing moves")
    running.says('motions.base_link__link_01: the robot has no joint "base_link__link_01"')
    stop(running)
