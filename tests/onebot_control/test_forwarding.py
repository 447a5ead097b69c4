"""Positions are forwarded as forward_command_controller does it, and nothing else moves."""

import math

import pytest

from onebot_control.trajectories.forwarding import ForwardConfig, PositionForwarder
from onebot_control.trajectories.goal import FollowedJoint
from onebot_control.trajectories.trajectory import JointMotion
from onebot_description.parameters.reader import ConfigError, read

JOINTS = (FollowedJoint("elbow", lower=-1.0, upper=2.0), FollowedJoint("wrist", continuous=True))


def forwarder() -> PositionForwarder:
    """One that holds its joints where they start."""
    return PositionForwarder(JOINTS, ForwardConfig(("elbow", "wrist")), [0.3, -0.4])


def measured(*positions: float) -> JointMotion:
    """Joints that are at rest somewhere."""
    return JointMotion(positions, (0.0,) * len(positions), ())


def reference(arm: PositionForwarder) -> list[float]:
    """What is commanded, which does not depend on how far ahead it is asked for."""
    assert arm.reference(0.0) == arm.reference(0.005) == arm.reference(1.0)
    return list(arm.reference(0.0))


def test_nothing_is_commanded_before_the_first_message() -> None:
    """It holds the joints where they start, also where they are pushed away."""
    arm = forwarder()
    assert arm.names == ("elbow", "wrist")
    for position in (0.3, 0.5, 0.9):
        assert arm.update(measured(position, 0.0), 0, 0.01) == []
        assert reference(arm) == [0.3, -0.4]


def test_positions_are_held_until_others_come() -> None:
    """They are commanded at once, whatever is measured, and a continuous joint is not wrapped."""
    arm = forwarder()
    for positions in ([1.5, 20.0], [-1.0, -20.0]):
        arm.command(positions)
        assert reference(arm) == positions
        assert arm.update(measured(0.0, 0.0), 0, 0.01) == []
        assert reference(arm) == positions


@pytest.mark.parametrize(
    ("positions", "problems"),
    [
        ([2.0000005, 1e9], []),  # a limit that was rounded to a float32
        (
            [2.00001, math.nan],
            ["elbow: 2.00001 is above the joint's limit 2", "wrist: nan is not f"],
        ),
        ([0.5], ["1 values for 2 joints"]),
    ],
)
def test_what_is_refused(positions: list[float], problems: list[str]) -> None:
    """test_trajectory_goal.py has all the reasons."""
    for found, text in zip(forwarder().problems(positions), problems, strict=True):
        assert found.startswith(f"data: {text}")


def test_what_is_rounded_beyond_a_limit_is_commanded_at_it() -> None:
    arm = forwarder()
    arm.command([2.0000005, 0.0])
    assert reference(arm) == [2.0, 0.0]


def test_an_abort_holds_the_joints_where_they_are() -> None:
    """Those of the next cycle, although they are far from where they were commanded."""
    arm = forwarder()
    arm.command([2.0, 1.0])
    arm.update(measured(0.5, 0.0), 0, 0.01)
    assert arm.abort("locked") is None
    for elbow, wrist in ((0.6, 0.1), (0.7, 0.2)):
        arm.update(measured(elbow, wrist), 0, 0.01)
        assert reference(arm) == [0.6, 0.1]
    arm.abort("locked")
    arm.command([1.0, 1.0])  # a later command counts
    arm.update(measured(0.5, 0.0), 0, 0.01)
    assert reference(arm) == [1.0, 1.0]


def test_a_reset_holds_the_joints_where_they_were_put() -> None:
    arm = forwarder()
    arm.command([2.0, 1.0])
    arm.abort("locked")
    assert arm.reset([0.1, 0.2]) is None
    arm.update(measured(1.0, 1.0), 0, 0.01)
    assert reference(arm) == [0.1, 0.2]


def test_only_positions_are_forwarded() -> None:
    """position_controllers has no interface_name, forward_command_controller needs one."""
    for more in ({}, {"interface_name": "position"}):
        assert read(ForwardConfig, {"joints": ["b", "a"], **more}).joints == ("b", "a")
    with pytest.raises(ConfigError, match="interface_name: 3 is a number"):
        read(ForwardConfig, {"joints": ["a"], "interface_name": 3})
