"""Clients of joint_trajectory_controller, and small arms, for tests of what is on its topics."""

import time
from collections.abc import Sequence
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

    def __init__(
        self, controller: str = CONTROLLER, manager: str = MANAGER, *, states: bool = False
    ) -> None:
        """``states``: keep ~/controller_state, too, which takes as long as all else."""
        super().__init__("client")
        self.controller, self.manager = controller, manager
        self.states: list[Any] = []
        self.feedback: list[Any] = []
        if states:
            topic = f"{controller}/controller_state"
            self.create_subscription(ControllerState, topic, self.states.append, 10)
        self.topic = self.create_publisher(JointTrajectory, f"{controller}/joint_trajectory", 10)
        self.lock = self.create_publisher(Bool, f"{manager}/cmd_vel_lock", 10)
        self.action = ActionClient(
            self, FollowJointTrajectory, f"{controller}/follow_joint_trajectory"
        )

    def ask(self, goal: Any) -> Any:
        """Send a goal; the future of its handle."""
        return self.action.send_goal_async(goal, lambda each: self.feedback.append(each.feedback))


class SteppedArm:
    """A controller of joints in step with its client: simulated time passes while it waits."""

    def __init__(self, ros: Lockstep[Simulation], client: ArmClient | None = None) -> None:
        self.ros, self.simulation = ros, ros.simulation
        self.client = client or ArmClient()
        ros.add(self.client)
        assert self.client.action.wait_for_server(10.0)

    def _awaited(self, future: Any, timeout: float = 1.0) -> Any:
        self.simulation.run(until=future.done, timeout=timeout)
        return future.result()

    def send(self, goal: Any) -> Any:
        """The handle of a goal that is accepted."""
        handle = self._awaited(self.client.ask(goal))
        assert handle.accepted
        return handle

    def refuse(self, goal: Any) -> None:
        """Send a goal that is rejected."""
        assert not self._awaited(self.client.ask(goal)).accepted

    def ending(self, handle: Any, timeout: float = 10.0) -> Ending:
        """How a goal ends."""
        answer = self._awaited(handle.get_result_async(), timeout)
        return Ending(answer.status, answer.result.error_code, answer.result.error_string)

    def cancel(self, handle: Any) -> int:
        """Cancel a goal; the number of goals that the server cancels."""
        return len(self._awaited(handle.cancel_goal_async()).goals_canceling)

    def call(self, kind: Any, name: str, **request: Any) -> Any:
        """The answer of a service."""
        client = self.client.create_client(kind, name)
        assert client.wait_for_service(10.0)
        answer = self._awaited(client.call_async(kind.Request(**request)))
        self.client.destroy_client(client)
        return answer

    def query(self, stamp: int) -> Any:
        """The answer of ~/query_state about a time, ns."""
        kind, name = QueryTrajectoryState, f"{self.client.controller}/query_state"
        return self.call(kind, name, time=time_message(stamp))

    def reset(self) -> None:
        """Call ~/reset."""
        assert self.call(Trigger, f"{self.client.manager}/reset").success

    @property
    def position(self) -> float:
        """That of the first joint, rad."""
        return next(iter(self.simulation.robot.joints.values())).position


class WireArm:
    """A controller of joints in a process of its own, on real DDS."""

    def __init__(self, peer: Peer, controller: str = CONTROLLER) -> None:
        self.feedback: list[Any] = []
        name = f"{controller}/follow_joint_trajectory"
        self._action = ActionClient(peer.node, FollowJointTrajectory, name)
        wait_for(self._action.server_is_ready, f"the action {name}")

    def ask(self, goal: Any) -> Any:
        """The handle of a goal, accepted or not.

        A request is sent again where its answer is lost, as ``Peer.call`` does.
        """
        start, futures = time.monotonic(), list[Any]()

        def answered() -> Any:
            if time.monotonic() >= start + _LOST * len(futures):
                if futures:
                    self.before_again()
                futures.append(
                    self._action.send_goal_async(
                        goal, lambda each: self.feedback.append(each.feedback)
                    )
                )
            return next((future for future in futures if future.done()), None)

        return wait_for(answered, "the answer to a goal").result()

    def before_again(self) -> None:
        """Do what is needed before a goal is sent again that may have been followed already."""

    def send(self, goal: Any) -> Any:
        """The future of the result of a goal, which is accepted."""
        handle = self.ask(goal)
        assert handle.accepted
        return handle.get_result_async()


def ending(result: Any) -> Ending:
    """How a goal ends, by the future of its result."""
    answer = wait_for(lambda: result.done() and result.result(), "the end of a goal")
    return Ending(answer.status, answer.result.error_code, answer.result.error_string)
