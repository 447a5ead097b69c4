"""onebot_description.node: parameter files and names on the command line."""

from pathlib import Path

from onebot_description.node import RosArguments, ros_arguments


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
