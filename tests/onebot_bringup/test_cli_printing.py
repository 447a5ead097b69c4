"""Messages as text, against the very forms that ros2 prints."""

import pytest
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseWithCovariance, Twist
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from onebot_bringup.introspection.message_text import Style, pick, to_csv, to_yaml
from onebot_bringup.introspection.rates import Bandwidth, Delays, Intervals
from onebot_description.errors import OneBotError


def joint_state() -> JointState:
    state = JointState(name=["a", "b"], position=[0.5, -1.0])
    state.header.stamp.sec = 3
    state.header.frame_id = "base"
    return state


def test_yaml() -> None:
    """Block style: fields in their order, lists as items, empty ones as []."""
    assert to_yaml(joint_state()) == (
        "header:\n  stamp:\n    sec: 3\n    nanosec: 0\n  frame_id: base\n"
        "name:\n- a\n- b\nposition:\n- 0.5\n- -1.0\nvelocity: []\neffort: []\n"
    )


def test_flow_style() -> None:
    """On one line, with braces."""
    assert to_yaml(Twist(), Style(flow=True)) == (
        "{linear: {x: 0.0, y: 0.0, z: 0.0}, angular: {x: 0.0, y: 0.0, z: 0.0}}\n"
    )


def test_without_the_items_of_lists() -> None:
    """--no-arr shows type and length, of sequences and arrays."""
    text = to_yaml(joint_state(), Style(arrays=False))
    assert "name: '<sequence type: string, length: 2>'\n" in text
    assert "position: '<sequence type: double, length: 2>'\n" in text
    assert "covariance: '<array type: double[36]>'\n" in to_yaml(
        PoseWithCovariance(), Style(arrays=False)
    )
    status = DiagnosticStatus(values=[KeyValue()])
    assert "<sequence type: diagnostic_msgs/msg/KeyValue, length: 1>" in to_yaml(
        status, Style(arrays=False)
    )


def test_without_strings() -> None:
    """--no-str shows their lengths."""
    assert to_yaml(String(data="abc"), Style(strings=False)) == "data: '<string length: <3>>'\n"


def test_long_values_are_cut() -> None:
    """128 items or characters, and dots; all of them on request."""
    state = JointState(position=[1.0] * 200)
    assert to_yaml(state).count("- 1.0\n") == 128 and "- '...'\n" in to_yaml(state)
    assert to_yaml(state, Style(longest=None)).count("- 1.0\n") == 200
    assert to_yaml(String(data="x" * 200)) == f"data: {'x' * 128}...\n"


def test_csv() -> None:
    """All values in order, separated by commas."""
    assert to_csv(joint_state()) == "3,0,base,a,b,0.5,-1.0"
    assert to_csv(joint_state(), Style(arrays=False)).endswith("<sequence type: double, length: 0>")
    assert to_csv(JointState(position=[1.0] * 3), Style(longest=2)) == "0,0,,1.0,1.0,..."
    assert to_csv(2.5) == "2.5"


def test_pick() -> None:
    """A path of names and indices leads to a part."""
    assert pick(joint_state(), "header.stamp.sec") == 3
    assert pick(joint_state(), "position[1]") == -1.0
    assert pick(joint_state(), "name") == ["a", "b"]


@pytest.mark.parametrize(
    ("path", "part"),
    [
        ("heder.stamp", 'did you mean "header"'),
        ("header.stamp.sec.x", "nothing within a int"),
        ("position[9]", "the list has 2"),
        ("position[x]", "no item [x]"),
        ("header[0]", "no item [0]"),
    ],
)
def test_no_such_part(path: str, part: str) -> None:
    """A wrong path is refused with what there is."""
    with pytest.raises(OneBotError) as caught:
        pick(joint_state(), path)
    assert part in str(caught.value)


def test_rate() -> None:
    """The form of ros2 topic hz; nothing without news; a clock that jumps back starts anew."""
    meter = Intervals(10)
    assert meter.report() is None
    for step in range(4):
        meter.arrived(10.0 + step * 0.25)
    assert meter.report() == (
        "average rate: 4.000\n\tmin: 0.250s max: 0.250s std dev: 0.00000s window: 3"
    )
    assert meter.report() is None
    meter.arrived(1.0)
    assert meter.report() is None
    meter.arrived(2.0)
    assert (meter.report() or "").startswith("average rate: 1.000\n")


def test_rate_of_a_window() -> None:
    """Only the last intervals count."""
    meter = Intervals(2)
    for moment in (0.0, 5.0, 6.0, 8.0):
        meter.arrived(moment)
    assert meter.report() == (
        "average rate: 0.667\n\tmin: 1.000s max: 2.000s std dev: 0.50000s window: 2"
    )


def test_bandwidth_and_delay() -> None:
    """The forms of ros2 topic bw and delay."""
    meter = Bandwidth(10)
    for moment in (0.0, 1.0):
        meter.arrived(moment, 1500)
    assert meter.report(2.0) == (
        "1.50 KB/s from 2 messages\n\tMessage size mean: 1.50 KB min: 1.50 KB max: 1.50 KB"
    )
    ages = Delays(10)
    for age in (0.1, 0.3):
        ages.arrived(age)
    assert ages.report() == (
        "average delay: 0.200\n\tmin: 0.100s max: 0.300s std dev: 0.10000s window: 2"
    )
