"""``onebot snapshot``: a picture of a robot, drawn without any display."""

import argparse
import math
import re
import sys
import tempfile
from argparse import Namespace
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
import rerun as rr
from numpy.typing import NDArray
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Header, String

from onebot_bringup.cli.options import Parser
from onebot_bringup.cli.session import PATIENCE, Session
from onebot_bringup.launch.arguments import UsageError
from onebot_bringup.viewer.display_server import open_recording
from onebot_bringup.viewer.displays.joint_plot import JOINT_STATE
from onebot_bringup.viewer.displays.tf import TF
from onebot_bringup.viewer.robot_view import DESCRIPTION, RobotView
from onebot_bringup.viewer.rrd import check_rrd, has_content, salvage
from onebot_bringup.viewer.topics import TopicSubscriptions
from onebot_bringup.viewer.view_source import ViewSource
from onebot_description.description import Description
from onebot_description.description.description import Mesh, Triple
from onebot_description.description.packages import PACKAGE_PATH, use_package_path
from onebot_description.errors import OneBotError, listing
from onebot_description.joints.limits import zero_position
from onebot_description.model import RobotModel
from onebot_description.model.robot_model import JointArrays
from onebot_description.node import LATCHED
from onebot_description.signals import KeyboardInterrupts
from onebot_description.wire.messages import (
    BAD_MESSAGE,
    deserialize_message,
    tf_arrays,
    time_message,
    transforms_message,
)
from onebot_description.wire.tf_message import TFMessage


def run(argv: Sequence[str]) -> int:
    """Run the command and return its exit code.

    Raises:
        OneBotError: what is to be drawn is not there, or nothing can draw; or the command line is
            wrong.
    """
    args = parse_command_line(argv)
    from onebot_bringup.viewer.pictures import check_picture  # slower to import

    check_picture(args.file)
    use_package_path(args.package_path)
    with KeyboardInterrupts(), tempfile.TemporaryDirectory(prefix="onebot-") as folder:
        _draw(args, Path(folder) / "scene.rrd")
    print(f"wrote {args.file} ({args.width} x {args.height})")
    return 0


def _draw(args: Namespace, scene: Path) -> None:
    """Draw what ``args`` ask for; ``scene`` is where a recording can be put."""
    from onebot_bringup.viewer.pictures import UnreadableError

    kind = kind_of(args.source)
    if kind == "running" and args.dashboard:
        _draw_viewer(args)
    elif kind == "rrd":
        source = Path(args.source)
        check_rrd(source)
        if has_content(source) is False:
            raise OneBotError(f"{source} holds nothing to draw")
        try:
            _render(args, source)
        except UnreadableError:
            salvage(source, scene)
            _warn(f"{source} was cut short, or is still being written: drawn as far as it goes")
            _render(args, scene)
    else:
        recording = open_recording(save=scene)
        try:
            _RECORDERS[kind](args, recording.stream)
        finally:
            recording.close()
        _render(args, scene)


def _render(args: Namespace, source: Path | str, **more: Any) -> None:
    from onebot_bringup.viewer.pictures import Framing, render

    eye, target = args.camera or (None, None)
    # A viewer at work goes on: only the time panel shows it.
    framing = Framing(args.dashboard, eye, target, time_panel=isinstance(source, Path))
    size = args.width, args.height
    render(source, args.file, *size, framing=framing, progress=_progress, **more)


def _draw_viewer(args: Namespace) -> None:
    with Session(args.ros_args) as session:
        viewer = running_viewer(session)
    _render(args, viewer.server, not_before_ns=viewer.stamp_ns)


def _progress(message: str) -> None:
    print(message, file=sys.stderr, flush=True)


def _warn(message: str) -> None:
    _progress(f"warning: {message}")


def _warn_of(messages: Sequence[str]) -> None:
    for message in messages:
        _warn(message)


# --- the command line -----------------------------------------------------------------------------

_SUMMARY = """\
draw a robot into a PNG file, without any display: the running robot as it is now; or with
SOURCE, a URDF or xacro file at given joint positions, or the end of a recording (.rrd, .mcap, or a
folder of record:=). name:=value are arguments that the xacro file declares; of a recording of ROS
messages, namespace:= chooses the robot, where several are recorded. package_path:= holds the
folders, joined by :, in which ROS packages are looked for first"""
NAMESPACE = "namespace"  # the one argument of a bag
_WIDTH, _HEIGHT = 1280, 720
# Pixels: the viewer's window does not become smaller, and software renders no larger one for sure.
_SMALLEST, _LARGEST = 100, 4096


