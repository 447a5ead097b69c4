"""Numbers of any messages as curves: values and times, and what is said of fields there are not."""

import math

import numpy as np
import pytest
from geometry_msgs.msg import Vector3
from rclpy.serialization import serialize_message
from sensor_msgs.msg import BatteryState, Imu, JointState
from std_msgs.msg import Bool, Float32, String

from onebot_bringup.viewer.displays.curves import CurvesDisplay, FieldPath
from onebot_bringup.viewer.displays.display import Plot
from onebot_bringup.viewer.shown_robot import RobotToShow
from onebot_bringup.viewer.view_config import parse_view
from onebot_description.errors import OneBotError
from onebot_description.parameters.reader import ConfigError
from onebot_description.wire.messages import time_message
from tests.onebot_bringup.drive_support import chunks, column, curve
from tests.onebot_bringup.viewer_support import (
    START_NS,
    Shown,
    show,
    take,
)

SECOND = 10**9


def imu(x, stamp_ns=START_NS) -> Imu:
    """An acceleration."""
    message = Imu(linear_acceleration=Vector3(x=x))
    message.header.stamp = time_message(stamp_ns)
    message.linear_acceleration_covariance[4] = 10 * x
    return message


def shown_curves(tmp_path, lines, *messages):
    """The file with the curves of these lines, and what was said."""
    text = ", ".join(f"{name}: {{{line}}}" for name, line in lines.items())
    view = f"{{automatic: false, curves: {{lines: {{{text}}}}}}}"
    return show(tmp_path, view, *messages)


@pytest.mark.parametrize(
    ("field", "message", "value"),
    [
        ("linear_acceleration.x", imu(1.5), 1.5),
        ("linear_acceleration_covariance[4]", imu(1.5), 15.0),
        ("header.stamp.nanosec", imu(0.0, START_NS + 7000), 7000.0),
        ("position[1]", JointState(position=[1.0, 2.0]), 2.0),
        ("cell_voltage[0]", BatteryState(cell_voltage=[3.5]), 3.5),
        ("present", BatteryState(present=True), 1.0),
        ("data", Bool(data=True), 1.0),
        ("data", Float32(data=-2.0), -2.0),
    ],
)
def test_a_number_is_a_curve(tmp_path, field, message, value):
    """Of any type, at the message's time, or when it came."""
    file, said = shown_curves(tmp_path, {"a": f"topic: /t, field: '{field}'"}, ("/t", message))
    assert said == []
    assert curve(file, "/curves/a") == [value]
    assert column(file, "/curves/a", "SeriesLines:names") == [["a"]]
    [time] = [each for each in column(file, "/curves/a", "ros_time") if each]
    assert abs(np.datetime64(time, "ns").astype(np.int64) - START_NS) < 10_000


def test_many_messages_are_one_call(tmp_path):
    """Two curves of a topic; what is not finite is a gap."""
    lines = {"x": "topic: /t, field: linear_acceleration.x, color: [1, 2, 3]"}
    lines["var"] = "topic: /t, field: 'linear_acceleration_covariance[4]'"
    values = [0.0, 1.0, math.inf, 1e300, 2.0]
    messages = [("/t", imu(x, START_NS + k * 10_000)) for k, x in enumerate(values)]
    file, said = shown_curves(tmp_path, lines, *messages)
    assert said == []
    np.testing.assert_array_equal(curve(file, "/curves/x"), [0, 1, np.nan, np.nan, 2])
    assert curve(file, "/curves/var")[1] == 10.0
    assert column(file, "/curves/x", "SeriesLines:colors") == [[0x010203FF]]


