"""``onebot snapshot``: a picture of a robot, drawn without any display."""

import argparse
import math
import re
import signal
import subprocess
import sys
import tempfile
from argparse import Namespace
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import FrameType
from typing import Any, NoReturn
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from onebot_bringup.cli.main import Parser
from onebot_bringup.cli.replay import NOTHING
from onebot_bringup.cli.session import PATIENCE, Session
from onebot_bringup.launch.arguments import UsageError
from onebot_bringup.viewer.display_server import open_recording, program
from onebot_bringup.viewer.displays.tf import FrameTree
from onebot_bringup.viewer.robot_view import LiveView
from onebot_bringup.viewer.view_config import ViewConfig, load_view, view_for
from onebot_description.description import Description, read_description
from onebot_description.description.description import Triple
from onebot_description.errors import OneBotError, did_you_mean, listing
from onebot_description.joints.limits import zero_position
from onebot_description.model import RobotModel
from onebot_description.model.robot_model import JointArrays
from onebot_description.node import LATCHED, SENSOR, STATIC_TF
from onebot_description.wire.messages import (
    BAD_MESSAGE,
    TfArrays,
    deserialize_message,
    one_joint_state,
    tf_arrays,
)
from onebot_description.wire.tf_message import TFMessage

# A camera as it is written on a command line: ``x,y,z`` or ``x,y,z:tx,ty,tz``.


def parse_camera(text: str) -> tuple[Triple, Triple | None]:
    """Return eye and target, metres in the fixed frame; no target if only the eye is given.

    Raises:
        ValueError: it is written otherwise, or it looks nowhere; the message says how to write it.
    """
    eye, colon, target = text.partition(":")
    found = _vector(eye, text), _vector(target, text) if colon else None
    if found[0] == found[1]:
        raise ValueError(f'"{text}": the camera stands where it looks at')
    return found


def _vector(text: str, whole: str) -> Triple:
    try:
        x, y, z = (float(word) for word in text.split(","))
    except ValueError:
        x = y = z = math.nan
    if not math.isfinite(x) or not math.isfinite(y) or not math.isfinite(z):
        raise ValueError(f'"{whole}": write x,y,z of the eye, or x,y,z:x,y,z with its target (m)')
    return x, y, z


# The command line of ``onebot snapshot``.

_SUMMARY = """\
draw a robot into a PNG file, without any display: the running robot as it stands now; or with
SOURCE, a URDF or xacro file at given joint positions, or the end of a recording (.rrd, .mcap, or a
folder of record:=). name:=value are arguments that the xacro file declares; of a recording of ROS
messages, namespace:= chooses the robot, where several are recorded"""
NAMESPACE = "namespace"  # the one argument of a bag
_WIDTH, _HEIGHT = 1280, 720
# Pixels: the viewer's window does not become smaller, and software renders no larger one for sure.
_SMALLEST, _LARGEST = 100, 4096


