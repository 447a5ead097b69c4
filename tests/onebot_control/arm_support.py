"""Clients of joint_trajectory_controller, and small arms, for tests of what is on its topics."""

import time
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from builtin_interfaces.msg import Time
from rclpy.action import ActionClient
from rclpy.node import Node
from std_msgs.msg import Bool
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from onebot_control.nodes.lockstep import Lockstep
from onebot_control.simulation import Simulation
from onebot_description.ros.wire.cdr import nanoseconds
from onebot_description.ros.wire.interfaces import load_interface
from onebot_description.ros.wire.messages import time_message
from tests.onebot_control.arm_models import arm, box, joint, link
from tests.onebot_control.node_support import Stepped
from tests.ros_support import Peer
from tests.support import wait_for

MODULE = "onebot_control.joint_trajectory_controller"
CONTROLLER = "/joint_trajectory_controller"
MANAGER = "/controller_manager"
MRM = "package://mrm_description/urdf/mrm.xacro"
JOINT = "base_link__link_01"  # MRM's only one: 0.5 rad/s, within 3.14 rad

FollowJointTrajectory = load_interface("control_msgs/action/FollowJointTrajectory")
JointTolerance = load_interface("control_msgs/msg/JointTolerance")
ControllerState = load_interface("control_msgs/msg/JointTrajectoryControllerState")
QueryTrajectoryState = load_interface("control_msgs/srv/QueryTrajectoryState")
_STATUS = load_interface("action_msgs/msg/GoalStatus")
UNKNOWN, SUCCEEDED, CANCELED, ABORTED = (
    _STATUS.STATUS_UNKNOWN,
    _STATUS.STATUS_SUCCEEDED,
    _STATUS.STATUS_CANCELED,
    _STATUS.STATUS_ABORTED,
)
_LOST = 20.0  # s without an answer of a service
DURATION = type(JointTrajectoryPoint().time_from_start)


def _part(name: str, kind: str, parent: str, xyz: str, axis: str, limits: str = "") -> str:
    """A joint, and a link of 0.2 kg that it moves."""
    limits = limits or 'effort="20" velocity="0.5" lower="-2" upper="2"'
    child = f"{name}_link"
    moving = joint(name, parent, child, kind, axis, xyz, limits=limits)
    return link(child, 0.2, shape=box("0.02 0.02 0.02")) + moving


# A shoulder, which follows trajectories, a pan and a tilt, to which positions are forwarded, and a
# finger.
OPEN, FAST, EFFORT = 0.05, 0.1, 20.0  # m, m/s and N of the finger
ROBOT = arm(
    _part("shoulder", "revolute", "world", "0 0 1", "0 0 1"),
    _part("pan", "revolute", "world", "0 1 1", "0 0 1"),
    _part("tilt", "revolute", "pan_link", "0 0 0.1", "0 1 0"),
    _part(
        *("finger", "prismatic", "world", "1 0 1", "0 1 0"),
        f'effort="{EFFORT}" velocity="{FAST}" lower="0" upper="{OPEN}"',
    ),
)
CONTROL = """\
controller_manager:
  ros__parameters:
    initial_positions.finger: 0.05
    arm_controller: {type: joint_trajectory_controller/JointTrajectoryController}
    gripper_controller: {type: parallel_gripper_action_controller/GripperActionController}
    head_controller: {type: forward_command_controller/ForwardCommandController}
arm_controller:
  ros__parameters:
    joints: [shoulder]
gripper_controller:
  ros__parameters:
    joint: finger
head_controller:
  ros__parameters:
    joints: [tilt, pan]
    interface_name: position
"""


class Ending(NamedTuple):
    """How a goal ended, as its client is sent it."""

    status: int
    code: int
    text: str


SUCCESS = Ending(SUCCEEDED, 0, "Goal successfully reached!")


def duration(seconds: float) -> Any:
    """A duration; a negative one has a negative sec and a positive nanosec, as rclcpp has it."""
    sec, nanosec = divmod(round(seconds * 1e9), 1_000_000_000)
    return DURATION(sec=sec, nanosec=nanosec)


def point(time: float, *positions: float, **fields: Any) -> JointTrajectoryPoint:
    """A point of a trajectory, at rest unless it has ``velocities``."""
    rest = {"velocities": [0.0] * len(positions)}
    given = {"time_from_start": duration(time), **rest, **fields}
    return JointTrajectoryPoint(positions=list(positions), **given)


def trajectory(
    *points: JointTrajectoryPoint, joints: Sequence[str] = (JOINT,), stamp: int = 0
) -> JointTrajectory:
    """A trajectory of joints; ``stamp`` in ns."""
    message = JointTrajectory(joint_names=list(joints), points=list(points))
    message.header.stamp = time_message(stamp) if stamp else Time()
    return message


def goal(*points: JointTrajectoryPoint, joints: Sequence[str] = (JOINT,), **fields: Any) -> Any:
    """An action goal; ``fields`` are its tolerances."""
    return FollowJointTrajectory.Goal(trajectory=trajectory(*points, joints=joints), **fields)


