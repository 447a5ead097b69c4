"""``onebot navigate``: drives a robot to a place with its navigator."""

import math
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
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
        _drive(session, args.x, args.y, args.yaw)
    return 0


def _drive(session: Session, x: float, y: float, yaw: float | None) -> None:
    """Drive to a place, and print the progress.

    Raises:
        OneBotError: the robot does not arrive.
    """
    from geometry_msgs.msg import PoseWithCovarianceStamped

    from onebot_description.geometry.poses import about_z
    from onebot_description.ros.topic_qos import LATCHED

    action = Action(
        session,
        "nav2_msgs/action/NavigateToPose",
        f"{session.space}/navigate_to_pose",
        unanswered="the navigator does not answer: the robot may still drive",
        missing=": start the robot with navigate:=true, or choose a robot with --ros-args -r "
        "__ns:=/NAME",
    )
    poses, feedback = list[PoseWithCovarianceStamped](), deque[Any](maxlen=1)
    session.node.create_subscription(PoseWithCovarianceStamped, "amcl_pose", poses.append, LATCHED)
    notice = "waiting for the navigator to know where the robot is ..."
    if not session.await_or_report(lambda: poses, lambda: notice, _POSE):
        raise OneBotError("the navigator does not know where the robot is; see its log")
    start = poses[-1].pose.pose.position
    if yaw is None:
        yaw = math.atan2(y - start.y, x - start.x)
    goal = action.type.Goal()
    goal.pose.header.frame_id = "map"
    goal.pose.pose.position.x, goal.pose.pose.position.y = x, y
    *_, goal.pose.pose.orientation.z, goal.pose.pose.orientation.w = about_z(yaw)
    show_until = partial(_show_until, session, feedback)
    with action.executed(goal, show_until, feedback.append) as end:
        if end is None:
            raise OneBotError("the navigator rejects the goal; its log has the reason")
        if end.succeeded:
            print(f"arrived at {x:g}, {y:g} m")
        elif end.interrupted:
            print("cancelled: the robot stops")
        else:
            code, text = end.result.error_code, end.result.error_msg
            raise OneBotError(f"not arrived ({code}): {text or 'the goal was ended'}")


def _show_until(session: Session, feedback: Sequence[Any], over: Callable[[], bool]) -> None:
    """Print the progress once a second."""
    while not over():
        session.spin(over, _PROGRESS)
        if feedback and not over():
            left = feedback[-1].feedback.estimated_time_remaining
            distance = feedback[-1].feedback.distance_remaining  # 0 until there is a path
            seconds = left.sec + left.nanosec / NS_PER_S
            print(f"{distance:.1f} m, {seconds:.0f} s left" if distance else "planning ...")
