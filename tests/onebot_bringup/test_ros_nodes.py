"""The processes of a launch: their ROS arguments, in the order in which they count."""

from onebot_bringup.launch.nodes import RosNodes


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


def test_nothing_is_said_that_need_not_be(tmp_path):
    """Only a node that its module calls otherwise is renamed."""
    make = RosNodes(tmp_path, "")
    plain = make.node("viewer", "some.module", {}, on_exit="ignore")
    assert plain.on_exit == "ignore"
    assert not {"-r", "--log-level"} & set(plain.command)
    assert "__node:=viewer" in make.node("viewer", "some.module", {}, renamed=True).command
