"""``onebot topic``, on real DDS, against the very forms that ros2 prints."""

import re
import shlex
import sys
from pathlib import Path

import pytest
from geometry_msgs.msg import Twist, TwistStamped
from std_msgs.msg import String

from onebot_bringup.cli.options import Parser
from onebot_bringup.cli.topic import COMMANDS
from onebot_description.ros.wire.interfaces import TFMessage
from tests.hosts import missing
from tests.onebot_bringup.cli_support import MODULE, onebot, output_of, running
from tests.ros_support import LATCHED, Peer
from tests.support import run_to_end, skip_for, wait_for

TWIST = "geometry_msgs/msg/Twist"
SHOWN = (
    "geometry_msgs.msg.Twist(linear=geometry_msgs.msg.Vector3(x=0.2, y=0.0, z=0.0), "
    "angular=geometry_msgs.msg.Vector3(x=0.0, y=0.0, z=0.0))"
)


def test_pub_once(peer: Peer) -> None:
    """--once waits for a listener, publishes one message, prints it as ros2 does, and ends."""
    heard = peer.hear(Twist, "/cmd_vel")
    done = onebot("topic", "pub", "--once", "cmd_vel", TWIST, "{linear: {x: 0.2}}")
    assert done.returncode == 0, done.stderr
    assert done.stdout.endswith(f"publisher: beginning loop\npublishing #1: {SHOWN}\n\n")
    wait_for(lambda: heard, "the message")
    assert len(heard) == 1 and heard[0].linear.x == 0.2


