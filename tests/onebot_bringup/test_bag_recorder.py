"""The recorder on real DDS: what a peer publishes is what an independent reader finds."""

import re
import signal
import time

from geometry_msgs.msg import TransformStamped, Twist, TwistStamped
from nav_msgs.msg import Odometry
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from onebot_description.ros.wire.interfaces import TFMessage
from tests.onebot_bringup.bag_support import read_all, read_growing
from tests.ros_support import LATCHED, NodeProcess, Peer, ros_args
from tests.support import wait_for

MODULE = "onebot_bringup.bags.bag_recorder"
COMMANDS = "/velocity_controller/cmd_vel"
MANY = QoSProfile(depth=1000)
HASHES = get_typestore(Stores.ROS2_JAZZY)


def record(folder, *more, **parameters):
    return NodeProcess(MODULE, *ros_args(folder=str(folder), **parameters), *more)


def counted(folder, topic):
    """How many messages of ``topic`` the recording that still grows holds by now."""
    return sum(name == topic for name, _, _ in read_growing(folder))


class Published:
    """A topic of the peer: what it sends, and the bytes of that on the wire."""

    def __init__(self, peer, kind, topic, qos=MANY):
        self.kind, self.sent, self.bytes = kind, [], []
        # The recorder, and this.
        peer.node.create_subscription(kind, topic, self.bytes.append, qos, raw=True)
        self._publisher = peer.publisher(kind, topic, qos, subscribers=2)

    def send(self, *messages):
        for message in messages:
            self.sent.append(message)
            self._publisher.publish(message)


def different(kind, number):
    """A message of ``kind`` that no other number gives."""
    message = kind()
    if kind is TFMessage:
        message.transforms = [TransformStamped(child_frame_id=f"frame {number}")]
    elif kind is String:
        message.data = f"word {number}"
    elif kind is Twist:
        message.linear.x = float(number)
    else:
        message.header.stamp.sec = number
    return message


