"""A page moves the joints of simulated robots through DDS; they stop, whatever happens to it."""

import math
import signal
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from trajectory_msgs.msg import JointTrajectory

from onebot_bringup.steering.joint_motion import SteeredJoint, short_motion
from onebot_description.elements.urdf import Joint
from tests.onebot_bringup.joints_support import SPEED, STANDING, Arm, described
from tests.onebot_bringup.steering_support import TOPIC, PageClient, steering
from tests.onebot_control.arm_support import MODULE, ControllerState
from tests.ros_support import NodeProcess, Peer
from tests.support import wait_for

STEERED = SteeredJoint("rad", 0.5, -1.0, 1.2)


# The motion of one joint ----------------------------------------------------------------------


def test_the_description_has_the_limits_of_a_joint():
    """Slow enough for people, in m of a prismatic joint; one without limits is not moved."""
    for kind, velocity, limits, wanted in (
        ("revolute", 0.5, (-1.0, 2.0), SteeredJoint("rad", 0.5, -1.0, 2.0)),
        ("revolute", 9.0, (-1.0, 2.0), SteeredJoint("rad", 1.0, -1.0, 2.0)),
        ("prismatic", None, (0.0, 0.1), SteeredJoint("m", 0.2, 0.0, 0.1)),
        ("continuous", 9.0, (None, None), SteeredJoint("rad", 1.0)),
        ("revolute", 0.5, (None, None), SteeredJoint("rad", 0.0)),
        ("prismatic", 0.0, (0.0, 0.1), SteeredJoint("m", 0.0, 0.0, 0.1)),
    ):
        joint = Joint("j", kind, "a", "b", velocity=velocity, lower=limits[0], upper=limits[1])
        assert SteeredJoint.from_joint(joint) == wanted


def test_a_joint_gets_to_its_velocity_and_ends_at_rest():
    """Faster than its limit is its limit; with no velocity wanted it comes to rest at once."""
    assert short_motion(STEERED, 0.1, 0.5, 9.0, 0.0) == pytest.approx((0.15, 0.2, 0.225, 0.5))
    assert short_motion(STEERED, 0.1, 0.0, -0.5, 0.0) == pytest.approx((0.075, 0.025, 0.0, -0.5))
    assert short_motion(STEERED, 0.1, 0.5, 0.0, 0.0) == pytest.approx((*[0.125] * 3, 0.0))
    assert short_motion(STEERED, 0.1, 0.5, 0.5, 0.1) == pytest.approx((0.2, 0.25, 0.275, 0.5))
    assert short_motion(STEERED, 0.3, 0.0, 0.0, 0.1) == (0.3, 0.3, 0.3, 0.0)


_speed = st.floats(-2.0, 2.0)


@given(st.floats(-3.0, 3.0), _speed, _speed, st.floats(0.0, 0.5))
def test_no_motion_ends_beyond_a_limit(position, velocity, wanted, age):
    """Nor farther beyond it than where it began; and none goes against what is wanted."""
    motion = short_motion(STEERED, position, velocity, wanted, age)
    for place in motion[:3]:
        assert min(STEERED.lower, position) <= place <= max(STEERED.upper, position)
    assert abs(motion.velocity) <= STEERED.max_speed and motion.velocity * wanted >= 0.0


# Robots ---------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def controller(domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[NodeProcess]:
    """The controller of both joints of a robot that stands."""
    model = tmp_path_factory.mktemp("robot") / "standing.urdf"
    model.write_text(STANDING)
    with NodeProcess(MODULE, str(model)) as process:
        yield process


@pytest.fixture(scope="module")
def arm(domain: int, controller: NodeProcess) -> Iterator[Arm]:
    """What it publishes."""
    with described(domain, STANDING) as peer:
        yield Arm(peer)


@pytest.fixture(scope="module")
def node(arm: Arm) -> Iterator[Any]:
    with steering() as node:
        yield node


@contextmanager
def opened(node: Any) -> Iterator[PageClient]:
    """A page that is shown the joints."""
    with PageClient(node.address) as page:
        wait_for(lambda: page.state["joints"], "the joints")
        yield page


def hold(page: PageClient, arm: Arm, lift: float = 0.0) -> None:
    """Hold sliders until the arm moves, away from where it is.

    Where a busy computer kept the page from sending for a moment, the arm was stopped: only another
    press moves it.
    """
    presses: list[float] = []

    def moves() -> bool:
        if not presses or time.monotonic() > presses[-1] + 10.0:
            page.let_go()
            presses.append(time.monotonic())
            page.hold(0.0, arm_joint=-math.copysign(SPEED, arm.positions()[0]), lift_joint=lift)
        return abs(abs(arm.speed()) - SPEED) < 0.05

    wait_for(moves, f"{SPEED} rad/s")


