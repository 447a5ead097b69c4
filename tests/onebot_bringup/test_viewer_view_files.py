"""The view that belongs to a robot."""

import os
from pathlib import Path

import pytest

from onebot_bringup.viewer.view_config import load_view, view_for


@pytest.mark.parametrize("robot", ["onebot", "mrm"])
def test_our_robots_have_a_view_in_their_description(robot):
    """It lies in the config/ of the package that describes the robot, and is valid."""
    path = view_for(robot)
    assert path is not None and path.parts[-3:] == (f"{robot}_description", "config", "view.yaml")
    load_view(path)


@pytest.mark.parametrize("robot", ["nobody", "", "../mrm", "my robot", "a/b", "é"])
def test_other_robots_have_none(robot):
    """Whatever they are called."""
    assert view_for(robot) is None


def test_a_package_of_the_user_s_own_is_found(tmp_path: Path, monkeypatch):
    """As every ROS package is; one without a view.yaml has none."""
    monkeypatch.setenv("AMENT_PREFIX_PATH", os.pathsep.join([str(tmp_path)]))
    index = tmp_path / "share/ament_index/resource_index/packages"
    index.mkdir(parents=True)
    (index / "rover_description").touch()
    config = tmp_path / "share/rover_description/config"
    config.mkdir(parents=True)
    assert view_for("rover") is None
    (config / "view.yaml").write_text("collision: true")
    assert view_for("rover") == (config / "view.yaml").resolve()