def seconds(stamped: Any) -> float:
    """The time of a message's header, s."""
    return nanoseconds(stamped.header.stamp) * 1e-9


class ArmClient(Node):
    """Sends goals and trajectories to a controller of joints, and keeps what it publishes."""

    def __init__(self, controller: str = CONTROLLER, manager: str = MANAGER) -> None:
        super().__init__("client")
        self.controller, self.manager = controller, manager
        self.states: list[Any] = []
        self.feedback: list[Any] = []
        self.topic = self.create_publisher(JointTrajectory, f"{controller}/joint_trajectory", 10)
        self.lock = self.create_publisher(Bool, f"{manager}/cmd_vel_lock", 10)
        self.action = ActionClient(
            self, FollowJointTrajectory, f"{controller}/follow_joint_trajectory"
        )

    def watch(self) -> Any:
        """Keep ~/controller_state, too, which takes as long as all else; the subscription."""
        topic = f"{self.controller}/controller_state"
        return self.create_subscription(ControllerState, topic, self.states.append, 10)

    def ask(self, goal: Any) -> Any:
        """Send a goal; the future of its handle."""
        return self.action.send_goal_async(goal, lambda each: self.feedback.append(each.feedback))


class SteppedArm(Stepped):
    """Controllers of joints in step with their client: simulated time passes while it waits."""

    client: ArmClient

    def __init__(self, ros: Lockstep[Simulation], client: ArmClient | None = None) -> None:
        super().__init__(ros, client or ArmClient())
        assert self.client.action.wait_for_server(10.0)

    def awaited(self, future: Any, timeout: float = 5.0) -> Any:
        """The result of a future."""
        self.simulation.run(until=future.done, timeout=timeout)
        return future.result()

    def send(self, goal: Any) -> Any:
        """The handle of a goal that is accepted."""
        handle = self.awaited(self.client.ask(goal))
        assert handle.accepted
        return handle

    def refuse(self, goal: Any) -> None:
        """Send a goal that is rejected."""
        assert not self.awaited(self.client.ask(goal)).accepted

    def ending(self, handle: Any, timeout: float = 10.0) -> Ending:
        """How a goal ends."""
        answer = self.awaited(handle.get_result_async(), timeout)
        return Ending(answer.status, answer.result.error_code, answer.result.error_string)

    def set_parameter(self, controller: str, name: str, value: Any) -> Any:
        """The result of setting a parameter of a controller."""
        return self.set_parameters(controller, **{name: value})[0]

    def query(self, stamp: int) -> Any:
        """The answer of ~/query_state about a time, ns."""
        kind, name = QueryTrajectoryState, f"{self.client.controller}/query_state"
        return self.call(kind, name, time=time_message(stamp))

    def reset(self) -> None:
        """Call ~/reset, and forget what the client has kept."""
        assert self.call(Trigger, f"{self.client.manager}/reset").success
        self.client.feedback.clear()
        self.client.states.clear()

    @property
    def position(self) -> float:
        """That of the first joint, rad."""
        return next(iter(self.simulation.robot.joints.values())).position


class WireArm:
    """A controller of joints in a process of its own, on real DDS."""

    def __init__(self, peer: Peer, controller: str = CONTROLLER) -> None:
        self.peer, self.feedback = peer, list[Any]()
        name = f"{controller}/follow_joint_trajectory"
        self._action = ActionClient(peer.node, FollowJointTrajectory, name)
        wait_for(self._action.server_is_ready, f"the action {name}")

    def ask(self, goal: Any) -> Any:
        """The handle of a goal, accepted or not."""

        def send() -> Any:
            return self._action.send_goal_async(
                goal, lambda each: self.feedback.append(each.feedback)
            )

        return answered(self.peer, send, "the answer to a goal", self.before_again)

    def before_again(self) -> None:
        """Do what is needed before a goal is sent again that may have been followed already."""

    def send(self, goal: Any) -> Any:
        """The future of the result of a goal, which is accepted."""
        handle = self.ask(goal)
        assert handle.accepted
        return self.peer.run(handle.get_result_async)


def answered(
    peer: Peer, ask: Callable[[], Any], what: str, before_again: Callable[[], object] = lambda: None
) -> Any:
    """The answer to a request, which is sent again where it is lost, as ``Peer.call`` does."""
    start, futures = time.monotonic(), list[Any]()

    def answer() -> Any:
        if time.monotonic() >= start + _LOST * len(futures):
            if futures:
                before_again()
            futures.append(peer.run(ask))
        return next((future.result() for future in futures if future.done()), None)

    return wait_for(answer, what)


def flags(ended: Any) -> tuple[int, bool, bool]:
    """How a goal of a gripper ended: status, reached, stalled."""
    return ended.status, ended.result.reached_goal, ended.result.stalled


def ending(result: Any) -> Ending:
    """How a goal ends, by the future of its result."""
    answer = wait_for(lambda: result.done() and result.result(), "the end of a goal")
    return Ending(answer.status, answer.result.error_code, answer.result.error_string)