def test_joints_move_while_held_and_stop_when_let_go(node: Any, arm: Arm) -> None:
    """At the velocity that is commanded; the page shows where they are, and how fast they can."""
    with opened(node) as page:
        hold(page, arm)
        wait_for(lambda: page.state["you"], "this page to be the driver")
        assert page.state["command"]["joints"] == {"arm_joint": math.copysign(SPEED, arm.speed())}
        arm.stop(page.let_go)
        turn, lift = page.state["joints"]
        assert turn["position"] == pytest.approx(arm.positions()[0], abs=1e-3)
        assert (turn["name"], turn["unit"], turn["max_speed"]) == ("arm_joint", "rad", 1.0)
        assert (lift["name"], lift["unit"], lift["max_speed"]) == ("lift_joint", "m", 0.2)
        assert arm.peer.node.count_publishers(TOPIC) == 0, "it has no wheels to drive"
        count = len(arm.commands)
        page.hold(0.3)
        wait_for(lambda: page.state["you"], "this page to be the driver")
        arm.rest()
        page.let_go()
        assert len(arm.commands) == count, "nothing for an arm when only wheels are driven"


def test_the_arm_stops_when_the_server_does(arm: Arm) -> None:
    """Hanging, by the end of the last trajectory; after a hang it does not go on."""
    with steering(check=False) as own, opened(own) as page:
        hold(page, arm)
        arm.stop(lambda: own.process.send_signal(signal.SIGSTOP))
        page.silence()  # what it sent meanwhile waits
        own.process.send_signal(signal.SIGCONT)
        arm.rest()
        own.process.send_signal(signal.SIGKILL)
        wait_for(lambda: page.closed, "the end of the connection")


def test_stop_locks_the_arm_until_a_page_moves_it(node: Any, arm: Arm) -> None:
    """By the lock of controller_manager; a slider that is not off its middle unlocks nothing."""
    with opened(node) as page, opened(node) as other:
        hold(page, arm)
        arm.stop(lambda: other.send("stop"))
        wait_for(lambda: page.state["locked"] and not page.state["you"], "the lock")
        page.let_go()
        page.hold(0.0, arm_joint=0.0)
        wait_for(lambda: page.state["you"], "this page to be the driver")
        assert page.state["locked"]
        page.let_go()
        hold(page, arm)
        wait_for(lambda: not page.state["locked"], "the arm to be unlocked")
        arm.stop(page.let_go)


# Controllers of other makes ---------------------------------------------------------------------


class OtherController:
    """A controller that publishes no velocities, and follows nothing."""

    def __init__(self, peer: Peer, name: str) -> None:
        self.state = ControllerState()
        self.commands = peer.hear(JointTrajectory, f"{name}/joint_trajectory")
        states = peer.node.create_publisher(ControllerState, f"{name}/controller_state", 10)
        self._timer = peer.node.create_timer(0.02, lambda: states.publish(self.state))

    def speed(self) -> float | None:
        """What the first joint is commanded, rad/s; None before there is a command."""
        return self.commands[-1].points[0].velocities[0] if self.commands else None

    def be_at(self, *positions: float, names: Sequence[str] = ("arm_joint", "other_joint")) -> None:
        state = ControllerState(joint_names=names)
        state.header.stamp.sec = 7
        state.reference.positions = state.feedback.positions = [*positions]
        self.state = state


def test_only_a_reference_of_the_robot_that_is_steered_is_gone_on_from(ros_domain: int) -> None:
    """At its own stamp; not from one that is not finite.

    A joint that the description does not have rests; what is in a namespace is another robot's.
    Each controller gets its own joints, and nothing while those of another one move.
    """
    with described(ros_domain, STANDING) as peer, steering() as own:
        mine, other = (OtherController(peer, f"{name}/arm") for name in ("", "/robot2"))
        for controller in (mine, other):
            controller.be_at(0.1, 0.2)
        lift = OtherController(peer, "/lift")
        lift.be_at(0.0, names=["lift_joint"])
        with opened(own) as page:
            wait_for(lambda: len(page.state["joints"]) == 2, "both controllers")

            def shown() -> dict[str, Any]:
                return {joint["name"]: joint for joint in page.state["joints"]}

            page.hold(0.0, lift_joint=0.1)
            command = wait_for(lambda: lift.commands and lift.commands[-1], "the lift's")
            assert command.joint_names == ["lift_joint"] and mine.commands == []
            page.let_go()
            joint = {"name": "arm_joint", "unit": "rad", "max_speed": 1.0, "position": 0.1}
            assert shown()["arm_joint"] == joint
            page.hold(0.0, arm_joint=0.5, other_joint=0.5)
            command = wait_for(lambda: mine.commands and mine.commands[-1], "a trajectory")
            assert command.header.stamp.sec == 7
            assert command.joint_names == ["arm_joint", "other_joint"]
            assert [point.positions[1] for point in command.points] == [0.2] * 3
            assert [point.velocities[0] for point in command.points] == [0.5, 0.5, 0.0]
            mine.be_at(math.nan, 0.2)
            wait_for(lambda: shown()["arm_joint"]["position"] is None, "the state")
            commands, states = len(mine.commands), len(page.states)
            wait_for(lambda: len(page.states) > states + 5, "half a second")
            assert len(mine.commands) <= commands + 1, "but for one that was on its way"
            page.let_go()
        assert other.commands == []
