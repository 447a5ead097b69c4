"""Draws for ``onebot snapshot``: a running robot, a robot in a given pose, or a recording."""

import re
import sys
from argparse import Namespace
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Header, String

from onebot_bringup.cli.running_robots import description_topics, frame_prefix
from onebot_bringup.cli.session import PATIENCE, Session
from onebot_bringup.cli.snapshot import NAMESPACE, kind_of
from onebot_bringup.viewer.core.inbox import DESCRIPTION
from onebot_bringup.viewer.core.shown_robot import (
    ROBOT_DESCRIPTION,
    WORLD_DESCRIPTION,
    RobotToShow,
)
from onebot_bringup.viewer.core.transforms import TF
from onebot_bringup.viewer.display_server import open_recording
from onebot_bringup.viewer.displays.joint_plot import JOINT_STATE
from onebot_bringup.viewer.rendering import Framing, render
from onebot_bringup.viewer.robot_view import RobotView
from onebot_bringup.viewer.rrd import check_rrd, has_content, save_served
from onebot_bringup.viewer.topics import ViewFeed
from onebot_bringup.viewer.view_source import ViewSource
from onebot_control.poses import prefixed
from onebot_description.arrays import Floats
from onebot_description.description import Description
from onebot_description.description.description import Mesh
from onebot_description.errors import OneBotError, listing
from onebot_description.model import RobotModel
from onebot_description.model.robot_model import JointArrays
from onebot_description.ros.node import LATCHED
from onebot_description.ros.wire.messages import (
    deserialize_message,
    time_message,
    transforms_message,
)

if TYPE_CHECKING:
    import rerun as rr


def draw(args: Namespace, scene: Path) -> None:
    """Draw what the command line asks for; ``scene`` is a path for a temporary recording."""
    kind = kind_of(args.source)
    if kind == "rrd":
        source = Path(args.source)
        check_rrd(source)
        if has_content(source) is False:
            raise OneBotError(f"{source} holds nothing to draw")
        _render(args, source)
        return
    page = 0
    recording = open_recording(save=scene)
    try:
        if kind == "running":
            page = _record_running(args, recording.stream)
        elif kind == "bag":
            _record_bag(args, recording.stream)
        else:
            _record_description(args, recording.stream)
    finally:
        recording.close()
    if page:
        save_served(page, scene)
    _render(args, scene)


def _render(args: Namespace, source: Path) -> None:
    framing = Framing(args.dashboard, *(args.camera or (None, None)))
    render(source, args.file, args.width, args.height, framing=framing, progress=_progress)


def _progress(message: str) -> None:
    print(message, file=sys.stderr, flush=True)


def _warn(message: str) -> None:
    _progress(f"warning: {message}")


# --- the running robot --------------------------------------------------------------------------

# Seconds to wait for descriptions and frames, which take less even on a busy machine.
_FRAMES = 6.0
_TICK = 0.05  # seconds between two ticks
_MESSAGES = 1.0  # seconds to wait for topics that are seldom published
_LISTED = 5


def _record_running(args: Namespace, recording: "rr.RecordingStream") -> int:
    """Return the port of the running viewer's page, or 0 after recording the robots as they are.

    The viewer is preferred for its trails and curves.
    """
    with Session(args.ros_args) as session:
        if args.dashboard:
            page = page_port(session, _FRAMES)
            if not page:
                raise OneBotError(
                    f"no viewer's page on {session.full_name(_PAGE)}, and so no curves to draw; "
                    "start the robot with viewer:=web, or draw a recording (save:=FILE.rrd). "
                    "Without --dashboard, none is needed"
                )
            return page
        names = running_robots(session, args.frame_prefix)
        page = 0 if args.view or args.frame_prefix else page_port(session)
        if not page:
            for warning in RunningRobots(session, args.view, recording, names).record():
                _warn(warning)
        return page