def parse_command_line(argv: Sequence[str]) -> Namespace:
    """Return the options of the command.

    Returns:
        file, source, joints (by name), width, height, camera (eye and target, or None), dashboard,
        view, frame_prefix, package_path, arguments (by name; of xacro, or of a bag) and ros_args.

    Raises:
        UsageError: the command line is not understood.
    """
    parser = Parser("onebot snapshot", _SUMMARY)
    parser.usage = "onebot snapshot FILE.png [SOURCE] [options] [name:=value ...]"
    add = parser.add_argument
    add("file", type=Path, metavar="FILE.png", help="the picture; one that exists is replaced")
    add("source", nargs="?", metavar="SOURCE", help="what to draw (default: the running robot)")
    add(
        "--joints",
        nargs="+",
        action="extend",
        default=[],
        metavar="NAME=VALUE",
        help="positions in rad or m; 0 for the others, or mid-range where 0 is out of range",
    )
    add("--width", type=_pixels, default=_WIDTH, metavar="PIXELS", help=f"({_WIDTH})")
    add("--height", type=_pixels, default=_HEIGHT, metavar="PIXELS", help=f"({_HEIGHT})")
    add(
        "--camera",
        type=_camera,
        metavar="X,Y,Z[:X,Y,Z]",
        help="where to look from, and at, in metres in the fixed frame (default: the view's)",
    )
    add("--dashboard", action="store_true", help="the whole layout with its plots")
    add(
        "--view",
        default="",
        metavar="FILE",
        help="how to look at it, .yaml or .rbl, or none (default: the view of its description)",
    )
    add(
        "--frame-prefix",
        default="",
        metavar="PREFIX",
        help="of the robot's frames, as robot_state_publisher's (default: none; of a recording: "
        "as its frames are)",
    )
    words, given = _take_out_arguments(argv)
    args = parser.parse(words)
    args.package_path = given.pop(PACKAGE_PATH, "")
    args.arguments = given
    args.joints = dict(_joint(word) for word in args.joints)
    _check(args)
    return args


def _take_out_arguments(argv: Sequence[str]) -> tuple[list[str], dict[str, str]]:
    """Return the words for argparse, and the ``name:=value`` among them before ``--ros-args``."""
    words = list(argv)
    end = words.index("--ros-args") if "--ros-args" in words else len(words)
    given: dict[str, str] = {}
    rest: list[str] = []
    for word in words[:end]:
        name, assigned, value = word.partition(":=")
        if assigned and name and not name.startswith("-"):
            given[name] = value
        elif rest and rest[-1] == "--camera":
            rest[-1] = f"--camera={word}"  # argparse takes -1,0,1 for an option
        else:
            rest.append(word)
    return [*rest, *words[end:]], given


def _check(args: Namespace) -> None:
    kind = kind_of(args.source)
    if kind != "description":
        _check_arguments(kind, args.arguments)
        if args.joints:
            raise UsageError("--joints is for a URDF or xacro file as SOURCE")
    if args.source is not None and args.ros_args:
        raise UsageError(f"--ros-args is for the running robot, not for {args.source}")
    if args.frame_prefix and kind not in ("running", "bag"):
        raise UsageError(
            "--frame-prefix is for the running robot and for recordings of ROS messages, not for "
            f"{args.source}"
        )
    if kind == "running" and args.dashboard and (args.view or args.frame_prefix):
        raise UsageError("the dashboard of a running robot is its viewer's as it is")
    if kind == "rrd" and args.view:
        raise UsageError("a .rrd file has its view in it; --camera looks from somewhere else")


def _check_arguments(kind: str, given: Mapping[str, str]) -> None:
    """Refuse arguments of anything but a xacro file."""
    for name, value in given.items():
        if name != NAMESPACE:
            raise UsageError(f"{name}:={value} is for a URDF or xacro file as SOURCE")
        if kind == "running":
            space = value.strip("/")
            raise UsageError(f"write --ros-args -r __ns:=/{space} for a running robot's namespace")
        if kind == "rrd":
            raise UsageError(f"{name}:={value}: a .rrd file is drawn as it is")


def kind_of(source: str | None) -> str:
    """Return what ``source`` names: "running", "rrd", "bag" or "description"."""
    if source is None:
        return "running"
    path = Path(source)
    if path.is_dir():
        return "bag"  # whatever its name: record:=run.rrd makes a folder, too
    if path.suffix == ".rrd":
        return "rrd"
    if path.suffix in (".mcap", ".db3"):
        return "bag"
    return "description"


