"""Bringing up any robot with ``onebot view``."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from onebot_bringup.launch.bringup import environment
from tests.onebot_bringup.bringup_support import Transforms, bringups, stop, wait_for_robot
from tests.onebot_bringup.launcher_support import RunningCommand
from tests.support import wait_for

ARM = """<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:arg name="height" default="1.0"/>
  <link name="base"/>
  <link name="tip"><visual><geometry><mesh filename="tip.stl"/></geometry></visual></link>
  <joint name="shoulder" type="revolute">
    <parent link="base"/><child link="tip"/><origin xyz="0 0 $(arg height)"/><axis xyz="0 0 1"/>
    <limit lower="0.5" upper="1.0" effort="1" velocity="1"/>
  </joint>
</robot>"""
STL = """solid tip
facet normal 0 0 1
outer loop
vertex 0 0 0
vertex 1 0 0
vertex 0 1 0
endloop
endfacet
endsolid tip
"""
Start = Callable[..., RunningCommand]


@pytest.fixture
def arm(tmp_path: Path) -> Path:
    """A small robot with a xacro argument, and a mesh beside its file."""
    (tmp_path / "arm.xacro").write_text(ARM)
    (tmp_path / "tip.stl").write_text(STL)
    return tmp_path / "arm.xacro"


@pytest.fixture
def transforms(ros_domain: int) -> Iterator[Transforms]:
    with Transforms(ros_domain) as listener:
        yield listener


@pytest.fixture
def start(tmp_path: Path, ros_domain: int, arm: Path) -> Iterator[Start]:
    """Start ``onebot view`` on the arm."""
    with bringups(tmp_path, "onebot_bringup.cli.main", "view", arm.name, "viewer:=none") as make:
        yield make


def test_any_robot_moves_within_its_limits(start: Start, transforms: Transforms, arm: Path) -> None:
    """Without a joint file the joint swings, as does one that an edit puts in its place.

    The robot's xacro argument stands among the launcher's.
    """
    running = start("height:=2.5")
    first = wait_for_robot(running, transforms, "tip")
    assert abs(first[0] - 2.5) < 1e-9
    seen: list[float] = []

    def moved(link: str) -> bool:
        found = transforms.of(link)
        if found is not None:
            seen.append(found[1])
        return bool(seen) and max(seen) - min(seen) > 0.02

    wait_for(lambda: moved("tip"), "a movement")
    arm.write_text(ARM.replace("shoulder", "elbow").replace('"tip"', '"hand"'))
    seen.clear()
    wait_for(lambda: moved("hand"), "a movement of the new joint")
    assert "has no joint" not in running.out + running.err
    low, high = 0.2474, 0.4795  # sin(0.5 / 2), sin(1.0 / 2)
    assert low <= min(seen) and max(seen) <= high
    stop(running)


VALUES = {"discovery": "localhost", "domain_id": ""}


def test_nodes_are_seen_on_this_computer_only(monkeypatch: pytest.MonkeyPatch) -> None:
    """Unless the user has said otherwise, discovery stays on this host."""
    monkeypatch.delenv("ROS_AUTOMATIC_DISCOVERY_RANGE", raising=False)
    found = environment(VALUES, forced=False)
    assert found["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "LOCALHOST" and "ROS_DOMAIN_ID" not in found
