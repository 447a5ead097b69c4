"""Which joints and interfaces joint_states holds."""

import math

import numpy as np
import pytest

from onebot_control.controlled_robot import JointStateBroadcaster
from onebot_control.physics.robot_body import JointStates
from onebot_control.simulation_parameters import BroadcasterConfig
from onebot_description.parameters.reader import ConfigError

JOINTS = ("a", "b", "c")
STATES = JointStates(
    np.array([1.0, 2.0, 3.0]), np.array([10.0, 20.0, 30.0]), np.array([100.0, 200.0, 300.0])
)


def test_all_joints_in_their_order_by_default() -> None:
    broadcaster = JointStateBroadcaster(BroadcasterConfig(), JOINTS)
    assert (broadcaster.names, broadcaster.frame_id) == (JOINTS, "base_link")
    assert broadcaster.values(STATES) == [field.tolist() for field in STATES]


def test_joints_chosen_and_extra_ones() -> None:
    """In the order given; an extra joint that is chosen already is not there twice."""
    config = BroadcasterConfig(joints=("c", "a"), extra_joints=("x", "a", "b"), frame_id="odd")
    broadcaster = JointStateBroadcaster(config, JOINTS)
    assert (broadcaster.names, broadcaster.frame_id) == (("c", "a", "x", "b"), "odd")
    expected = [[3.0, 1.0, 0.0, 0.0], [30.0, 10.0, 0.0, 0.0], [300.0, 100.0, 0.0, 0.0]]
    assert broadcaster.values(STATES) == expected


def test_held_joints_stand_where_they_are_held() -> None:
    config = BroadcasterConfig(joints=("h", "b"))
    broadcaster = JointStateBroadcaster(config, JOINTS, {"g": 0.5, "h": 0.25})
    assert broadcaster.values(STATES) == [[0.25, 2.0], [0.0, 20.0], [0.0, 200.0]]
    assert JointStateBroadcaster(BroadcasterConfig(), JOINTS, {"h": 0.25}).names == (*JOINTS, "h")


@pytest.mark.parametrize("interfaces", [("position",), ("velocity",), ("velocity", "effort")])
def test_other_interfaces_are_nan(interfaces: tuple[str, ...]) -> None:
    """But for extra joints, which are 0 in all of them."""
    config = BroadcasterConfig(interfaces=interfaces, extra_joints=("x",))
    values = JointStateBroadcaster(config, JOINTS).values(STATES)
    for name, field, got in zip(("position", "velocity", "effort"), STATES, values, strict=True):
        assert got[3] == 0.0
        if name in interfaces:
            assert got[:3] == field.tolist()
        else:
            assert all(math.isnan(value) for value in got[:3])


def test_joints_that_are_none() -> None:
    with pytest.raises(ConfigError) as caught:
        JointStateBroadcaster(BroadcasterConfig(joints=("a", "bb", "z")), JOINTS)
    lines = str(caught.value).splitlines()
    assert [line.split(" (")[0] for line in lines] == [
        'joint_state_broadcaster.joints: no joint "bb"',
        'joint_state_broadcaster.joints: no joint "z"',
    ]
    assert 'did you mean "b"? known: a, b, c' in lines[0]
