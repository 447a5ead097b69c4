"""What nodes share: their ROS arguments, and warnings that are logged only so often."""

import math
from pathlib import Path

import pytest

from onebot_description.node import RosArguments, Throttled, ros_arguments


def test_files_and_names_are_found() -> None:
    """Only among the ROS arguments."""
    line = "node --params-file no.yaml --ros-args --params-file a.yaml -p rate:=5 -r x:=y"
    line += " --param jsp:zeros.a:=1.0 -p broken -- -p no:=1 --ros-args --params-file b.yaml"
    found = ros_arguments(line.split())
    assert found.files == (Path("a.yaml"), Path("b.yaml"))
    assert found.names == (("", "rate"), ("jsp", "zeros.a"))
    assert found.others == ("--params-file", "no.yaml", "-p", "no:=1")


def test_nothing_given() -> None:
    """And a dangling option is rcl's to complain about."""
    assert ros_arguments(["node", "robot.urdf"]) == RosArguments(others=("robot.urdf",))
    assert ros_arguments(["node", "--ros-args", "--params-file"]).files == ()


def test_each_kind_is_logged_once_within_its_time() -> None:
    """Another kind is logged all the same, and of one kind only the first text."""
    logged: list[str] = []
    log = Throttled(logged.append, every=math.inf)
    for kind, text in (("a", "1"), ("a", "2"), ("b", "3"), ("b", "4"), ("a", "5")):
        log(kind, text)
    assert logged == ["1", "3"]


def test_a_text_may_have_a_time_of_its_own() -> None:
    """Zero logs everything, whatever the others wait for."""
    logged: list[str] = []
    log = Throttled(logged.append, every=math.inf)
    log("a", "1")
    log("a", "2", every=0.0)
    log("a", "3")
    assert logged == ["1", "2"]


def test_a_long_text_is_cut() -> None:
    """It may name what somebody has published."""
    logged: list[str] = []
    log = Throttled(logged.append)
    log("a", "x" * 1000)
    log("b", "x" * 10**6)
    assert logged == ["x" * 1000, "x" * 1000 + "..."]


def test_a_kind_is_logged_again_when_its_time_is_over(monkeypatch: pytest.MonkeyPatch) -> None:
    """Counted from when it was logged, not from when it was last suppressed."""
    now = [100.0]
    monkeypatch.setattr("time.monotonic", lambda: now[0])
    logged: list[str] = []
    log = Throttled(logged.append, every=5.0)
    for moment in (100.0, 104.9, 105.0, 109.9, 110.0):
        now[0] = moment
        log("a", str(moment))
    assert logged == ["100.0", "105.0", "110.0"]