def test_records_every_message(tmp_path, peer):
    """Types, bytes, order, QoS and hashes of the robot's topics are as published."""
    folder = tmp_path / "run"
    with record(folder) as node:
        wait_for(folder.is_dir, "the recording")
        topics = {}
        for topic, kind, qos in (
            ("/tf", TFMessage, MANY),
            ("/joint_states", JointState, MANY),
            ("/velocity_controller/odom", Odometry, MANY),
            ("/robot_description", String, LATCHED),
            ("/velocity_controller/cmd_vel", Twist, MANY),
            ("/other/topic", TwistStamped, MANY),
        ):
            topics[topic] = Published(peer, kind, topic, qos)
            count = 1 if qos is LATCHED else 200
            topics[topic].send(*(different(kind, number) for number in range(count)))
        total = sum(len(published.sent) for published in topics.values())
        wait_for(lambda: len(read_growing(folder)) >= total, "all messages in the recording")
        assert node.interrupt() == 0
        assert f"recording to {folder}" in node.output
        assert f"recorded {total} messages of 6 topics" in node.output
    found, connections = read_all(folder)
    stamps = [stamp for _, stamp, _ in found]
    assert stamps == sorted(stamps)
    for topic, published in topics.items():
        recorded = [data for name, _, data in found if name == topic]
        # On its way to another process, DDS pads a message to a multiple of four bytes.
        assert [data.ljust(-(-len(data) // 4) * 4, b"\0") for data in published.bytes] == recorded
        assert [deserialize_message(data, published.kind) for data in recorded] == published.sent
        assert connections[topic].digest == HASHES.hash_rihs01(connections[topic].msgtype)
        (qos,) = connections[topic].ext.offered_qos_profiles
        latched = topic == "/robot_description"
        assert qos.durability.name == ("TRANSIENT_LOCAL" if latched else "VOLATILE")
        assert qos.reliability.name == "RELIABLE"
    assert set(connections) == set(topics)  # nothing hidden, no /rosout


def test_loss(tmp_path, peer):
    """What was published while the recorder was stopped is missing, and it says so."""
    folder = tmp_path / "run"
    with record(folder) as node:
        states = peer.publisher(JointState, "/joint_states", QoSProfile(depth=1))
        send = lambda: states.publish(JointState())  # noqa: E731
        wait_for(lambda: send() or counted(folder, "/joint_states"), "a message")
        node.process.send_signal(signal.SIGSTOP)
        for _ in range(1000):  # more than fits into what DDS has on the way
            states.publish(JointState(name=["joint" * 4000]))
            time.sleep(0.001)
        node.process.send_signal(signal.SIGCONT)
        lost = "/joint_states: [0-9]+ messages lost so far"
        wait_for(lambda: send() or re.search(lost, node.output), "a warning of the loss")
        assert node.interrupt() == 0
        assert re.search(f"to {folder}, [0-9]+ were lost", node.output)


def test_suits_every_publisher(tmp_path, ros_domain, peer):
    """Best effort, alone or beside a reliable one; latched before; of a type others do not want."""
    folder, words = tmp_path / "run", "/words"
    best_effort = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
    with Peer(ros_domain, "driver") as driver:
        peer.node.create_publisher(String, "/early", LATCHED).publish(String(data="before"))
        peer.hear(Twist, COMMANDS)
        with record(folder):
            sensor = peer.publisher(JointState, "/joint_states", best_effort)
            commands = driver.publisher(TwistStamped, COMMANDS)
            reliable = peer.publisher(String, words, MANY)

            def send(topic, publisher, message, text=b""):
                publisher.publish(message)
                found = read_growing(folder)
                return any(name == topic and text in data for name, _, data in found)

            for sent in (
                ("/joint_states", sensor, JointState()),
                (COMMANDS, commands, TwistStamped()),
                (words, reliable, String(data="reliable")),
            ):
                wait_for(lambda: send(*sent), f"a message of {sent[0]}")  # noqa: B023
            other = peer.publisher(String, words, best_effort)
            message = words, other, String(data="best effort"), b"best effort"
            wait_for(lambda: send(*message), "a message of the other publisher")
            wait_for(lambda: counted(folder, "/early") == 1, "the latched message")
    _, connections = read_all(folder)
    [offered] = connections["/joint_states"].ext.offered_qos_profiles
    assert offered.reliability.name == "BEST_EFFORT"
    assert connections[COMMANDS].msgtype == "geometry_msgs/msg/TwistStamped"
    with Reader(folder) as reader:
        assert [one.topic for one in reader.connections].count(words) == 1


def test_wanted_topics_in_simulated_time(tmp_path, peer):
    """Only topics:=[...], relative to the namespace; stamped by /clock, latched before it, too."""
    folder = tmp_path / "run"
    peer.node.create_publisher(String, "/left/robot_description", LATCHED).publish(String())
    peer.node.create_publisher(String, "/words", LATCHED).publish(String(data="no"))
    words = peer.node.create_publisher(String, "/left/words", MANY)
    parameters = {"use_sim_time": True, "topics": "[words, robot_description]"}
    with record(folder, "-r", "__ns:=/left", **parameters) as node:
        clock = peer.publisher(Clock, "/clock")
        wait_for(lambda: "waiting for the first message on /clock" in node.output, "a notice")
        assert words.get_subscription_count() == 0
        tick = Clock()
        tick.clock.sec = 42

        def recorded():
            clock.publish(tick)
            words.publish(String())
            return counted(folder, "/left/words") and counted(folder, "/left/robot_description")

        wait_for(recorded, "both topics")
        assert node.output.count("waiting for") == 1
    found, connections = read_all(folder)
    assert {stamp for _, stamp, _ in found} == {42 * 10**9}
    assert set(connections) == {"/left/words", "/left/robot_description"}