@pytest.mark.parametrize(
    ("field", "said"),
    [
        ("linear_acc.x", 'has no field "linear_acc" (did you mean "linear_acceleration"?'),
        ("linear_acceleration.w", 'has no field "w"'),
        ("linear_acceleration", "but a message of x, y, z"),
        ("linear_acceleration_covariance", "write linear_acceleration_covariance[0]"),
        ("linear_acceleration_covariance[9]", "there are 9 elements"),
        ("linear_acceleration[0]", "[0] needs an array"),
        ("linear_acceleration.x[0]", "[0] needs an array"),
        ("linear_acceleration.x.y", '"y" needs a message'),
        ("header.frame_id", "is text"),
    ],
)
def test_a_field_that_is_no_number_is_said_once(tmp_path, field, said):
    """With what there is; the other curves are drawn."""
    lines = {"bad": f"topic: /t, field: '{field}'", "good": "topic: /t, field: orientation.x"}
    file, found = shown_curves(tmp_path, lines, ("/t", imu(1.0)), ("/t", imu(2.0)))
    [sentence] = found
    assert sentence.startswith('curve "bad": ') and said in sentence
    assert chunks(file, "/curves/bad") == []
    assert curve(file, "/curves/good") == [0.0, 0.0]


@pytest.mark.parametrize("field", ["", "a b", "a.", "[0]", "a[x]", "a..b", "1a"])
def test_what_is_no_field_is_refused(field):
    """When the view is read."""
    with pytest.raises(ConfigError, match=r"curves\.lines\.a\.field: .*pose\.position\.x"):
        parse_view(f"curves: {{lines: {{a: {{topic: t, field: '{field}'}}}}}}")
    assert FieldPath("a.b[3].c[0]")._steps == ["a", "b", 3, "c", 0]  # noqa: SLF001


def test_a_topic_is_subscribed_as_it_is_published(tmp_path):
    """Not before it is; in the namespace of the robot; as another type, if that changes."""
    shown = Shown(
        tmp_path,
        "curves: {lines: {a: {topic: value, field: data}}}",
        robot=False,
        robots=[RobotToShow("/left")],
        resolve=lambda name: "/" + name.lstrip("/"),
    )
    assert "/left/value" not in shown.view.topics
    shown.view.offer({"/left/value": "std_msgs/msg/Float32", "/value": "std_msgs/msg/Bool"})
    take(shown.view, "/left/value", Float32(data=2.0))
    take(shown.view, "/value", Bool(data=True))
    shown.view.tick(START_NS)
    shown.view.offer({"/left/value": "std_msgs/msg/Bool"})
    take(shown.view, "/left/value", Bool(data=True), START_NS + SECOND)
    assert shown.view.wants("/left/value", "std_msgs/msg/Bool")
    assert curve(shown.end(), "/curves/a") == [2.0, 1.0]


def test_a_type_without_a_definition_is_said(tmp_path):
    """And bad bytes are reported."""

    def definitions(name):
        raise OneBotError(f"no definition of {name}")

    shown = Shown(tmp_path, "curves: {lines: {a: {topic: /t, field: x}}}", definitions=definitions)
    shown.view.offer({"/t": "a/msg/B"})
    assert shown.view.tick(START_NS) == ["/t cannot be plotted: no definition of a/msg/B"]
    shown.end()
    view = "curves: {lines: {a: {topic: /t, field: data}}}"
    shown = Shown(tmp_path, view)
    shown.view.offer({"/t": "std_msgs/msg/Float32"})
    shown.view.take("/t", "std_msgs/msg/Float32", bytes(serialize_message(String())), START_NS)
    shown.view.take("/t", "std_msgs/msg/Float32", b"", START_NS)
    shown.view.tick(START_NS)
    shown.end()
    assert "/t" in {topic for topic, _ in shown.bad}


def test_curves_are_in_plots_by_name(tmp_path):
    """One by default."""
    lines = (
        "a: {topic: t, field: x}, b: {topic: t, field: y, plot: Battery}, c: {topic: t, field: z}"
    )
    shown = Shown(tmp_path, f"curves: {{window: 5.0, lines: {{{lines}}}}}")
    displays = shown.view.stage.robots[0].displays
    [display] = [each for each in displays if isinstance(each, CurvesDisplay)]
    assert display.layout().views == (
        Plot("curves", "Curves", 5.0, ("curves/a", "curves/c")),
        Plot("curves", "Battery", 5.0, ("curves/b",)),
    )
    shown.end()
