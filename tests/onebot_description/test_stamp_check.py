"""Stamps of a clock that is off: which are noticed, which are not, and by the nodes on DDS."""

import struct
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import TwistStamped
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from onebot_description.ros.stamp_check import StampCheck
from onebot_description.ros.wire.cdr import ENCAPSULATION, HEADER, stamp_at
from onebot_description.ros.wire.interfaces import TFMessage
from onebot_description.ros.wire.messages import time_message
from onebot_description.timing import NS_PER_S
from tests.ros_support import NodeProcess, Peer, ros_args
from tests.support import wait_for

NOW = 1_795_000_000 * NS_PER_S
ROBOT = Path(__file__).parents[2] / "onebot_description/urdf/onebot.urdf.xacro"
TOPIC = "/joint_states"


class Checked:
    """Messages at 10 Hz, by a clock that is ``offset`` seconds ahead; what was logged."""

    def __init__(self, *, simulated: bool = False) -> None:
        self.log: list[str] = []
        self.now = NOW
        self.check = StampCheck(TOPIC, self.log.append, lambda: simulated)

    def run(self, offset: Callable[[float], float], seconds: float = 20.0) -> list[str]:
        for number in range(round(10 * seconds)):
            self.now += NS_PER_S // 10
            self.check.take(self.now + round(offset(number / 10) * NS_PER_S), self.now)
        return self.log


@pytest.mark.parametrize(
    ("offset", "text"),
    [(3.0, "3.0 s ahead of"), (-3.0, "3.0 s behind"), (0.6, "0.6 s ahead"), (-86400, "86400.0 s")],
)
def test_a_clock_that_is_off_is_named_once(offset: float, text: str) -> None:
    [warning] = Checked().run(lambda _: offset)
    assert warning.startswith(f"stamps of {TOPIC} are {text}") and "chrony or NTP" in warning


@pytest.mark.parametrize(
    "offset",
    [
        lambda _: 0.4,
        lambda t: -3.0 if int(t) % 4 else 0.0,  # late now and then
        lambda t: -2.0 - t,  # an old message again and again
        lambda t: -3.0 if t < 3.0 else 0.0,  # what waited while a link was cut
        lambda _: -NOW / NS_PER_S,  # no stamp
        lambda t: t - NOW / NS_PER_S,  # simulated time
    ],
)
def test_what_is_no_other_clock(offset: Callable[[float], float]) -> None:
    assert Checked().run(offset) == []


def test_simulated_time_is_no_other_clock() -> None:
    assert Checked(simulated=True).run(lambda _: 3.0) == []


def test_this_computers_clock_may_be_set_back() -> None:
    checked = Checked()
    checked.run(lambda _: 0.0)
    checked.now -= 3600 * NS_PER_S
    assert len(checked.run(lambda _: 3.0)) == 1


def test_stamp_of_serialized_messages() -> None:
    header = Header(stamp=Time(sec=5, nanosec=7))
    assert stamp_at(serialize_message(JointState(header=header)), HEADER) == 5 * NS_PER_S + 7
    assert stamp_at(serialize_message(TwistStamped(header=header)), HEADER) == 5 * NS_PER_S + 7
    transforms = TFMessage()
    assert stamp_at(serialize_message(transforms), HEADER + 4) == 0
    assert stamp_at(ENCAPSULATION + b"\0" * 7, HEADER) == 0
    assert stamp_at(b"\0\0\0\0" + struct.pack(">II", 5, 7), HEADER) == 0


def publish(peer: Peer, message: type, topic: str, ahead: float) -> None:
    """Publish at 10 Hz by a clock that is ``ahead`` s ahead."""
    publisher = peer.node.create_publisher(message, topic, 10)

    def send() -> None:
        stamp = time_message(time.time_ns() + round(ahead * NS_PER_S))
        publisher.publish(message(header=Header(stamp=stamp)))

    peer.node.create_timer(0.1, send)


@pytest.mark.slow
def test_nodes_warn_of_a_host_whose_clock_is_off(ros_domain: int, tmp_path: Path) -> None:
    far = ("-r", "__ns:=/far")
    recording = ros_args(viewer="none", save=tmp_path / "far.rrd")
    nodes = {
        "onebot_description.robot_state_publisher": (str(ROBOT), "--ros-args", *far),
        "onebot_bringup.viewer.rerun_viewer": (*recording, *far),
        "onebot_control.velocity_controller": (str(ROBOT),),
    }
    joints, commands = "/far/joint_states", "/velocity_controller/cmd_vel"
    with ExitStack() as stack:
        peer = stack.enter_context(Peer(ros_domain))
        state, viewer, controller = (
            stack.enter_context(NodeProcess(module, *words)) for module, words in nodes.items()
        )
        publish(peer, JointState, joints, 3.0)
        publish(peer, TwistStamped, commands, -3.0)
        for node in (state, viewer):
            wait_for(lambda n=node: f"stamps of {joints} are " in n.output, "a warning")
            assert "ahead of this computer's clock: synchronize the clocks" in node.output
        wait_for(lambda: f"stamps of {commands} are " in controller.output, "a warning")
        assert "behind this computer's clock: synchronize the clocks" in controller.output
