"""``onebot navigate``: drives a robot to a place by a navigator."""

import math
from collections.abc import Sequence
from typing import Any

from onebot_bringup.cli.session import Session
from onebot_bringup.launch.arguments import split
from onebot_description.errors import OneBotError, UsageError
from onebot_description.timing import NS_PER_S

_HELP = """usage: onebot navigate X Y [YAW] [--ros-args ...]

Drives a robot to a place in the map, m and rad, by its navigator (onebot_bringup navigate:=true, or
Nav2), and waits until it is there. Without YAW it arrives with the heading of the straight way
there. Ctrl-C cancels the goal: the robot stops.

--ros-args is passed to ROS; -r __ns:=NS there chooses the robot in a namespace. Exit codes: 0 the
robot is there; 1 it gave up, or somebody else drives; 2 the command line is wrong; 130 Ctrl-C."""

_ACTION = "nav2_msgs/action/NavigateToPose"
_ANSWER = 10.0  # s to wait for an answer of the navigator
_POSE = 20.0  # s to wait for the robot's pose, which takes some after its start
_PROGRESS = 1.0  # s between two lines of the progress


def run(argv: Sequence[str]) -> int:
    """Run the command and return its exit code."""
    arguments = split(_with_negatives(argv))
    if arguments.help or arguments.show:
        print(_HELP)
        return 0
    words = [word.removeprefix("=") for word in arguments.positional]
    place = _numbers(words)
    with Session(["--ros-args", *arguments.ros_args]) as session:
        _Drive(session).to(*place)
    return 0


def _with_negatives(argv: Sequence[str]) -> list[str]:
    """Mark negative numbers, which are no options."""
    return [f"={word}" if _is_number(word) else word for word in argv]


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _numbers(words: Sequence[str]) -> list[float]:
    if len(words) not in (2, 3) or not all(map(_is_number, words)):
        raise UsageError("write onebot navigate X Y [YAW], numbers in m and rad")
    numbers = [float(word) for word in words]
    if not all(map(math.isfinite, numbers)):
        raise UsageError("X, Y and YAW are finite numbers")
    return numbers


class _Drive:
    """Sends a goal and follows it."""

    def __init__(self, session: Session) -> None:
        from geometry_msgs.msg import PoseWithCovarianceStamped
        from rclpy.action import ActionClient

        from onebot_description.ros.topic_qos import LATCHED
        from onebot_description.ros.wire.interfaces import load_interface

        self._session, self._type = session, load_interface(_ACTION)
        self._feedback: Any = None
        self._client = ActionClient(session.node, self._type, "navigate_to_pose")
        name = f"{session.space}/navigate_to_pose"
        if not session.look_for(self._client.server_is_ready, f"the action {name}"):
            raise OneBotError(
                f"there is no action {name}: start the robot with navigate:=true, or choose a "
                "robot with --ros-args -r __ns:=/NAME"
            )
        poses = list[PoseWithCovarianceStamped]()
        session.node.create_subscription(
            PoseWithCovarianceStamped, "amcl_pose", poses.append, LATCHED
        )
        notice = "waiting for the navigator to know where the robot is ..."
        if not session.await_or_report(lambda: poses, lambda: notice, _POSE):
            raise OneBotError("the navigator does not know where the robot is: its log has why")
        self._start = poses[-1].pose.pose.position

    def to(self, x: float, y: float, yaw: float | None = None) -> None:
        """Drive to a place, and print the progress.

        Raises:
            OneBotError: the robot does not arrive.
        """
        from onebot_description.geometry.poses import about_z
        from onebot_description.ros.wire.interfaces import load_interface

        if yaw is None:
            yaw = math.atan2(y - self._start.y, x - self._start.x)
        goal = self._type.Goal()
        goal.pose.header.frame_id = "map"
        goal.pose.pose.position.x, goal.pose.pose.position.y = x, y
        *_, goal.pose.pose.orientation.z, goal.pose.pose.orientation.w = about_z(yaw)
        with self._session.interrupts.deferred() as interrupted:
            handle = self._answer(self._client.send_goal_async(goal, self._on_feedback))
            if not handle.accepted:
                raise OneBotError("the navigator refuses the goal; its log has the reason")
            ended = handle.get_result_async()
            try:
                self._show_until(lambda: ended.done() or interrupted())
            finally:  # the terminal may be closed
                if not ended.done():
                    self._answer(handle.cancel_goal_async())
            answer = self._answer(ended)
        statuses = load_interface("action_msgs/msg/GoalStatus")
        if answer.status == statuses.STATUS_SUCCEEDED:
            print(f"arrived at {x:g}, {y:g} m")
        elif interrupted():
            print("cancelled: the robot stops")
        else:
            code, text = answer.result.error_code, answer.result.error_msg
            raise OneBotError(f"not arrived ({code}): {text or 'the goal was ended'}")

    def _on_feedback(self, message: Any) -> None:
        self._feedback = message.feedback

    def _answer(self, future: Any) -> Any:
        self._session.spin(lambda: future.done() or not self._client.server_is_ready(), _ANSWER)
        if not future.done():
            raise OneBotError("the navigator does not answer: the robot may still drive")
        return future.result()

    def _show_until(self, ended: Any) -> None:
        """Print the progress once a second until ``ended()``, or the navigator ends."""
        while not ended() and self._client.server_is_ready():
            self._session.spin(ended, _PROGRESS)
            if (feedback := self._feedback) is not None and not ended():
                left = feedback.estimated_time_remaining
                seconds = left.sec + left.nanosec / NS_PER_S
                print(f"{feedback.distance_remaining:.1f} m, {seconds:.0f} s left")