def test_pub_at_a_rate(peer: Peer) -> None:
    """-r and --times: so many messages, evenly, each with the time of its sending."""
    heard = peer.hear(TwistStamped, "/cmd_vel")
    done = onebot(
        "topic", "pub", "-r", "10", "-t", "11", "-p", "5", "/cmd_vel",
        "geometry_msgs/msg/TwistStamped", "{header: auto, twist: {linear: {x: 0.2}}}",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert re.findall(r"publishing #(\d+)", done.stdout) == ["5", "10"]
    wait_for(lambda: len(heard) == 11, "11 messages")
    stamps = [m.header.stamp.sec + m.header.stamp.nanosec * 1e-9 for m in heard]
    assert stamps[-1] - stamps[0] == pytest.approx(1.0, rel=0.2)
    assert stamps == sorted(stamps) and len(set(stamps)) == 11


def test_pub_until_interrupted(ros_domain: int, tmp_path: Path) -> None:
    """Without a number it publishes until Ctrl-C (exit code 0); it reports a missing subscriber.

    Its own TFMessage replaces tf2_msgs.
    """
    with running(
        tmp_path, "topic", "pub", "-r", "10", "/tf", "tf2_msgs/msg/TFMessage",
        "{transforms: [{header: {stamp: now, frame_id: a}, child_frame_id: b}]}",
    ) as command:  # fmt: skip
        command.says("note: no subscriber of /tf")
        with Peer(ros_domain) as peer:
            heard = peer.hear(TFMessage, "/tf")
            wait_for(lambda: len(heard) > 3, "transforms")
            assert heard[0].transforms[0].child_frame_id == "b"
            assert heard[1].transforms[0].header.stamp.sec > 0
        assert command.interrupt() == 0
        assert "publishing #1: tf2_msgs.msg.TFMessage(transforms=[" in command.out
        assert "Traceback" not in command.err


def test_pub_waits_and_says_for_what(peer: Peer) -> None:
    """A listener of another type does not count, and is named; the wait can be limited."""
    peer.hear(TwistStamped, "/cmd_vel")
    done = onebot("topic", "pub", "-1", "--max-wait-time-secs", "2", "/cmd_vel", TWIST)
    assert done.returncode == 1
    assert "Waiting for at least 1 matching subscription(s)..." in done.stderr
    assert "fewer than 1 matching subscription(s) within 2 s" in done.stderr
    assert "geometry_msgs/msg/TwistStamped" in done.stderr


@pytest.mark.parametrize(
    ("words", "code", "part"),
    [
        (("/x", TWIST, "{linear: {x: .nan}}"), 1, "linear.x is a finite number"),
        (("/x", "geometry_msgs/msg/Twst"), 1, f'did you mean "{TWIST}"'),
        (("bad name", TWIST), 1, '"bad name" is not a valid name'),
        (("/rosout", TWIST, "-1"), 1, "a node can use a topic with only one type"),
        (("/x", TWIST, "-r", "0"), 2, "not above zero"),
    ],
)  # fmt: skip
def test_pub_mistakes(ros_domain: int, words: tuple[str, ...], code: int, part: str) -> None:
    """Each mistake is one line on stderr; usage exits with 2 and points to the help."""
    done = onebot("topic", "pub", *words)
    assert done.returncode == code and not done.stdout
    assert part in done.stderr and done.stderr.startswith("error: ")
    assert ("see: onebot topic pub --help" in done.stderr) == (code == 2)


def test_echo_forms(peer: Peer) -> None:
    """The forms of output: YAML, one line, values, a part, a part's value.

    The QoS suits the publisher, so that what was published before is received; type discovered.
    """
    forms = {
        (): "linear:\n  x: 0.5\n  y: 0.0\n  z: 0.0\nangular:\n  x: 0.0\n  y: 0.0\n  z: 0.0\n---\n",
        ("--flow-style", "--field", "linear"): "{x: 0.5, y: 0.0, z: 0.0}\n---\n",
        ("--field", "linear.x"): "0.5\n---\n",
        ("--filter", "any(getattr(m.linear, x) > 0.4 for x in 'xyz')", "--csv"):
            "0.5,0.0,0.0,0.0,0.0,0.0\n",
    }  # fmt: skip
    publisher = peer.node.create_publisher(Twist, "/cmd_vel", LATCHED)
    message = Twist()
    message.linear.x = 0.5
    publisher.publish(message)
    for options, expected in forms.items():
        done = onebot("topic", "echo", "--once", "/cmd_vel", *options)
        assert (done.returncode, done.stdout) == (0, expected), done.stderr
    wrong = onebot("topic", "echo", "--once", "/cmd_vel", "--field", "linar.x")
    assert wrong.returncode == 1 and 'did you mean "linear"' in wrong.stderr
    for words, code, part in (
        # With its type, the topic need not be discovered in that time.
        (
            ("geometry_msgs/msg/Twist", "--filter", "m.x > 1", "--field", "linear", "--timeout=2"),
            1,
            "no message that",
        ),
        (("--filter", "m.speed"), 1, "--filter: AttributeError: 'Twist' object has no"),
        (("--filter", "m."), 1, "--filter: SyntaxError: invalid syntax"),
    ):
        wrong = onebot("topic", "echo", "--once", "/cmd_vel", *words)
        assert wrong.returncode == code and part in wrong.stderr, wrong.stderr


def test_errors_of_dds_are_not_output(ros_domain: int) -> None:
    """Without shared memory Fast DDS logs errors: to stderr, for stdout may be a file of values."""
    if problem := missing():
        skip_for(problem)
    read_only = "mount -t tmpfs -o ro none /dev/shm && exec " + shlex.join(
        [sys.executable, "-m", MODULE, "topic", "list"]
    )
    done = run_to_end(["unshare", "--mount", "sh", "-c", read_only])
    assert done.returncode == 0, done.stderr
    assert "RTPS_TRANSPORT_SHM" in done.stderr
    assert done.stdout.split() == ["/parameter_events", "/rosout"]


def test_what_would_have_ended_by_itself_has_failed_after_ctrl_c(
    ros_domain: int, tmp_path: Path
) -> None:
    with running(tmp_path, "topic", "echo", "--once", "/later") as command:
        command.says("does not appear to be published yet")
        assert command.interrupt() == 130 and "Traceback" not in command.err
    for words, endless in (([], True), (["--once"], False), (["-t", "2"], False)):
        options = Parser("pub", "", COMMANDS["pub"].options).parse(["/later", TWIST, *words])
        assert COMMANDS["pub"].endless(options) == endless


@pytest.mark.parametrize(
    ("words", "waiting", "shown"),
    [
        (("echo", "/odom", "std_msgs/msg/String"), "no message on /odom yet", "data: x"),
        (("bw", "/odom"), "waiting for it", "B/s from"),
    ],
)
def test_it_suggests_a_like_topic_and_waits_on(
    peer: Peer, tmp_path: Path, words: tuple[str, ...], waiting: str, shown: str
) -> None:
    """Then what was asked for comes."""
    for name in ("/robot1/odom", "/robot1/status", "/odometry"):
        peer.node.create_publisher(String, name, 10)
    with running(tmp_path, "topic", *words) as command:
        command.says(waiting)
        command.says('did you mean "/robot1/odom"')
        assert "status" not in command.err
        publisher = peer.node.create_publisher(String, "/odom", 10)
        peer.node.create_timer(0.05, lambda: publisher.publish(String(data="x")))
        wait_for(lambda: shown in command.out, "what was asked for")
        assert command.interrupt() == 0 and command.err.count("did you mean") == 1


def test_echo_of_nothing(ros_domain: int) -> None:
    """--timeout ends the wait for the topic, too, with exit code 1."""
    done = onebot("topic", "echo", "/nothing", "--timeout", "0.5")
    assert done.returncode == 1 and "no topic /nothing within 0.5 s" in done.stderr


def test_list(peer: Peer) -> None:
    """Names; with types; hidden ones on request."""
    peer.node.create_publisher(String, "/chatter", 10)
    peer.node.create_publisher(String, "/_secret", 10)
    peer.hear(Twist, "/cmd_vel")
    plain = output_of("topic", "list").splitlines()
    assert plain == ["/chatter", "/cmd_vel", "/parameter_events", "/rosout"]
    typed = output_of("topic", "list", "-t", "--include-hidden-topics")
    assert typed.startswith("/_secret [std_msgs/msg/String]\n/chatter [std_msgs/msg/String]\n")


def test_info(ros_domain: int) -> None:
    """The counts; with -v each endpoint, its node and QoS."""
    with Peer(ros_domain, "talker") as peer:
        peer.node.create_publisher(String, "/chatter", LATCHED)
        assert output_of("topic", "info", "chatter") == (
            "Type: std_msgs/msg/String\nPublisher count: 1\nSubscription count: 0\n"
        )
        verbose = output_of("topic", "info", "-v", "/chatter")
        assert verbose.startswith(
            "Type: std_msgs/msg/String\n\nPublisher count: 1\n\n"
            "Node name: talker\nNode namespace: /\nTopic type: std_msgs/msg/String\n"
        )
        assert "  Durability: TRANSIENT_LOCAL\n" in verbose
        assert verbose.endswith("\n\nSubscription count: 0\n\n")
        wrong = onebot("topic", "info", "/chater")
        assert wrong.returncode == 1 and 'did you mean "/chatter"' in wrong.stderr