class RunningRobots:
    """Shows running robots until all of their links have a transform."""

    def __init__(
        self,
        session: Session,
        view: str,
        recording: "rr.RecordingStream",
        robots: Sequence[RobotToShow],
    ) -> None:
        """Subscribe, relative to the session's namespace; for ``view`` see ``ViewSource``."""
        self._session = session
        self._robots = robots
        self._warnings: list[str] = []
        self._source = ViewSource(view, self._warnings.append)
        self._view = RobotView(
            recording,
            self._source.view,
            blueprint=self._source.blueprint_file,
            robots=robots,
            resolve=session.node.resolve_topic_name,
            report=self._report,
        )
        self._feed = ViewFeed(session.node, self._view)
        self._broken: OneBotError | None = None  # the error of an invalid description
        steady = Clock(clock_type=ClockType.STEADY_TIME)  # ROS time may stand still
        self._timer = session.node.create_timer(_TICK, self._tick, clock=steady)

    def _report(self, _: str, error: Exception) -> None:
        if isinstance(error, OneBotError):
            self._broken = error  # other bad messages are no reason to give up

    def _tick(self) -> None:
        """Show the messages that have come."""
        self._warnings += self._feed.update()
        warnings = self._feed.tick()
        self._warnings += warnings if self._view.robot is not None else []

    def _wait(self, done: Callable[[], bool], timeout: float) -> bool:
        self._tick()
        return bool(self._session.spin(done, timeout))

    def await_descriptions(self) -> Description:
        """Return the first robot's description, once every robot has one."""
        count = len(self._robots)
        self._wait(lambda: len(self._view.robots) >= count or self._broken is not None, _FRAMES)
        lacking = [str(robot) for robot in self._robots if str(robot) not in self._view.robots]
        if self._broken is not None and lacking:
            raise self._broken
        if self._view.robot is None or lacking:
            raise OneBotError(
                f"no description within {_FRAMES:.0f} s of the robots in {listing(lacking)}"
            )
        return self._view.robot

    def record(self) -> list[str]:
        """Log the robots as they are now; return a sentence per thing that could not be drawn."""
        robot = self.await_descriptions()
        if self._source.set_robot(robot.robot_name):
            self._warnings += self._view.set_view(self._source.view)
        view, feed = self._view, self._feed

        def is_complete() -> bool:
            world = self._session.node.count_publishers(WORLD_DESCRIPTION)
            lacks_world = world and WORLD_DESCRIPTION not in feed.received
            return not (lacks_world or view.stage.missing) and view.stage.has_fixed_frame

        if not self._wait(is_complete, PATIENCE):
            missing = view.stage.missing or [view.stage.view_frame]
            _progress(f"waiting for the frames of {listing(missing, _LISTED)} ...")
            self._wait(is_complete, _FRAMES - PATIENCE)
        if view.stage.missing:
            raise OneBotError(self._hint(robot, view.stage.missing))

        def has_all() -> bool:
            return feed.received.issuperset(item.topic for item in view.offered if item.visible)

        self._wait(has_all, _MESSAGES)  # only briefly, since some topics are seldom published
        self._timer.cancel()
        return [*dict.fromkeys(self._warnings), *view.finish()]

    def _hint(self, robot: Description, missing: Sequence[str]) -> str:
        text = f"no transform of {listing(missing, _LISTED)} within {_FRAMES:.0f} s"
        frames, first = self._view.stage.frames.names, self._robots[0]
        if not frames:
            return (
                f"{text}: nothing on /tf and /tf_static; robot_state_publisher publishes them, "
                "or the simulation is paused"
            )
        if len(self._robots) == 1:
            root = robot.root_link
            prefixes = {
                name.removesuffix(root)
                for name in frames
                if name.endswith(root) and name != first.frame_prefix + root
            }
            if prefixes and len(missing) >= len(robot.link_names) - 1:
                return f"{text}; try --frame-prefix {listing(prefixes)}"
            joints = self._session.full_name(first.topic("joint_states"))
            if joints not in self._feed.received:
                return f"{text}: nothing on {joints}, so the joints' positions are not known"
        return f"{text} (frames received: {listing(frames)})"


def running_robots(session: Session, prefix: str = "") -> list[RobotToShow]:
    """Return the robots that run in the session's namespace and below, with their prefixes."""
    namespace = session.node.get_namespace().rstrip("/")
    topic = session.full_name(ROBOT_DESCRIPTION)
    topics = session.look_for(lambda: description_topics(session, namespace), f"a robot on {topic}")
    if not topics:
        others = description_topics(session)
        there = [
            f" (there: {listing(others)}; --ros-args -r __ns:={space} goes there)"
            for space in _namespaces(others[:1])
        ]
        raise OneBotError(
            f"no robot is running: nothing on {topic}{''.join(there)}; start one "
            "(onebot_bringup), or name its URDF or xacro file"
        )
    session.discover()
    topics = description_topics(session, namespace) or topics
    if prefix and len(topics) > 1:
        raise OneBotError(
            f"--frame-prefix is one robot's, and several run, in {listing(_namespaces(topics))}: "
            "choose one by --ros-args -r __ns:=NAMESPACE"
        )
    robots = []
    for topic in topics:
        space, of_robot = topic.rpartition("/")[0], prefix
        if not prefix:
            published = frame_prefix(session, session.publishers(topic))
            # If there are several robots, each has a different prefix.
            of_robot = prefixed("", len(topics) > 1, "", space) if published is None else published
        robots.append(RobotToShow(space, of_robot, plotted=len(topics) == 1))
    return robots


