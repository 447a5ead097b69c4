"""A user's own node and interfaces, as in tutorials: run from the file, and neither is built."""

import os
import sys
import sysconfig
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
from nav2_msgs.action import NavigateToPose
from nav2_msgs.msg import Costmap
from rclpy.action import ActionClient
from rclpy.action.client import ClientGoalHandle

from onebot_bringup.cli.run import run_file
from onebot_description.ros.wire import interface_text
from tests.onebot_bringup.cli_support import onebot, output_of, running
from tests.ros_support import Peer
from tests.support import run_to_end, wait_for

SERVER = """
import rclpy
from my_interfaces.srv import Sum
from nav2_msgs.action import NavigateToPose
from nav2_msgs.msg import Costmap
from rclpy.action import ActionServer
from rclpy.node import Node

from .offsets import OFFSET


class Server(Node):
    def __init__(self):
        super().__init__("server")
        self.publisher = self.create_publisher(Costmap, "shifted", 10)
        self.create_subscription(Costmap, "costmap", self.shift, 10)
        self.create_service(Sum, "sum", self.sum)
        self.action = ActionServer(self, NavigateToPose, "navigate_to_pose", self.navigate)

    def shift(self, costmap):
        costmap.data = [OFFSET + value for value in costmap.data]
        self.publisher.publish(costmap)

    def sum(self, request, response):
        response.total = sum(term.value for term in request.terms)
        return response

    def navigate(self, goal):
        x = goal.request.pose.pose.position.x
        goal.publish_feedback(NavigateToPose.Feedback(distance_remaining=x))
        goal.succeed()
        return NavigateToPose.Result(error_code=NavigateToPose.Result.NONE, error_msg=f"at {x}")


def main():
    rclpy.init()
    try:
        rclpy.spin(Server())
    except KeyboardInterrupt:
        print("orderly end", flush=True)
"""
DEFINITIONS = {
    "msg/Term.msg": 'uint8 MOST=9\nint32 value\nstring<=8 name "one"\n',
    "srv/Sum.srv": "Term[<=3] terms\n---\nint64 total\n",
    "action/Count.action": "int32 to\n---\nint32[] all\n---\nint32 at\n",
}


def write(folder: Path, files: dict[str, str]) -> Path:
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    return folder


