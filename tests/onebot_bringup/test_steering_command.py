"""``onebot steer``, as a user starts it."""

import re
import signal
import socket
from urllib.parse import urlsplit

import pytest
from geometry_msgs.msg import Twist
from std_msgs.msg import String

from tests.onebot_bringup.bringup_support import MARK
from tests.onebot_bringup.cli_support import Running, onebot, output_of, running
from tests.onebot_bringup.steering_support import PageClient
from tests.orphans import marked
from tests.ros_support import LATCHED, Peer
from tests.support import PATIENCE, wait_for

QUIET = ("port:=0", "open_browser:=false")


def _address(command: Running) -> str:
    def printed() -> re.Match[str] | None:
        assert command.process.poll() is None, command.err
        return re.search(r"open (http://\S+)\n", command.out)

    found = wait_for(printed, "the page's address")
    assert found is not None
    return found[1]


def test_help_says_how_to_use_it():
    """The arguments, what the hands do, and how to reach it from elsewhere."""
    done = onebot("steer", "--help")
    assert done.returncode == 0
    for word in ("[ROBOT|TOPIC]", "space bar", "ssh -L", "host:=127.0.0.1", "max_linear:=0.0"):
        assert word in done.stdout


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (["rate:=1"], 2, "rate:=1 is not possible; write a number from 5 to 100"),
        (["hots:=0.0.0.0"], 2, 'no argument "hots" (did you mean "host"?'),
        (["/a", "topic:=/b"], 2, "write the topic or topic:=, not both"),
        (["viewer:=none", "view:=none"], 2, "leave out view:="),
        (["view:=nowhere.yaml"], 1, "error: view:=nowhere.yaml: no such file"),
        (["a//b", "viewer:=none"], 1, 'error: "a//b" is no name'),
        (["host:=192.0.2.77"], 1, "error: host:=192.0.2.77 is not an address of this computer"),
    ],
)
def test_mistakes(ros_domain, words, code, message):
    """One line, and where to read more on arguments; nothing is started."""
    done = onebot("steer", *words)
    assert done.returncode == code and message in done.stderr
    assert ("see: onebot steer --help" in done.stderr) == (code == 2)
    assert "Traceback" not in done.stderr and "looking for" not in done.stderr + done.stdout


def test_it_steers_the_topic_named_and_ends_with_ctrl_c(ros_domain, tmp_path, monkeypatch):
    """The page drives; Ctrl-C stops the robot, ends with 0 and leaves no process."""
    monkeypatch.setenv(MARK, str(tmp_path))
    words = ("steer", "viewer:=none", "/cmd_vel", "max_linear:=0.4", *QUIET)
    with Peer(ros_domain) as peer, running(tmp_path, *words) as command:
        heard = peer.hear(Twist, "/cmd_vel")
        with PageClient(_address(command)) as page:
            wait_for(lambda: page.state["listeners"], "the robot")
            page.hold(1.0)
            wait_for(lambda: heard, "commands")
            assert command.interrupt() == 0
        wait_for(lambda: heard[-1].linear.x == 0.0, "the robot to be stopped")
        assert {message.linear.x for message in heard} == {0.4, 0.0}
        assert marked(str(tmp_path)) == []


def test_without_a_viewer_it_starts_one(ros_domain, tmp_path, monkeypatch):
    """The page gets a view, though the robot came without."""
    monkeypatch.setenv(MARK, str(tmp_path))
    with running(tmp_path, "steer", *QUIET) as command:
        with PageClient(_address(command)) as page:
            wait_for(lambda: page.state["view"], "the view")
        assert "looking for the robot's view" in command.err and "starting one" in command.out
        command.process.send_signal(signal.SIGINT)
        assert command.process.wait(PATIENCE) == 0
        assert marked(str(tmp_path)) == []


def _page(port: int) -> str:
    return f"http://127.0.0.1:{port}/?url=rerun%2Bhttp://127.0.0.1:9876/proxy"


@pytest.mark.parametrize("elsewhere", [False, True])
def test_a_viewer_that_does_not_answer_is_none(ros_domain, tmp_path, elsewhere):
    """Its last word may outlive it, and it may be another computer's: one is started."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        page = _page(port).replace("127.0.0.1", "192.0.2.7") if elsewhere else _page(port)
        if not elsewhere:
            server.close()
        with Peer(ros_domain) as peer:
            viewer = peer.node.create_publisher(String, "/left/rerun_viewer/page", LATCHED)
            viewer.publish(String(data=page))
            peer.node.declare_parameter("frame_prefix", "a/")
            if elsewhere:
                peer.node.create_publisher(String, "/left/robot_description", LATCHED)
            with running(tmp_path, "steer", "namespace:=left", *QUIET) as command:
                wait_for(lambda: "starting one" in command.out, "a viewer of its own")
                _address(command)
                wait_for(lambda: "steering_viewer" in peer.node.get_node_names(), "its node")
                # As the node that publishes the robot has it, or as a bringup would.
                prefix = output_of("param", "get", "/left/steering_viewer", "frame_prefix")
                assert prefix.split()[-1] == ("a/" if elsewhere else "left/")
                assert command.interrupt() == 0


def test_with_a_viewer_it_starts_none(ros_domain, tmp_path):
    """The robot's own view is beside the pad."""
    with Peer(ros_domain) as peer, socket.create_server(("127.0.0.1", 0)) as server:
        viewer = peer.node.create_publisher(String, "/left/rerun_viewer/page", LATCHED)
        viewer.publish(String(data=_page(server.getsockname()[1])))
        with running(tmp_path, "steer", "namespace:=left", *QUIET) as command:
            with PageClient(_address(command)) as page:
                wait_for(lambda: page.state["view"], "the view")
                assert page.state["topic"] == "/left/velocity_controller/cmd_vel"
            assert "steering_viewer" not in command.out
            assert command.interrupt() == 0


def test_other_computers_need_the_token_that_it_prints(ros_domain, tmp_path):
    """host:=0.0.0.0 is warned of, and its address holds a token."""
    words = ("steer", "host:=0.0.0.0", "viewer:=none", *QUIET)
    with running(tmp_path, *words) as command:
        assert len(urlsplit(_address(command)).query) > len("token=") + 20
        command.says("other computers can reach the page")
        # A page that is started again has to come back at the same address.
        token = output_of("param", "get", "/steering_page", "token").split()[-1]
        assert urlsplit(_address(command)).query == f"token={token}"
        assert command.interrupt() == 0
