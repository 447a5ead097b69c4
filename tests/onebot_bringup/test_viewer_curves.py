"""Curves: fields of any message, speeds, and joint states."""

import math

import numpy as np
import pytest
from geometry_msgs.msg import Twist, TwistStamped, Vector3
from sensor_msgs.msg import Imu, JointState
from std_msgs.msg import Bool, Float32

from onebot_bringup.viewer.core.display import Plot
from onebot_bringup.viewer.core.shown_robot import RobotToShow
from onebot_bringup.viewer.displays.curves import CurvesDisplay
from onebot_description.errors import OneBotError
from tests.onebot_bringup.drive_support import chunks, column, curve, odometry, stamps
from tests.onebot_bringup.viewer_support import (
    START_NS,
    Shown,
    show,
    stamped,
    take,
    take_joints,
)

SECOND = 10**9


def imu(x, stamp_ns=START_NS) -> Imu:
    """An acceleration."""
    message = stamped(Imu(linear_acceleration=Vector3(x=x)), stamp_ns)
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
    [stamp] = stamps(file, "/curves/a")
    assert abs(stamp - START_NS) < 10_000


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
        ("linear_acceleration", "not a number in <sensor_msgs/Imu.linear_acceleration: x, y"),
        ("linear_acceleration_covariance[9]", "index 9 is out of bounds"),
        ("linear_acceleration.x.y", "not a number in 1.0: "),
        ("header.frame_id", "not a number in 'tip'"),
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
    """And the curve is not drawn."""

    def definitions(name):
        raise OneBotError(f"no definition of {name}")

    shown = Shown(tmp_path, "curves: {lines: {a: {topic: /t, field: x}}}", definitions=definitions)
    shown.view.offer({"/t": "a/msg/B"})
    assert shown.view.tick(START_NS) == ["/t cannot be plotted: no definition of a/msg/B"]
    shown.end()


def test_curves_are_in_plots_by_name(tmp_path):
    """One by default."""
    lines = (
        "a: {topic: t, field: x}, b: {topic: t, field: y, plot: Battery}, c: {topic: t, field: z}"
    )
    shown = Shown(tmp_path, f"curves: {{window: 5.0, lines: {{{lines}}}}}")
    displays = shown.view.robot_displays
    [display] = [each for each in displays if isinstance(each, CurvesDisplay)]
    assert display.layout()[0].views == (
        Plot("curves", "Curves", 5.0, ("curves/a", "curves/c")),
        Plot("curves", "Battery", 5.0, ("curves/b",)),
    )
    shown.end()


# --- speeds ---------------------------------------------------------------------------------------


def _speeds(tmp_path, rows, held=False):
    shown = Shown(tmp_path, "speeds: {lines: {measured: {topic: v, color: [1, 2, 3]}}}")
    for seconds, linear, angular in rows:
        stamp = START_NS + round(seconds * SECOND)
        twist = Twist(linear=Vector3(x=float(linear)), angular=Vector3(z=float(angular)))
        message = TwistStamped(twist=twist) if held else odometry(0, speed=linear, turn=angular)
        take(shown.view, "v", stamped(message, stamp), stamp)
    file = shown.end()
    return [curve(file, f"/speeds/{axis}/measured") for axis in ("linear", "angular")]


@pytest.mark.parametrize("held", [False, True])
def test_speeds_are_two_curves_with_names(tmp_path, held):
    """A command holds until the next one, and lies beneath as a wide band, without an average."""
    linear, angular = _speeds(tmp_path, [(0.02 * i, 0.1 * i, -0.2 * i) for i in range(9)], held)
    np.testing.assert_allclose(linear, 0.1 * np.arange(9))
    np.testing.assert_allclose(angular, -0.2 * np.arange(9))
    # Rerun's numbers of StepAfter and Linear, Off and Average.
    look = {"names": ["measured"], "colors": [0x010203FF], "widths": [6.0 if held else 2.0]}
    look |= {"interpolation_mode": [2 if held else 1], "aggregation_policy": [1 if held else 2]}
    for axis in ("linear", "angular"):
        entity = f"/speeds/{axis}/measured"
        for name, value in look.items():
            assert column(tmp_path / "x.rrd", entity, f"SeriesLines:{name}") == [value]
        np.testing.assert_array_equal(np.diff(stamps(tmp_path / "x.rrd", entity)), 20_000_000)


# --- joint states ---------------------------------------------------------------------------------


def _plotted(tmp_path, *states):
    """The file with joint states, (names, positions, velocities) each, and what was said."""
    shown = Shown(tmp_path)
    for step, state in enumerate(states):
        take_joints(shown.view, START_NS + step, *state)
    said = shown.tick(START_NS + len(states) * 10**9)
    return shown.end(), said


def test_joint_states_are_curves_with_the_joints_names(tmp_path):
    """Positions and velocities of one flush are one chunk each, under a legend of names."""
    states = [(("left", "right"), (step, -step), (step / 2, -step / 2)) for step in range(10)]
    file, _ = _plotted(tmp_path, *states)
    for entity, factor in (("/joints/position/0", 1.0), ("/joints/velocity/0", 0.5)):
        _, rows_of_numbers = chunks(file, entity)
        assert rows_of_numbers.num_rows == len(states)
        assert column(file, entity, "SeriesLines:names") == [["left", "right"]]
        rows = column(file, entity, "Scalars:scalars")
        np.testing.assert_allclose(rows, [[factor * i, -factor * i] for i in range(10)])


def test_joint_sets_of_several_publishers_do_not_mix(tmp_path):
    """An arm's and a gripper's publisher have curves of their own; a mismatch is left out."""
    names = ("finger", "thumb")
    states = ((("arm",), (1,)), (names, (1, 1)), (("arm",), (1, 1)), ((), ()))
    file, _ = _plotted(tmp_path, *states)
    rows = [
        len(column(file, entity, "Scalars:scalars"))
        for entity in ("/joints/position/0", "/joints/position/1", "/joints/velocity/0")
    ]
    assert rows == [1, 1, 0]


def test_lists_of_joint_names_are_few(tmp_path):
    """Of a publisher whose lists never repeat, the first are shown: memory is bounded."""
    file, _ = _plotted(tmp_path, *(((f"joint{number}",), (1,)) for number in range(40)))
    for number, rows in ((31, [[1.0]]), (32, [])):
        assert column(file, f"/joints/position/{number}", "Scalars:scalars") == rows