@pytest.fixture
def workspace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A package of interfaces, and beside it one with a node, as in a workspace of colcon."""
    monkeypatch.chdir(tmp_path)
    write(tmp_path / "my_interfaces", DEFINITIONS)
    write(tmp_path / "server/server", {"server.py": SERVER, "__init__.py": ""})
    write(tmp_path / "server/server", {"offsets.py": "OFFSET = 2\n"})
    return tmp_path


@pytest.fixture
def added(workspace: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    monkeypatch.setattr(interface_text, "ADDED", workspace / "share")  # for the messages only
    command = [sys.executable, "-m", "onebot_bringup.cli.main", "interface"]
    done = run_to_end([*command, "add", "my_interfaces"])
    assert done.returncode == 0, done.stderr
    yield done.stdout
    assert run_to_end([*command, "remove", "my_interfaces"]).returncode == 0


def python(code: str, **variables: str) -> str:
    done = run_to_end([sys.executable, "-c", code], env={**os.environ, **variables})
    return done.stdout.strip() or done.stderr.strip().splitlines()[-1]


# ---- One's own interfaces ----

USE = "from my_interfaces.srv import Sum; from my_interfaces.msg import Term; print(Sum.Request())"


def test_added_interfaces(added: str) -> None:
    """They are importable, and listed; a change of a definition holds at the next start."""
    names = "my_interfaces/msg/Term, my_interfaces/srv/Sum, my_interfaces/action/Count"
    assert added.rstrip().endswith(names)
    assert python(USE) == "my_interfaces.srv.Sum_Request(terms=[])"
    stub = Path(sysconfig.get_path("purelib"), "my_interfaces-stubs/srv/__init__.pyi")
    assert "Sum_Request = Sum.Request" in stub.read_text()
    assert "'my_interfaces': ['action/Count']" in python(
        "from rosidl_runtime_py import get_action_interfaces as get; print(get(['my_interfaces']))"
    )
    Path("my_interfaces/msg/Term.msg").write_text("float64 weight\n")
    assert python(f"{USE}; print(Term())").splitlines()[1:] == [
        "my_interfaces.msg.Term(weight=0.0)"
    ]


@pytest.mark.parametrize("path", ["{0}", "{0}/my_interfaces", "/nowhere:{0}"])
def test_interfaces_on_ros_package_path(workspace: Path, path: str) -> None:
    variable = path.format(workspace)
    assert python(USE, ROS_PACKAGE_PATH=variable) == "my_interfaces.srv.Sum_Request(terms=[])"


def test_a_package_with_code_and_interfaces(workspace: Path) -> None:
    """Its code is in a folder of its name, as ament_cmake_python expects it."""
    code = write(workspace / "my_interfaces/my_interfaces", {"__init__.py": "LIMIT = 3\n"}).parent
    paths = {"PYTHONPATH": f"{os.getenv('PYTHONPATH', '')}:{code}", "ROS_PACKAGE_PATH": str(code)}
    assert python(f"{USE}; import my_interfaces; print(my_interfaces.LIMIT)", **paths) == (
        "my_interfaces.srv.Sum_Request(terms=[])\n3"
    )
    done = run_to_end(
        [sys.executable, "-m", "onebot_bringup.cli.main", "interface", "add", "my_interfaces"],
        env={**os.environ, "PYTHONPATH": paths["PYTHONPATH"]},
    )
    assert onebot("interface", "remove", "my_interfaces").returncode == 0, done.stderr


@pytest.mark.parametrize(
    ("files", "problem"),
    [
        (
            {"msg/A.msg": "int8 a\n\nfloaat b\n"},
            "/other_msgs/msg/A.msg, line 3: \"floaat b\" cannot be used: 'floaat' is an invalid",
        ),
        (
            {"srv/A.srv": "int8 a\n---\nno field\nint8 b\n"},
            '/other_msgs/srv/A.srv, line 3: "no field" cannot be used: ',
        ),
        (
            {"msg/A.msg": "int8 a\nint8 a\n"},
            '/other_msgs/msg/A.msg, line 2: "int8 a" cannot be used: the fields iterable contains',
        ),
        (
            {"msg/A.msg": "uint8 a 300\n"},
            '/other_msgs/msg/A.msg, line 1: "uint8 a 300" cannot be used: ',
        ),
        (
            {"action/A.action": "int8 a\n---\nother_msgs/B b\n---\n"},
            '/other_msgs/action/A.action, line 3: "other_msgs/B b" cannot be used: '
            "other_msgs/msg/B cannot be used: ",
        ),
        ({"msg/A.msg": "A a\n"}, '"A a" cannot be used: other_msgs/msg/A contains itself'),
        ({"srv/A.srv": "int8 a\n"}, "/other_msgs/srv/A.srv cannot be used: "),
        ({"A.msg": "int8 a\n"}, "has no file such as msg/Name.msg"),
    ],
)
def test_mistakes_in_definitions(workspace: Path, files: dict[str, str], problem: str) -> None:
    """One error names the file and the line, and nothing is added."""
    write(workspace / "other_msgs", files)
    done = onebot("interface", "add", "other_msgs")
    assert done.returncode == 1 and done.stdout == ""
    [line] = done.stderr.splitlines()
    assert line.startswith("error: ") and problem in line
    assert not (interface_text.ADDED / "other_msgs").is_symlink()


def test_what_cannot_be_added_or_removed(workspace: Path) -> None:
    write(workspace / "std_msgs", {"msg/A.msg": "int8 a\n"})
    assert "takes precedence" in onebot("interface", "add", "std_msgs").stderr
    write(workspace / "Big", {"msg/A.msg": "int8 a\n"})
    assert '"Big" is not a package name' in onebot("interface", "add", "Big").stderr
    assert 'no package "std_msgs" was added' in onebot("interface", "remove", "std_msgs").stderr
    packages = output_of("interface", "packages").splitlines()
    assert "std_msgs" in packages
    assert any(line.startswith("nav2_msgs (/") for line in packages)


# ---- Nodes from their files ----


def test_messages_services_and_actions(
    workspace: Path, ros_domain: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With another process, whose node runs from its file with remappings."""
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(workspace))
    kind = import_module("my_interfaces.srv").Sum
    term = import_module("my_interfaces.msg").Term
    words = "run", "server/server/server.py", "--ros-args", "-r", "sum:=add", "-r", "__ns:=/far"
    with running(workspace, *words) as process, Peer(ros_domain) as peer:
        terms = [term(value=value) for value in (1, 2, 39)]
        assert peer.call(kind, "/far/add", terms=terms).total == 42
        heard = peer.hear(Costmap, "/far/shifted")
        costmaps = peer.publisher(Costmap, "/far/costmap")
        wait_for(lambda: heard or costmaps.publish(Costmap(data=[1, 2, 3])), "the costmap")
        assert heard[0] == Costmap(data=[3, 4, 5])
        assert navigate(peer, "/far/navigate_to_pose") == (0, "at 2.5", [2.5])
        process.interrupt()
        assert "orderly end" in process.out


