"""``onebot navigate``: drives a robot to a place with its navigator."""

import math
from collections.abc import Callable, Sequence
from typing import Any

from onebot_bringup.cli.action import Action
from onebot_bringup.cli.options import Parser, finite, positional
from onebot_bringup.cli.session import Session
from onebot_description.errors import OneBotError
from onebot_description.timing import NS_PER_S

_SUMMARY = (
    "drive a robot to a place in the map with its navigator (onebot_bringup navigate:=true, or "
    "Nav2), and wait until it is there; Ctrl-C cancels the goal, and the robot stops. -r __ns:=NS "
    "after --ros-args chooses the robot in a namespace. Exit codes: 0 the robot is there; 1 it "
    "gave up, or somebody else drives; 2 the command line is wrong; 130 Ctrl-C"
)
_OPTIONS = (
    positional("X", "m", type=finite),
    positional("Y", "m", type=finite),
    positional(
        "YAW", "rad; default: the heading of the straight way there", type=finite, nargs="?"
    ),
)
_POSE = 20.0  # s to wait for the robot's pose, which is not known at its start
_PROGRESS = 1.0  # s between two lines of the progress


def run(argv: Sequence[str]) -> int:
    """Run the command and return its exit code."""
    args = Parser("onebot navigate", _SUMMARY, _OPTIONS).parse(argv)
    with Session(args.ros_args) as session:
        _Drive(session).to(args.x, args.y, args.yaw)
    return 0


class _Drive:
    """Sends a goal and follows it."""

    def __init__(self, session: Session) -> None:
        from geometry_msgs.msg import PoseWithCovarianceStamped

        from onebot_description.ros.topic_qos import LATCHED

        self._session = session
        self._feedback: Any = None
        self._action = Action(
            session,
            "nav2_msgs/action/NavigateToPose",
            f"{session.space}/navigate_to_pose",
            unanswered="the navigator does not answer: the robot may still drive",
            missing=": start the robot with navigate:=true, or choose a robot with --ros-args -r "
            "__ns:=/NAME",
        )
        poses = list[PoseWithCovarianceStamped]()
        session.node.create_subscription(
            PoseWithCovarianceStamped, "amcl_pose", poses.append, LATCHED
        )
        notice = "waiting for the navigator to know where the robot is ..."
        if not session.await_or_report(lambda: poses, lambda: notice, _POSE):
            raise OneBotError("the navigator does not know where the robot is; see its log")
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
        goal = self._action.type.Goal()
        goal.pose.header.frame_id = "map"
        goal.pose.pose.position.x, goal.pose.pose.position.y = x, y
        *_, goal.pose.pose.orientation.z, goal.pose.pose.orientation.w = about_z(yaw)
        with self._action.sent(goal, self._on_feedback) as sent:
            if not sent.accepted:
                raise OneBotError("the navigator rejects the goal; its log has the reason")
            answer = sent.result(self._show_until)
        statuses = load_interface("action_msgs/msg/GoalStatus")
        if answer.status == statuses.STATUS_SUCCEEDED:
            print(f"arrived at {x:g}, {y:g} m")
        elif sent.interrupted():
            print("cancelled: the robot stops")
        else:
            code, text = answer.result.error_code, answer.result.error_msg
            raise OneBotError(f"not arrived ({code}): {text or 'the goal was ended'}")

    def _on_feedback(self, message: Any) -> None:
        self._feedback = message.feedback

    def _show_until(self, over: Callable[[], bool]) -> None:
        """Print the progress once a second."""
        while not over():
            self._session.spin(over, _PROGRESS)
            if (feedback := self._feedback) is not None and not over():
                left = feedback.estimated_time_remaining
                seconds = left.sec + left.nanosec / NS_PER_S
                distance = feedback.distance_remaining  # 0 until there is a path
                print(f"{distance:.1f} m, {seconds:.0f} s left" if distance else "planning ...")