def parse_command_line(argv: Sequence[str]) -> Namespace:
    """Return the options of the command.

    Returns:
        file, source, joints (by name), width, height, camera (eye and target, or None), dashboard,
        view, frame_prefix, arguments (by name; of xacro, or of a bag) and ros_args.

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
        help="where to look from, and at, in metres in the fixed frame (default: as the view says)",
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
    """Complain about arguments of anything but a xacro file."""
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


# Which view a picture is made with: the one asked for, or else the robot's own.


@dataclass(frozen=True)
class ChosenView:
    """How to look at the robot; ``blueprint`` is a ``.rbl`` file for the layout, if any."""

    config: ViewConfig = field(default_factory=ViewConfig)
    blueprint: Path | None = None


def choose_view(asked: str, robot_name: str) -> ChosenView:
    """Return the view to use.

    Args:
        asked: a view file (.yaml), a layout saved in the viewer (.rbl), "none" for neither, or ""
            for the view in the description's package, if there is one.
        robot_name: as its URDF says.

    Raises:
        OneBotError: there is no such file, or it is wrong.
    """
    own = None if asked == "none" else view_for(robot_name)
    if asked in ("", "none"):
        return ChosenView() if own is None else ChosenView(load_view(own))
    path = Path(asked).expanduser().absolute()
    if path.suffix != ".rbl":
        return ChosenView(load_view(path))
    if not path.is_file():
        raise OneBotError(f"view {path}: there is no such file")
    return ChosenView(ViewConfig() if own is None else load_view(own), path)


# The running robot as it stands now: heard on its topics until every link has its place.

# Nothing of a robot is slower than this, even on a busy machine (seconds).
_FRAMES = 6.0
_LISTED = 5
_STRANGE = suppress(*BAD_MESSAGE)  # a strange message is no reason to give up
# Everything is shown as of one moment, always the same: the picture is of places, not of times.
_NOW_NS = 1_700_000_000_000_000_000


class HeardRobot:
    """What the topics say of a robot."""

    def __init__(self, session: Session, frame_prefix: str) -> None:
        """Listen, relative to the session's namespace; links have ``frame_prefix`` on /tf."""
        self._session = session
        self._prefix = frame_prefix
        self._urdf = ""
        self._frames = FrameTree()
        self._joints: dict[str, float] = {}
        listen = session.node.create_subscription
        listen(String, "robot_description", self._on_description, LATCHED, raw=True)
        listen(TFMessage, "/tf", self._on_tf, 100, raw=True)
        listen(TFMessage, "/tf_static", self._on_tf, STATIC_TF, raw=True)
        listen(JointState, "joint_states", self._on_joints, SENSOR, raw=True)

    def _on_description(self, data: bytes) -> None:
        with _STRANGE:
            self._urdf = deserialize_message(data, String).data

    def _on_tf(self, data: bytes) -> None:
        with _STRANGE:
            heard = tf_arrays(data)
            self._frames.update(heard.parents, heard.children, heard.translations, heard.rotations)

    def _on_joints(self, data: bytes) -> None:
        with _STRANGE:
            state = one_joint_state(data)
            if len(state.positions) == len(state.names):
                self._joints.update(zip(state.names, state.positions.tolist(), strict=True))

    def record(self, asked_view: str, rrd: Path) -> list[str]:
        """Record the robot into the file ``rrd`` once all its links have a place.

        Args:
            asked_view: as for ``choose_view``.
            rrd: the recording to write.

        Returns:
            What could not be drawn, a sentence each.

        Raises:
            OneBotError: there is no robot, it is broken, or links have no place; says which.
        """
        robot = self._description()
        view = choose_view(asked_view, robot.robot_name)
        wanted = view.config.fixed_frame
        self._await_frames(robot, wanted)
        config, problems = view.config, []
        if wanted and not self._known(wanted):
            known = did_you_mean(wanted, self._frames.names, "frames heard")
            problems.append(f'the fixed frame "{wanted}" is not on /tf{known}')
            config = replace(config, fixed_frame="")
        recording = open_recording(save=rrd)
        try:
            live = LiveView(
                recording.stream, config, blueprint=view.blueprint, frame_prefix=self._prefix
            )
            return problems + live.set_description(self._urdf) + self._log(live)
        finally:
            recording.close()

    def _log(self, live: LiveView) -> list[str]:
        edges = self._frames.edges
        live.add_transforms(
            TfArrays(
                [edge.parent for edge in edges.values()],
                list(edges),
                np.full(len(edges), _NOW_NS),
                np.array([edge.translation for edge in edges.values()]).reshape(-1, 3),
                np.array([edge.rotation for edge in edges.values()]).reshape(-1, 4),
            )
        )
        if self._joints:
            names = tuple(sorted(self._joints))
            positions = np.array([self._joints[name] for name in names])
            live.add_joints(_NOW_NS, names, positions, np.zeros(0))
        problems = live.tick(_NOW_NS)
        live.finish(_NOW_NS)
        return problems

    def _description(self) -> Description:
        topic = self._session.full_name("robot_description")
        if not self._session.look_for(lambda: self._urdf, f"a robot on {topic}"):
            raise OneBotError(
                f"no robot is running: nothing on {topic}{self._elsewhere()}; start one "
                "(onebot_bringup), or name its URDF or xacro file"
            )
        return read_description(self._urdf, "robot_description")

    def _elsewhere(self) -> str:
        """Say where descriptions are published, if in other namespaces."""
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

    def _await_frames(self, robot: Description, fixed_frame: str) -> None:
        def placed() -> bool:
            return not self._missing(robot) and (not fixed_frame or self._known(fixed_frame))

        if not self._session.spin(placed, PATIENCE):
            missing = self._missing(robot) or [fixed_frame]
            print(f"waiting for the frames of {listing(missing, _LISTED)} ...", file=sys.stderr)
            self._session.spin(placed, _FRAMES - PATIENCE)
        missing = self._missing(robot)
        if missing:
            raise OneBotError(self._hint(robot, missing))

    def _missing(self, robot: Description) -> list[str]:
        """Frames of links that nothing connects with the frame of the root link."""
        top = self._frames.top(self._prefix + robot.root_link)
        frames = [self._prefix + link for link in robot.link_names]
        return [frame for frame in frames if self._frames.top(frame) != top]

    def _hint(self, robot: Description, missing: list[str]) -> str:
        text = f"no transform of {listing(missing, _LISTED)} within {_FRAMES:.0f} s"
        if not self._frames.edges:
            return (
                f"{text}: nothing on /tf and /tf_static; robot_state_publisher publishes them, "
                "or the simulation is paused"
            )
        prefixes = {
            name[: -len(robot.root_link)]
            for name in self._frames.names
            if name.endswith(robot.root_link) and name != self._prefix + robot.root_link
        }
        if prefixes and len(missing) >= len(robot.link_names) - 1:
            return f"{text}; try --frame-prefix {listing(prefixes)}"
        if not self._joints:
            joints = self._session.full_name("joint_states")
            return f"{text}: nothing on {joints}, so nobody knows where the joints stand"
        return f"{text} (frames heard: {listing(self._frames.names)})"

    def _known(self, frame: str) -> bool:
        return bool({frame, self._prefix + frame} & self._frames.names)