def _namespaces(topics: Sequence[str]) -> list[str]:
    return [topic.rpartition("/")[0] or "/" for topic in topics]


# --- a description at given joint positions -----------------------------------------------------


# Any time will do, but it is constant, so that pictures that show the time do not change.
_NOW_NS = 1_700_000_000_000_000_000


def record_pose(
    description: Description, positions: Floats, view: str, recording: "rr.RecordingStream"
) -> list[str]:
    """Log a robot at some joint positions.

    A fixed frame of the view that only a running robot has, such as odom, is replaced by the
    robot's root link.

    Args:
        description: the robot.
        positions: (M,) positions of the movable joints in the model's order, rad or m.
        view: see ``ViewSource``.
        recording: where to log.

    Returns:
        One sentence per thing that could not be drawn.
    """
    model = RobotModel.from_description(description)
    notices: list[str] = []
    source = ViewSource(view, notices.append)
    source.set_robot(description.robot_name)
    config = source.view
    if config.fixed_frame not in description.link_names:
        config = replace(config, fixed_frame="")
    robot_view = RobotView(recording, config, blueprint=source.blueprint_file, plots=False)
    joints = JointState(
        header=Header(stamp=time_message(_NOW_NS)), name=model.joints, position=positions.tolist()
    )
    for topic, kind, data in (
        (ROBOT_DESCRIPTION, DESCRIPTION, serialize_message(String(data=description.urdf))),
        ("/tf_static", TF, _tf_message(model.fixed, model.fixed.constant)),
        ("/tf", TF, _tf_message(model.moving, model.moving.transforms(positions))),
        ("joint_states", JOINT_STATE, serialize_message(joints)),
    ):
        robot_view.take(topic, kind.name, bytes(data), _NOW_NS)
    return notices + robot_view.tick(_NOW_NS) + robot_view.finish()


def _tf_message(joints: JointArrays, values: Floats) -> bytes:
    message = transforms_message(time_message(_NOW_NS), joints.parents, joints.children, values)
    return bytes(serialize_message(message))


def _record_description(args: Namespace, recording: "rr.RecordingStream") -> None:
    description = args.description
    lacking = _mesh_problems(description)  # the view warns of them
    for text in description.notices:
        if not text.endswith(lacking):
            _warn(text)
    positions = RobotModel.from_description(description).pose(args.joints)
    warnings = record_pose(description, positions, args.view, recording)
    for text in warnings:
        # Problems of the text itself were already reported with the lines of its file.
        if not text.startswith(f"{ROBOT_DESCRIPTION}:"):
            _warn(text)


def _mesh_problems(description: Description) -> tuple[str, ...]:
    shapes = (
        part.shape for link in description.links for part in (*link.visuals, *link.collisions)
    )
    return tuple({shape.problem for shape in shapes if isinstance(shape, Mesh) and shape.problem})


# --- a bag --------------------------------------------------------------------------------------


def _record_bag(args: Namespace, recording: "rr.RecordingStream") -> None:
    from onebot_bringup.bags.bag_reader import Bag
    from onebot_bringup.bags.shown_bag import log_bag

    log_bag(
        Bag(Path(args.source)),
        recording,
        view=args.view,
        frame_prefix=args.frame_prefix,
        namespace=args.arguments.get(NAMESPACE, ""),
        from_start=False,
        progress=_progress,
        warn=_warn,
    )


# --- the viewer of a running robot, which has earlier curves and trails -------------------------

_PAGE = "rerun_viewer/page"
# Only addresses on this host are accepted, whatever a page claims.
_ADDRESS = re.compile(r"http://127\.0\.0\.1:(\d{1,5})/")


def port_of(address: str) -> int:
    """Parse the port in a page's address; 0 if it is not on this host."""
    match = _ADDRESS.match(address)
    return int(match[1]) if match else 0


def page_port(session: Session, patience: float = PATIENCE) -> int:
    """Return the port of the running viewer's page; 0 for none within ``patience`` seconds."""
    ports: list[int] = []

    def on_page(data: bytes) -> None:
        with suppress(ValueError):
            ports.append(port_of(deserialize_message(data, String).data))

    topic = session.full_name(_PAGE)
    session.node.create_subscription(String, topic, on_page, LATCHED, raw=True)
    session.discover()
    if session.node.count_publishers(topic):
        session.spin(lambda: ports and ports[-1], patience)
    return ports[-1] if ports else 0
