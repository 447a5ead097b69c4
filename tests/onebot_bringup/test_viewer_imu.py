"""Inertial sensors: the arrows in the file."""

import numpy as np
import pytest
from sensor_msgs.msg import Imu

from onebot_description.ros.wire.message_arrays import TfArrays
from tests.onebot_bringup.drive_support import column, frames, stamps
from tests.onebot_bringup.viewer_support import START_NS, Shown, drawn, show, stamped, take_tf

ENTITY, TOPIC = "/imu/imu", "/imu"
LEFT = (0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5))  # a quarter of a turn about z


def imu(rotation=(0.0, 0.0, 0.0, 1.0), acceleration=(0.0, 0.0, 9.8), frame="tip", at=0) -> Imu:
    """A message with a covariance of zeros: nothing is known of it."""
    message = stamped(Imu(), START_NS + at, frame)
    turn, force = message.orientation, message.linear_acceleration
    turn.x, turn.y, turn.z, turn.w = map(float, rotation)
    force.x, force.y, force.z = map(float, acceleration)
    return message


def arrows(file):
    """The arrows of each row, (N, 3)."""
    rows = column(file, ENTITY, "Arrows3D:vectors")
    return [np.array(row).reshape(-1, 3) for row in rows]


def test_axes_and_acceleration(tmp_path):
    """At the sensor's frame, the acceleration in the axes that were measured."""
    file = drawn(tmp_path, "", (TOPIC, imu(LEFT, (2.0, 0.0, 10.0))))
    [found] = arrows(file)
    wanted = [(0, 0.3, 0), (-0.3, 0, 0), (0, 0, 0.3), (0, 0.1, 0.5)]
    np.testing.assert_allclose(found, wanted, atol=1e-6)
    assert frames(file, ENTITY) == ["tip"]
    [colors] = column(file, ENTITY, "Arrows3D:colors")
    assert colors[3] == 0xFFB020FF and len(set(colors)) == 4


def test_the_orientation_is_that_in_the_fixed_frame(tmp_path):
    """The sensor's frame has turned by as much: in it, there is no turn left."""
    shown = Shown(tmp_path, "fixed_frame: odom", robot=False)
    turned = TfArrays(("odom",), ("tip",), np.array([START_NS]), np.ones((1, 3)), np.array([LEFT]))
    take_tf(shown.view, turned)
    shown.send(TOPIC, imu(LEFT))
    [found] = arrows(shown.end())
    np.testing.assert_allclose(found[:3], 0.3 * np.eye(3), atol=1e-6)


@pytest.mark.parametrize(
    ("settings", "unmeasured", "count"),
    [
        ("axes: false", "", 1),
        ("acceleration: false", "", 3),
        ("axes: true", "orientation", 1),
        ("axes: true", "linear_acceleration", 3),
    ],
)
def test_what_is_not_measured_or_wanted_is_not_drawn(settings, unmeasured, count, tmp_path):
    """A covariance that begins with -1 says so."""
    message = imu((0, 0, 0, 0) if unmeasured == "orientation" else LEFT)
    if unmeasured:
        getattr(message, f"{unmeasured}_covariance")[0] = -1.0
    file, said = show(tmp_path, f"imu: {{{settings}}}", (TOPIC, message))
    [found] = arrows(file)
    assert (len(found), said) == (count, [])


def test_few_of_many_messages_are_drawn(tmp_path):
    """Of those that come together the newest."""
    shown = Shown(tmp_path)
    for tick in range(3):
        shown.send(TOPIC, *(imu(at=10 * tick + number) for number in range(10)))
        shown.tick(START_NS + tick)
    assert stamps(shown.end(), ENTITY) == [START_NS + at for at in (9, 19, 29)]