# A robot as its description has it, at given joint positions, for a picture without ROS.

Floats = NDArray[np.float64]

# Any moment will do, but always the same: a picture with a clock in it stays the same, too.
_SLACK = 1e-9  # rad or m beyond a limit: rounding


def pose_of(model: RobotModel, description: Description, given: Mapping[str, float]) -> Floats:
    """Return the positions of all moving joints, (M,) in the model's order, rad or m.

    A joint that is not given stands at 0, or in the middle of its range if 0 is not in it; mimic
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
    problems = [_beyond(model, row, positions[row]) for row in range(len(positions))]
    if any(problems):
        raise OneBotError("\n".join(filter(None, problems)))
    return positions


def _beyond(model: RobotModel, row: int, position: float) -> str:
    lower, upper = model.lower[row], model.upper[row]
    if lower - _SLACK <= position <= upper + _SLACK:
        return ""
    return f'joint "{model.joints[row]}": {position:g} is out of its limits, {lower:g} to {upper:g}'


def record_pose(
    description: Description,
    positions: Floats,
    view: ViewConfig,
    blueprint: Path | None,
    rrd: Path,
) -> list[str]:
    """Record the robot at ``positions`` into the file ``rrd``.

    Args:
        description: the robot.
        positions: (M,) of the moving joints in the model's order, rad or m.
        view: how to look at it. A fixed frame that only a running robot has, such as odom, gives
            way to the robot's root link.
        blueprint: a ``.rbl`` file whose layout takes the place of the view's.
        rrd: the recording to write.

    Returns:
        What could not be drawn, a sentence each.
    """
    model = RobotModel.from_description(description)
    if view.fixed_frame not in description.link_names:
        view = replace(view, fixed_frame="")
    recording = open_recording(save=rrd)
    try:
        live = LiveView(recording.stream, view, blueprint=blueprint)
        problems = live.set_description(description.urdf)
        live.add_transforms(_transforms(model.fixed, model.fixed.constant), static=True)
        live.add_transforms(_transforms(model.moving, model.moving.transforms(positions)))
        live.add_joints(_NOW_NS, model.joints, positions, np.zeros(0))
        problems += live.tick(_NOW_NS)
        live.finish(_NOW_NS)
    finally:
        recording.close()
    return problems


def _transforms(joints: JointArrays, values: Floats) -> TfArrays:
    stamps = np.full(len(values), _NOW_NS)
    return TfArrays(
        list(joints.parents), list(joints.children), stamps, values[:, :3], values[:, 3:]
    )


# Recordings as they come: whole, cut short by a crash, or of ROS messages.

_COPYING = 120.0  # seconds


def salvage(rrd: Path, copy: Path) -> None:
    """Copy what is whole of a recording that was cut short, or is still being written.

    Raises:
        OneBotError: nothing is.
    """
    command = [str(program()), "rrd", "merge", "--continue-on-error", "-o", str(copy)]
    done = subprocess.run(
        [*command, str(rrd.absolute())], capture_output=True, timeout=_COPYING, check=False
    )
    if done.returncode or not copy.is_file() or copy.stat().st_size < NOTHING:
        raise OneBotError(f"{rrd} was cut short before anything was in it")


def record_bag(
    source: Path,
    view: str,
    rrd: Path,
    say: Callable[[str], None],
    warn: Callable[[str], None],
    frame_prefix: str = "",
    namespace: str = "",
) -> None:
    """Record what a bag of ROS messages holds of a robot into the file ``rrd``.

    Args:
        source: a .mcap or .db3 file, or the folder of one.
        view: a view file (.yaml), a layout saved in the viewer (.rbl), or "" for the robot's own.
        rrd: the recording to write.
        say: told how far it is, when that takes over two seconds.
        warn: told what cannot be shown.
        frame_prefix: put before link names to get their frames; "" to find it out.
        namespace: of the robot to draw; "" for the first.

    Raises:
        OneBotError: it cannot be read, or holds nothing of a robot.
    """
    from onebot_bringup.bags.reader import Bag
    from onebot_bringup.bags.replay import log_bag  # brings rclpy

    path = Path(view).expanduser().absolute() if view else None
    if path is not None and not path.is_file():
        raise OneBotError(f"view {path}: there is no such file")
    recording = open_recording(save=rrd)
    try:
        log_bag(
            Bag(source),
            recording.stream,
            view=path,
            frame_prefix=frame_prefix,
            namespace=namespace,
            from_start=False,
            progress=say,
            warn=warn,
        )
    finally:
        recording.close()


# The viewer of a running robot: it has the curves and trails that no newcomer can know.

# On this host only: whatever a page may say, nothing else is asked.
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
    """A viewer at work.

    Attributes:
        server: the address of its recording.
        stamp_ns: the time of something that is in it; 0 where nothing moves. What was before that
            is history, and has to arrive before a picture is taken.
    """

    server: str
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
        with suppress(*BAD_MESSAGE):  # a strange message is no reason to give up
            stamps.append(int(tf_arrays(data).stamps_ns.max(initial=0)))

    listen = session.node.create_subscription
    topic = session.full_name("rerun_viewer/page")
    listen(String, topic, on_page, LATCHED, raw=True)
    listen(TFMessage, "/tf", on_tf, 100, raw=True)
    if not session.look_for(lambda: pages and pages[-1], "the viewer"):
        raise OneBotError(
            f"no viewer's page on {topic}, and so no curves to draw; start the robot with "
            "viewer:=web, or draw a recording (save:=FILE.rrd). Without --dashboard, none is needed"
        )
    session.spin(lambda: stamps, PATIENCE)
    return RunningViewer(pages[-1], max(stamps, default=0))


def run(argv: Sequence[str]) -> int:
    """Run the command and return its exit code.

    Raises:
        OneBotError: what is to be drawn is not there, or nothing can draw; or the command line is
            wrong.
    """
    args = parse_command_line(argv)
    from onebot_bringup.viewer.pictures import check_picture  # slower to import

    check_picture(args.file)
    with _interruptible(), tempfile.TemporaryDirectory(prefix="onebot-") as folder:
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
        from onebot_bringup.cli.replay import check_rrd, has_content

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
        _RECORDERS[kind](args, scene)
        _render(args, scene)


def _render(args: Namespace, source: Path | str, **more: Any) -> None:
    from onebot_bringup.viewer.pictures import Framing, render

    eye, target = args.camera or (None, None)
    # A viewer at work goes on: only the time panel shows it.
    framing = Framing(args.dashboard, eye, target, time_panel=isinstance(source, Path))
    size = args.width, args.height
    render(source, args.file, *size, framing=framing, progress=_say, **more)


def _draw_viewer(args: Namespace) -> None:
    from onebot_bringup.cli.session import Session

    with Session(args.ros_args) as session:
        viewer = running_viewer(session)
    _render(args, viewer.server, not_before_ns=viewer.stamp_ns)


def _record_running(args: Namespace, scene: Path) -> None:
    from onebot_bringup.cli.session import Session

    with Session(args.ros_args) as session:
        _warn_of(HeardRobot(session, args.frame_prefix).record(args.view, scene))


def _record_bag(args: Namespace, scene: Path) -> None:

    source, namespace = Path(args.source), args.arguments.get(NAMESPACE, "")
    record_bag(source, args.view, scene, _say, _warn, args.frame_prefix, namespace)


def _record_description(args: Namespace, scene: Path) -> None:
    from onebot_description.description import load_description
    from onebot_description.model import RobotModel

    description = load_description(args.source, args.arguments)
    _warn_of(description.warnings)
    positions = pose_of(RobotModel.from_description(description), description, args.joints)
    view = choose_view(args.view, description.robot_name)
    _warn_of(record_pose(description, positions, view.config, view.blueprint, scene))


_RECORDERS: Mapping[str, Callable[[Namespace, Path], None]] = {
    "running": _record_running,
    "description": _record_description,
    "bag": _record_bag,
}


def _say(message: str) -> None:
    print(message, file=sys.stderr, flush=True)


def _warn(message: str) -> None:
    _say(f"warning: {message}")


def _warn_of(messages: Sequence[str]) -> None:
    for message in messages:
        _warn(message)


@contextmanager
def _interruptible() -> Iterator[None]:
    """End by SIGTERM as by Ctrl-C: with the viewer ended and nothing left behind."""
    numbers = (signal.SIGINT, signal.SIGTERM)
    old: Mapping[signal.Signals, object] = {
        number: signal.signal(number, _interrupt) for number in numbers
    }
    try:
        yield
    finally:
        for number, handler in old.items():
            signal.signal(number, handler)  # type: ignore[arg-type]


def _interrupt(_: int, __: FrameType | None) -> NoReturn:
    raise KeyboardInterrupt
