"""``onebot trajectory``: moves joints to positions by a joint_trajectory_controller."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from onebot_bringup.cli.action import Action, GoalEnd
from onebot_bringup.cli.options import assignment
from onebot_bringup.cli.running_controllers import (
    RunningController,
    controller_of,
    running_controllers,
)
from onebot_bringup.cli.session import Session
from onebot_bringup.launch.arguments import Settings, argument, split, table
from onebot_description.description.tree_text import aligned, cell
from onebot_description.errors import OneBotError
from onebot_description.timing import NS_PER_S

if TYPE_CHECKING:
    from onebot_description.description import Joint

_above_zero = partial(argument, above=0.0, at_most=1e6)


@dataclass(frozen=True)
class TrajectorySettings(Settings):
    """The arguments of the command."""

    time: float = _above_zero(2.0, "how long the motion takes, s")
    controller: str = argument("", "the node that moves the joints; default: the only one that can")
    tolerance: float | None = _above_zero(
        None,
        "allowed error of each joint at the end, rad or m, met within twice the time; default: "
        "the controller's",
    )


_CLOSE = 1e-3  # rad or m; error at the end that is accepted where the controller accepts any
_ROUNDING = 2e-6  # rad or m; a controller may clamp a position to a limit
_HELP = f"""usage: onebot trajectory [JOINT=POSITION ...] [name:=value ...] [--ros-args ...]

Moves joints to positions, in rad or m, by an action of a joint_trajectory_controller, and waits for
its result. The controller's other joints stay where they are. Ctrl-C cancels it: the joints stop.
Without a joint it lists the controllers, and where their joints are.

Arguments and their defaults:
{table(TrajectorySettings.arguments())}

--ros-args is passed to ROS; -r __ns:=NS there restricts it to the controllers in a namespace. Exit
codes: 0 the goal was reached; 1 it was rejected, aborted or canceled, or without tolerance:= a
joint was more than {_CLOSE:g} rad or m away when the time was over; 2 the command line is wrong;
130 Ctrl-C."""

_ACTION = "control_msgs/action/FollowJointTrajectory"
_ANSWER = 10.0  # s to wait for an answer of the controller
_LOG = 0.3  # s to wait for the controller's log messages
_PROGRESS = 1.0  # s between two lines of the progress


def run(argv: Sequence[str]) -> int:
    """Run the command and return its exit code."""
    arguments = split(argv)
    if arguments.help or arguments.show:
        print(_HELP if arguments.help else table(TrajectorySettings.arguments()))
        return 0
    positions = dict(map(assignment, arguments.positional))
    settings = TrajectorySettings.read(arguments.given)
    with Session(arguments.ros_args) as session:
        controllers = running_controllers(session, settings.controller)
        if positions:
            controller = controller_of(controllers, list(positions))
            motion = _Motion(session, controller, list(positions), settings.time)
            motion.follow(_goal(controller, positions, settings.time, settings.tolerance))
        else:
            print("\n".join(_listed(session, controllers)))
    return 0


# The list of controllers ------------------------------------------------------------------------


def _listed(session: Session, controllers: Sequence[RunningController]) -> Iterator[str]:
    """Yield lines with the controllers, their joints' positions, and the limits if known."""
    for controller in controllers:
        limits = _limits(session, controller.name.rpartition("/")[0])
        positions = zip(controller.joints, controller.state.feedback.positions, strict=True)
        rows = [
            (f"  {cell(joint)}", _shown(position), limits.get(joint, ""))
            for joint, position in positions
        ]
        yield from [controller.name, *aligned([("  joint", "position", "limits"), *rows])]


def _limits(session: Session, namespace: str) -> dict[str, str]:
    """Return the limits of the joints of a robot, as text; none without a readable description."""
    from std_msgs.msg import String

    from onebot_description.description import parse_description
    from onebot_description.ros.topic_qos import LATCHED

    topic, texts = f"{namespace}/robot_description", list[String]()
    session.node.create_subscription(String, topic, texts.append, LATCHED)
    # A publisher of another process may be discovered after the controllers.
    session.look_for(lambda: texts, topic)
    with suppress(OneBotError, IndexError):
        return {joint.name: _range(joint) for joint in parse_description(texts[0].data).joints}
    return {}


def _shown(position: float) -> str:
    return f"{round(position, 3) + 0.0:.3f}"  # avoid -0.000


def _range(joint: "Joint") -> str:
    if joint.lower is None or joint.upper is None:
        return "endless" if joint.kind == "continuous" else ""
    return f"{joint.lower:g} … {joint.upper:g} {'m' if joint.kind == 'prismatic' else 'rad'}"


# Motions ----------------------------------------------------------------------------------------