def navigate(peer: Peer, name: str) -> tuple[int, str, list[float]]:
    """Send a goal; return the result and the feedback."""
    client = ActionClient(peer.node, NavigateToPose, name)
    wait_for(client.server_is_ready, "the action server")
    goal = NavigateToPose.Goal()
    goal.pose.pose.position.x = 2.5
    seen: list[float] = []

    def send() -> Any:
        return client.send_goal_async(
            goal, lambda message: seen.append(message.feedback.distance_remaining)
        )

    sent = peer.run(send)
    wait_for(sent.done, "the goal to be accepted")
    handle: ClientGoalHandle = sent.result()
    finished = peer.run(handle.get_result_async)
    wait_for(lambda: finished.done() and seen, "the result")
    result = finished.result().result
    return result.error_code, result.error_msg, seen


SHARE = """
from ament_index_python.packages import get_package_share_directory
for package in "server", "beside", "std_msgs":
    print(get_package_share_directory(package))
"""


def test_share_folders_of_sources(workspace: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of the node's own package and those in ROS_PACKAGE_PATH, unless they are installed."""
    for package in "server", "beside", "std_msgs":
        text = f"<package><name>{package}</name></package>"
        write(workspace / package, {"package.xml": text})
    write(workspace / "server/server", {"server.py": SHARE})
    monkeypatch.setenv("ROS_PACKAGE_PATH", f"{workspace}/beside:{workspace}/std_msgs")
    command = [sys.executable, "-m", "onebot_bringup.cli.main", "run", "server/server/server.py"]
    done = run_to_end(command)
    folders = [Path(line).resolve() for line in done.stdout.splitlines()]
    installed = Path(sys.prefix, "share/std_msgs").resolve()
    assert folders == [workspace / "server", workspace / "beside", installed], done.stderr


MAIN = "def main():\n    print(__name__, sys.argv)\n    return 3\n"
ENDS = {
    "main alone, as for an entry point": MAIN,
    "a guard": f"{MAIN}if __name__ == '__main__':\n    sys.exit(main())\n",
    "a call": f"{MAIN}sys.exit(main())\n",
    "no main": "print(__name__, sys.argv)\nraise SystemExit(3)\n",
    "a relative import": f"from .neighbor import VALUE\n{MAIN.replace('3', 'VALUE')}",
}


@pytest.mark.parametrize("end", ENDS.values(), ids=ENDS.keys())
def test_a_file_is_run_once(tmp_path: Path, end: str) -> None:
    """Whichever way it begins; a package may lack __init__.py."""
    file = tmp_path / "node.py"
    (tmp_path / "neighbor.py").write_text("VALUE = 3\n")
    file.write_text(f"import sys\n{end}")
    done = run_to_end([sys.executable, "-m", "onebot_bringup.cli.main", "run", str(file), "x"])
    assert (done.returncode, done.stdout) == (3, f"__main__ ['{file}', 'x']\n"), done.stderr


@pytest.mark.parametrize(
    ("statement", "problem"),
    [
        ("import my_robot_msgs.msg", 'no interfaces "my_robot_msgs" here: get the sources'),
        ("from launch_ros.actions import Node", "apt install ros-jazzy-launch-ros"),
        ("import rospy", "a package of ROS 1"),
        ("import no_such_library", "pip install no_such_library"),
        ("from nav2_msgs.msg import Nope", "cannot import name 'Nope' from 'nav2_msgs.msg'"),
        ("import nav2_msgs.massages", "No module named 'nav2_msgs.massages'"),
    ],
)
def test_missing_imports(tmp_path: Path, restored: Callable[[], None], statement, problem) -> None:
    """One sentence says which package, and where it comes from."""
    file = tmp_path / "node.py"
    file.write_text(f"import sys\n{statement}\n")
    done = onebot("run", str(file))
    assert done.returncode == 1 and done.stdout == ""
    [line] = done.stderr.splitlines()
    assert line.startswith(f"error: {file}: ") and problem in line


@pytest.fixture
def restored(monkeypatch: pytest.MonkeyPatch) -> None:
    """``run_file`` leaves the arguments and the path to the node."""
    monkeypatch.setattr(sys, "argv", list(sys.argv))
    monkeypatch.setattr(sys, "path", list(sys.path))


def test_an_error_of_the_node_keeps_its_traceback(tmp_path: Path, restored: None) -> None:
    file = tmp_path / "node.py"
    file.write_text("1 / 0\n")
    with pytest.raises(ZeroDivisionError):
        run_file(file, [])
    assert "there is no file" in onebot("run", "nowhere.py").stderr
