"""Messages that are written without ROS are as rclpy reads them."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Header, String

from onebot_bringup.viewer.robot_messages import (
    RobotMessages,
    published_description,
    published_transforms,
)
from onebot_description.description import parse_description
from onebot_description.ros.wire.interfaces import TFMessage
from onebot_description.ros.wire.messages import time_message, transforms_message

ARM = """<robot name="arm"><link name="base"/><link name="one"/><link name="two"/>
  <joint name="shoulder" type="continuous"><parent link="base"/><child link="one"/></joint>
  <joint name="wrist" type="continuous"><parent link="one"/><child link="two"/></joint></robot>"""
NAMES = st.text(st.characters(exclude_characters="\0", codec="utf-8"), max_size=12)
STAMPS = st.integers(0, 2**31 * 10**9 - 1)


@given(NAMES)
def test_a_description(text: str) -> None:
    topic, kind, data = published_description("/d", text)
    assert (topic, kind) == ("/d", "std_msgs/msg/String")
    assert deserialize_message(data, String) == String(data=text)


@given(STAMPS, st.lists(st.tuples(NAMES, NAMES), max_size=4), st.floats(allow_nan=False))
def test_transforms(stamp_ns: int, frames: list[tuple[str, str]], number: float) -> None:
    parents, children = [parent for parent, _ in frames], [child for _, child in frames]
    values = number + np.arange(7.0 * len(frames)).reshape(-1, 7)
    message = transforms_message(time_message(stamp_ns), parents, children, values)
    topic, kind, data = published_transforms("/tf", stamp_ns, parents, children, values)
    assert (topic, kind) == ("/tf", "tf2_msgs/msg/TFMessage")
    assert deserialize_message(data, TFMessage) == message


@given(STAMPS, st.floats(-9.0, 9.0))
def test_joint_states(stamp_ns: int, position: float) -> None:
    robot = RobotMessages(parse_description(ARM), "left")
    header = Header(stamp=time_message(stamp_ns))
    state = JointState(header=header, name=["shoulder", "wrist"], position=[position, 0.5])
    topic, kind, data = robot.moving(stamp_ns, np.array([position, 0.5]))[1]
    assert (topic, kind) == ("/left/joint_states", "sensor_msgs/msg/JointState")
    assert deserialize_message(data, JointState) == state