def _joint(word: str) -> tuple[str, float]:
    name, equals, value = word.rpartition("=")
    try:
        position = float(value)
    except ValueError:
        position = float("nan")
    if not equals or not name or not abs(position) < float("inf"):
        raise UsageError(f'--joints: "{word}" is not NAME=VALUE with a number in rad or m')
    return name, position


def _pixels(text: str) -> int:
    if not text.isdecimal() or not _SMALLEST <= int(text) <= _LARGEST:
        raise argparse.ArgumentTypeError(f"{text} is no number from {_SMALLEST} to {_LARGEST}")
    return int(text)


def _camera(text: str) -> object:
    try:
        return parse_camera(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def parse_camera(text: str) -> tuple[Triple, Triple | None]:
    """Return eye and target, metres in the fixed frame; no target if only the eye is given.

    Raises:
        ValueError: it is written otherwise, or it looks nowhere; the message has the right form.
    """
    eye, colon, target = text.partition(":")
    found = _vector(eye, text), _vector(target, text) if colon else None
    if found[0] == found[1]:
        raise ValueError(f'"{text}": eye and target are the same point')
    return found


def _vector(text: str, whole: str) -> Triple:
    try:
        x, y, z = (float(word) for word in text.split(","))
    except ValueError:
        x = y = z = math.nan
    if not math.isfinite(x) or not math.isfinite(y) or not math.isfinite(z):
        raise ValueError(f'"{whole}": write x,y,z of the eye, or x,y,z:x,y,z with its target (m)')
    return x, y, z


# --- the running robot --------------------------------------------------------------------------

# Nothing of a robot is slower than this, even on a busy machine (seconds).
_FRAMES = 6.0
_LISTED = 5


class RunningRobot:
    """Shows a running robot until all of its links have a transform."""

    def __init__(
        self, session: Session, view: str, recording: rr.RecordingStream, frame_prefix: str
    ) -> None:
        """Subscribe, relative to the session's namespace.

        Args:
            session: whose node subscribes.
            view: as for ``ViewSource``.
            recording: where to log.
            frame_prefix: put before link names to get their frames.

        Raises:
            OneBotError: there is no such view, or it is wrong.
        """
        self._session = session
        self._prefix = frame_prefix
        self._source = ViewSource(view)
        self._view = RobotView(
            recording,
            self._source.view,
            blueprint=self._source.blueprint_file,
            frame_prefix=frame_prefix,
            resolve=session.node.resolve_topic_name,
            report=self._report,
        )
        self._received: set[str] = set()  # topics
        self._broken: OneBotError | None = None  # what is wrong with the description
        self._warnings: list[str] = []
        self._topics = TopicSubscriptions(session.node, self._take)
        self._topics.set_topics(self._view.topics)

    def record(self) -> list[str]:
        """Log the robot as it is now.

        Returns:
            What could not be drawn, a sentence each.

        Raises:
            OneBotError: there is no robot, it is broken, or links have no transform.
        """
        robot = self._await_robot()
        if self._source.set_robot(robot.robot_name):
            self._warnings += self._view.set_view(self._source.view)
            self._topics.set_topics(self._view.topics)
        self._await_frames(robot)
        return self._warnings + self._view.finish()

    def _take(self, topic: str, kind: str, data: bytes, time_ns: int) -> None:
        self._received.add(topic)
        self._view.take(topic, kind, data, time_ns)

    def _report(self, _: str, error: Exception) -> None:
        if isinstance(error, OneBotError):
            self._broken = error  # another bad message is no reason to give up

    def _tick(self) -> None:
        self._topics.update()
        now_ns = int(self._session.node.get_clock().now().nanoseconds)
        warnings = self._view.tick(now_ns)
        self._warnings += warnings if self._view.robot is not None else []

    def _await_robot(self) -> Description:
        def found() -> bool:
            self._tick()
            return self._view.robot is not None or self._broken is not None

        topic = self._session.full_name("robot_description")
        if not self._session.look_for(found, f"a robot on {topic}"):
            raise OneBotError(
                f"no robot is running: nothing on {topic}{self._elsewhere()}; start one "
                "(onebot_bringup), or name its URDF or xacro file"
            )
        if self._view.robot is None:
            assert self._broken is not None
            raise self._broken
        return self._view.robot

    def _elsewhere(self) -> str:
        """Where descriptions are published, if in other namespaces."""
        node = self._session.node
        there = [
            name
            for name, _ in self._session.topics()
            if name.endswith("/robot_description") and node.count_publishers(name)
        ]
        if not there:
            return ""
        space = there[0].rpartition("/")[0] or "/"
        return f" (there: {listing(there)}; --ros-args -r __ns:={space} goes there)"

    def _await_frames(self, robot: Description) -> None:
        def complete() -> bool:
            self._tick()
            return not self._view.missing and self._view.has_fixed_frame

        if not self._session.spin(complete, PATIENCE):
            missing = self._view.missing or [self._source.view.fixed_frame]
            _progress(f"waiting for the frames of {listing(missing, _LISTED)} ...")
            self._session.spin(complete, _FRAMES - PATIENCE)
        if self._view.missing:
            raise OneBotError(self._hint(robot, self._view.missing))

    def _hint(self, robot: Description, missing: Sequence[str]) -> str:
        text = f"no transform of {listing(missing, _LISTED)} within {_FRAMES:.0f} s"
        frames = self._view.frames.names
        if not frames:
            return (
                f"{text}: nothing on /tf and /tf_static; robot_state_publisher publishes them, "
                "or the simulation is paused"
            )
        prefixes = {
            name[: -len(robot.root_link)]
            for name in frames
            if name.endswith(robot.root_link) and name != self._prefix + robot.root_link
        }
        if prefixes and len(missing) >= len(robot.link_names) - 1:
            return f"{text}; try --frame-prefix {listing(prefixes)}"
        joints = self._session.full_name("joint_states")
        if joints not in self._received:
            return f"{text}: nothing on {joints}, so the joints' positions are not known"
        return f"{text} (frames received: {listing(frames)})"


def _record_running(args: Namespace, recording: rr.RecordingStream) -> None:
    with Session(args.ros_args) as session:
        _warn_of(RunningRobot(session, args.view, recording, args.frame_prefix).record())


# --- a description at given joint positions -----------------------------------------------------

Floats = NDArray[np.float64]

_DESCRIPTION_TOPIC = "robot_description"
_SLACK = 1e-9  # rad or m beyond a limit: rounding
# Any moment will do, but always the same: a picture with a clock in it stays the same, too.
_NOW_NS = 1_700_000_000_000_000_000


def pose_of(model: RobotModel, description: Description, given: Mapping[str, float]) -> Floats:
    """Return the positions of all moving joints, (M,) in the model's order, rad or m.

    A joint that is not given is at 0, or in the middle of its range if 0 is not in it; mimic
    joints follow.

    Args:
        model: the robot's.
        description: the same robot's.
        given: positions by joint, rad or m.

    Raises:
        OneBotError: no such joint moves, it follows another one, or a limit is exceeded.
    """
    mimics = {joint.name: joint.mimic for joint in description.joints if joint.mimic is not None}
    for name in given:
        model.row(name)
        if name in mimics:
            leader = mimics[name].joint
            raise OneBotError(f'joint "{name}" follows joint "{leader}": give the position of that')
    rests = {
        name: zero_position(model.lower[row], model.upper[row])
        for row, name in enumerate(model.joints)
        if name not in mimics
    }
    positions = model.positions({**rests, **given})
    # A follower may be beyond its limits while its leader rests: nobody has asked for that.
    chosen = np.flatnonzero(positions != model.positions(rests))
    problems = [_beyond(model, row, positions[row]) for row in chosen.tolist()]
    if any(problems):
        raise OneBotError("\n".join(filter(None, problems)))
    return positions


def _beyond(model: RobotModel, row: int, position: float) -> str:
    lower, upper = model.lower[row], model.upper[row]
    if lower - _SLACK <= position <= upper + _SLACK:
        return ""
    return f'joint "{model.joints[row]}": {position:g} is out of its limits, {lower:g} to {upper:g}'


def record_pose(
    description: Description, positions: Floats, view: str, recording: rr.RecordingStream
) -> list[str]:
    """Log a robot at ``positions``.

    Args:
        description: the robot.
        positions: (M,) of the moving joints in the model's order, rad or m.
        view: as for ``ViewSource``. A fixed frame that only a running robot has, such as odom, is
            replaced by the robot's root link.
        recording: where to log.

    Returns:
        What could not be drawn, a sentence each.
    """
    model = RobotModel.from_description(description)
    source = ViewSource(view)
    source.set_robot(description.robot_name)
    config = source.view
    if config.fixed_frame not in description.link_names:
        config = replace(config, fixed_frame="")
    shown = RobotView(recording, config, blueprint=source.blueprint_file)
    joints = JointState(
        header=Header(stamp=time_message(_NOW_NS)), name=model.joints, position=positions.tolist()
    )
    for topic, kind, data in (
        (_DESCRIPTION_TOPIC, DESCRIPTION, serialize_message(String(data=description.urdf))),
        ("/tf_static", TF, _tf_message(model.fixed, model.fixed.constant)),
        ("/tf", TF, _tf_message(model.moving, model.moving.transforms(positions))),
        ("joint_states", JOINT_STATE, serialize_message(joints)),
    ):
        shown.take(topic, kind.name, bytes(data), _NOW_NS)
    return shown.tick(_NOW_NS) + shown.finish()


def _tf_message(joints: JointArrays, values: Floats) -> bytes:
    message = transforms_message(time_message(_NOW_NS), joints.parents, joints.children, values)
    return bytes(serialize_message(message))


def _record_description(args: Namespace, recording: rr.RecordingStream) -> None:
    from onebot_description.description import load_description

    description = load_description(args.source, args.arguments)
    lacking = _mesh_problems(description)  # of which the view warns
    _warn_of([text for text in description.notices if not text.endswith(lacking)])
    positions = pose_of(RobotModel.from_description(description), description, args.joints)
    warnings = record_pose(description, positions, args.view, recording)
    # What is wrong with the text itself was reported with the lines of its file.
    _warn_of([text for text in warnings if not text.startswith(f"{_DESCRIPTION_TOPIC}:")])


def _mesh_problems(description: Description) -> tuple[str, ...]:
    shapes = (
        part.shape for link in description.links for part in (*link.visuals, *link.collisions)
    )
    return tuple({shape.problem for shape in shapes if isinstance(shape, Mesh) and shape.problem})


# --- a bag --------------------------------------------------------------------------------------


def _record_bag(args: Namespace, recording: rr.RecordingStream) -> None:
    from onebot_bringup.bags.reader import Bag
    from onebot_bringup.bags.replay import log_bag

    view = Path(args.view).expanduser().absolute() if args.view else None
    if view is not None and not view.is_file():
        raise OneBotError(f"view {view}: there is no such file")
    log_bag(
        Bag(Path(args.source)),
        recording,
        view=view,
        frame_prefix=args.frame_prefix,
        namespace=args.arguments.get(NAMESPACE, ""),
        from_start=False,
        progress=_progress,
        warn=_warn,
    )


_RECORDERS: Mapping[str, Callable[[Namespace, rr.RecordingStream], None]] = {
    "running": _record_running,
    "description": _record_description,
    "bag": _record_bag,
}


# --- the viewer of a running robot: it has the curves and trails of before ----------------------

# On this host only: nothing else that a page may name is used.
_SERVER = re.compile(r"rerun\+http://127\.0\.0\.1:\d{1,5}/proxy(?![\w/.])")


def server_of(page: str) -> str:
    """Return the address of the recording's server that a viewer's page shows; "" if there is none.

    Args:
        page: the page's address, as rerun_viewer publishes it.
    """
    found = _SERVER.search(unquote(page))
    return found.group() if found else ""


@dataclass(frozen=True)
class RunningViewer:
    """A viewer that is running."""

    server: str  # the address of its recording
    # The time of something that is in it, nanoseconds; 0 where nothing moves. What was before that
    # is history, and has to arrive before a picture is taken.
    stamp_ns: int


def running_viewer(session: Session) -> RunningViewer:
    """Return the running viewer.

    Raises:
        OneBotError: no viewer with a page is running.
    """
    pages: list[str] = []
    stamps: list[int] = []

    def on_page(data: bytes) -> None:
        with suppress(ValueError):
            pages.append(server_of(deserialize_message(data, String).data))

    def on_tf(data: bytes) -> None:
        with suppress(*BAD_MESSAGE):  # a bad message is no reason to give up
            stamps.append(int(tf_arrays(data).stamps_ns.max(initial=0)))

    subscribe = session.node.create_subscription
    topic = session.full_name("rerun_viewer/page")
    subscribe(String, topic, on_page, LATCHED, raw=True)
    subscribe(TFMessage, "/tf", on_tf, 100, raw=True)
    if not session.look_for(lambda: pages and pages[-1], "the viewer"):
        raise OneBotError(
            f"no viewer's page on {topic}, and so no curves to draw; start the robot with "
            "viewer:=web, or draw a recording (save:=FILE.rrd). Without --dashboard, none is needed"
        )
    session.spin(lambda: stamps, PATIENCE)
    return RunningViewer(pages[-1], max(stamps, default=0))