def _goal(
    controller: RunningController,
    positions: Mapping[str, float],
    seconds: float,
    tolerance: float | None,
) -> Any:
    """Return a goal with a single point, at which all joints of the controller are at rest."""
    from rclpy.duration import Duration

    from onebot_description.ros.wire.interfaces import load_interface

    joints, reference = controller.joints, controller.state.reference.positions
    point = load_interface("trajectory_msgs/msg/JointTrajectoryPoint")()
    point.positions = [
        positions.get(joint, stays) for joint, stays in zip(joints, reference, strict=True)
    ]
    point.velocities = point.accelerations = [0.0] * len(joints)
    point.time_from_start = Duration(seconds=seconds).to_msg()
    goal = load_interface(_ACTION).Goal()
    goal.trajectory.joint_names, goal.trajectory.points = joints, [point]
    if tolerance:
        kind = load_interface("control_msgs/msg/JointTolerance")
        goal.goal_tolerance = [kind(name=joint, position=tolerance) for joint in joints]
        goal.goal_time_tolerance = point.time_from_start
    return goal


class _Motion:
    """Sends a goal to a controller and follows its execution."""

    def __init__(
        self, session: Session, controller: RunningController, joints: Sequence[str], seconds: float
    ) -> None:
        """Discover the controller's action; ``joints`` and ``seconds`` are for the progress."""
        from rcl_interfaces.msg import Log

        self._session, self._controller = session, controller
        self._joints, self._seconds = joints, seconds
        self._logged: list[str] = []
        self._target: Sequence[float] = ()  # positions whose error we check; empty: none
        self._at_end: Any = None  # the controller's first state there
        session.node.create_subscription(Log, "/rosout", self._on_log, 10)
        self._action = Action(
            session,
            _ACTION,
            f"{controller.name}/follow_joint_trajectory",
            unanswered=f"{controller.name} does not answer: the joints may still move",
        )

    def _on_log(self, message: Any) -> None:
        name = self._controller.name.strip("/").replace("/", ".")
        if message.name == name and message.level >= message.WARN:
            self._logged.append(message.msg)

    def _on_state(self, state: Any) -> None:
        """Keep the state at the end of the trajectory."""
        pairs = zip(state.reference.positions, self._target, strict=True)
        if self._at_end is None and all(abs(at - end) <= _ROUNDING for at, end in pairs):
            self._at_end = state

    def follow(self, goal: Any) -> None:
        """Send the goal, and print its progress and how it ended; Ctrl-C cancels it.

        Raises:
            OneBotError: the goal is not reached, or, if it has no tolerances, not in time.
        """
        if not goal.goal_tolerance:
            self._target = goal.trajectory.points[-1].positions
            self._controller.on_state = self._on_state
        with self._action.executed(goal, self._show_until) as end:
            if end is None:
                raise self._failure(f"REJECTED by {self._controller.name}")
            self._conclude(end)

    def _show_until(self, over: Callable[[], bool]) -> None:
        """Print the progress once a second."""
        began = self._time()
        while not over():
            print(f"{self._time() - began:.1f} of {self._seconds:g} s: {self._at()}")
            self._session.spin(over, _PROGRESS)

    def _time(self) -> float:
        stamp = self._controller.state.header.stamp
        return float(stamp.sec + stamp.nanosec / NS_PER_S)

    def _at(self) -> str:
        """Return the positions of the joints that the user named, as text."""
        state = self._controller.state
        positions = dict(zip(state.joint_names, state.feedback.positions, strict=True))
        return ", ".join(f"{joint} {_shown(positions[joint])}" for joint in self._joints)

    def _conclude(self, end: GoalEnd) -> None:
        if end.succeeded:
            self._report_success(end.result.error_string)
        elif end.canceled and end.interrupted:
            print("CANCELED: the joints hold where they are")
        elif end.canceled:
            raise OneBotError("CANCELED by another client: the joints hold where they are")
        else:
            raise self._failure(f"ABORTED ({end.result.error_code}): {end.result.error_string}")

    def _report_success(self, text: str) -> None:
        """Print the result and the largest error; controllers may accept any error in time."""
        # The state may be received after the result.
        self._session.spin(lambda: self._at_end or not len(self._target), _ANSWER)
        state = self._at_end or self._controller.state
        error, joint = max(zip(map(abs, state.error.positions), state.joint_names, strict=True))
        if len(self._target) and error > _CLOSE:
            raise OneBotError(
                f"{joint} was {error:.2g} rad or m away from its goal after {self._seconds:g} s, "
                "which the controller accepts: a limit of velocity or effort, or an obstacle, "
                "holds it back; choose a longer time:=, or a tolerance:="
            )
        print(f"SUCCESSFUL: {text}\nlargest error: {error:.2g}, of {joint}")

    def _failure(self, text: str) -> OneBotError:
        """Return the error, with the controller's log messages."""
        self._session.spin_for(_LOG)
        logged = [line for line in self._logged if line not in text]
        reasons = logged or [f"the log of {self._controller.name} has the reason"]
        return OneBotError("\n".join([text, *reasons]))
