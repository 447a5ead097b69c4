"""``onebot steer``, as a user starts it."""

import re
from urllib.parse import urlsplit
from urllib.request import Request

import pytest
from geometry_msgs.msg import Twist
from std_msgs.msg import String

from onebot_bringup.cli.session import Session
from onebot_bringup.cli.steer import robot_parameters, run
from onebot_description.errors import OneBotError, UsageError
from tests.onebot_bringup.cli_support import running
from tests.onebot_bringup.steering_support import PageClient, cookie_of, requested
from tests.orphans import marked
from tests.ros_support import LATCHED
from tests.support import RunningProcess, wait_for

QUIET = ("port:=0", "open_browser:=false")


def _address(command: RunningProcess) -> str:
    def printed() -> re.Match[str] | None:
        assert command.process.poll() is None, command.err
        return re.search(r"open (http://\S+)\n", command.out)

    found = wait_for(printed, "the page's address")
    assert found is not None
    return found[1]


def test_help_says_how_to_use_it(capsys):
    """The arguments, what the hands do, and how to reach it from elsewhere."""
    assert run(["--help"]) == 0
    out = capsys.readouterr().out
    for word in ("[ROBOT|TOPIC]", "space bar", "ssh -L", "host:=127.0.0.1", "max_linear:=0.0"):
        assert word in out


@pytest.mark.parametrize(
    ("words", "error", "message"),
    [
        (["/a", "topic:=/b"], UsageError, "write the topic or topic:=, not both"),
        (["view:=nowhere.yaml"], OneBotError, "^view:=nowhere.yaml: no such file"),
        (["host:=192.0.2.77"], OneBotError, "^host:=192.0.2.77 is not an address of this computer"),
        (["a//b", "viewer:=none"], OneBotError, '"a//b" is not a valid name'),
    ],
)
def test_mistakes_are_found_before_anything_starts(ros_domain, capsys, words, error, message):
    with pytest.raises(error, match=message):
        run(words)
    assert capsys.readouterr() == ("", "")


def test_it_steers_the_topic_named_and_ends_with_ctrl_c(peer, tmp_path, monkeypatch):
    """The page drives; Ctrl-C stops the robot, ends with 0 and leaves no process.

    Other computers need the token that it prints.
    """
    monkeypatch.setenv("ONEBOT_TEST_MARK", str(tmp_path))
    words = ("steer", "viewer:=none", "/cmd_vel", "max_linear:=0.4", "host:=0.0.0.0", *QUIET)
    with running(tmp_path, *words) as command:
        heard = peer.hear(Twist, "/cmd_vel")
        address = _address(command)
        command.says("other computers can reach the page")
        token = urlsplit(address).query.removeprefix("token=")
        assert len(token) > 20
        cookie, _, attributes = cookie_of(address).partition(";")
        assert "HttpOnly" in attributes and "SameSite=Strict" in attributes
        assert token not in cookie
        for path in ("", "static/page.js", "tools/nodes", "?token=wrong"):
            with requested(Request(f"{address.partition('?')[0]}{path}")) as answer:
                assert answer.status == 403
                assert b"open the whole address that was printed" in answer.read()
        with PageClient(address, Cookie=cookie) as page:
            wait_for(lambda: page.state["listeners"], "the robot")
            page.hold(1.0)
            wait_for(lambda: heard, "commands")
            assert command.interrupt() == 0
        wait_for(lambda: heard[-1].linear.x == 0.0, "the robot to be stopped")
        assert {message.linear.x for message in heard} == {0.4, 0.0}
        assert marked(str(tmp_path)) == []


VIEW = "http://127.0.0.1:9090/?url=rerun%2Bhttp://127.0.0.1:9876/proxy"


def test_where_no_viewer_answers_it_starts_one(peer, tmp_path, monkeypatch):
    """The page gets a view, whose frames are named as by the node that publishes the robot."""
    monkeypatch.setenv("ONEBOT_TEST_MARK", str(tmp_path))
    viewer = peer.node.create_publisher(String, "/left/rerun_viewer/page", LATCHED)
    viewer.publish(String(data=VIEW.replace("127.0.0.1", "192.0.2.7")))
    peer.node.declare_parameter("frame_prefix", "a/")
    peer.node.create_publisher(String, "/left/robot_description", LATCHED)
    with running(tmp_path, "steer", "namespace:=left", *QUIET) as command:
        with PageClient(_address(command)) as page:
            wait_for(lambda: page.state["view"], "the view")
        assert "looking for the robot's view" in command.err and "starting one" in command.out
        assert peer.parameter("/left/steering_viewer", "frame_prefix") == "a/"
        assert command.interrupt() == 0
    assert marked(str(tmp_path)) == []


def test_frames_of_a_robot_yet_to_come_are_named_as_by_a_bringup(ros_domain):
    with Session(["-r", "__ns:=/left"]) as session:
        assert robot_parameters(session) == {"frame_prefix": "left/"}
    with Session() as session:
        assert robot_parameters(session) == {"frame_prefix": ""}


def test_with_a_viewer_it_starts_none(peer, tmp_path):
    """The robot's own view is beside the pad."""
    viewer = peer.node.create_publisher(String, "/left/rerun_viewer/page", LATCHED)
    viewer.publish(String(data=VIEW))
    with running(tmp_path, "steer", "namespace:=left", *QUIET) as command:
        with PageClient(_address(command)) as page:
            wait_for(lambda: page.state["view"], "the view")
            assert page.state["topic"] == "/left/velocity_controller/cmd_vel"
        assert "steering_viewer" not in command.out
        assert command.interrupt() == 0
