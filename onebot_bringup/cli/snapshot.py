"""``onebot snapshot``: a picture of a robot, drawn without any display."""

import signal
import sys
import tempfile
from argparse import Namespace
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any, NoReturn

from onebot_bringup.snapshot.command_line import NAMESPACE, kind_of, parse_command_line
from onebot_description.errors import OneBotError


def run(argv: Sequence[str]) -> int:
    """Run the command and return its exit code.

    Raises:
        OneBotError: what is to be drawn is not there, or nothing can draw; or the command line is
            wrong.
    """
    args = parse_command_line(argv)
    from onebot_bringup.viewer.picture import check_picture  # slower to import

    check_picture(args.file)
    with _interruptible(), tempfile.TemporaryDirectory(prefix="onebot-") as folder:
        _draw(args, Path(folder) / "scene.rrd")
    print(f"wrote {args.file} ({args.width} x {args.height})")
    return 0


def _draw(args: Namespace, scene: Path) -> None:
    """Draw what ``args`` ask for; ``scene`` is where a recording can be put."""
    from onebot_bringup.viewer.picture import UnreadableError

    kind = kind_of(args.source)
    if kind == "running" and args.dashboard:
        _draw_viewer(args)
    elif kind == "rrd":
        from onebot_bringup.rrd_file import check_rrd, has_content
        from onebot_bringup.snapshot.recordings import salvage

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
    from onebot_bringup.viewer.picture import Framing, render

    eye, target = args.camera or (None, None)
    # A viewer at work goes on: only the time panel shows it.
    framing = Framing(args.dashboard, eye, target, time_panel=isinstance(source, Path))
    size = args.width, args.height
    render(source, args.file, *size, framing=framing, progress=_say, **more)


def _draw_viewer(args: Namespace) -> None:
    from onebot_bringup.cli.ros_session import Session
    from onebot_bringup.snapshot.viewing import running_viewer

    with Session(args.ros_args) as session:
        viewer = running_viewer(session)
    _render(args, viewer.server, not_before_ns=viewer.stamp_ns)


def _record_running(args: Namespace, scene: Path) -> None:
    from onebot_bringup.cli.ros_session import Session

    with Session(args.ros_args) as session:
        from onebot_bringup.snapshot.hearing import HeardRobot

        _warn_of(HeardRobot(session, args.frame_prefix).record(args.view, scene))


def _record_bag(args: Namespace, scene: Path) -> None:
    from onebot_bringup.snapshot.recordings import record_bag

    source, namespace = Path(args.source), args.arguments.get(NAMESPACE, "")
    record_bag(source, args.view, scene, _say, _warn, args.frame_prefix, namespace)


def _record_description(args: Namespace, scene: Path) -> None:
    from onebot_bringup.snapshot.posing import pose_of, record_pose
    from onebot_bringup.snapshot.view_choice import choose_view
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
