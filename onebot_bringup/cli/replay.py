"""``onebot replay``: shows a whole recording until Ctrl-C."""

import time
from collections.abc import Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from onebot_bringup.cli.options import warn
from onebot_bringup.launch.arguments import (
    Settings,
    argument,
    parameter_of,
    split,
    table,
)
from onebot_bringup.viewer.viewer_parameters import ViewerParameters
from onebot_description.elements.packages import use_environment_prefix
from onebot_description.errors import OneBotError, UsageError
from onebot_description.parameters.reader import read
from onebot_description.ros.signals import KeyboardInterrupts

if TYPE_CHECKING:
    from onebot_bringup.bags.shown_bag import ShownBag
    from onebot_bringup.viewer.display_server import DisplayServer


HELP = """\
usage: onebot replay RECORDING [name:=value ...]

Shows a recording from its beginning, until Ctrl-C: a folder of rosbag2 (record:=DIR makes one), its
.mcap or .db3 file, or a .rrd file of the viewer (save:=FILE.rrd). It may be of any robot, or of
none: every topic that has a display is shown, and message types need not be installed. The panel
below the robot plays, stops and goes to any time.
"""

_VIEWER = "rerun_viewer"
_viewer = partial(parameter_of, (_VIEWER,), ViewerParameters)


@dataclass(frozen=True)
class ReplaySettings(Settings):
    """The arguments of the command."""

    viewer: str = _viewer("viewer")
    save: str = _viewer("save", note="with viewer:=none, it is only saved")
    view: str = _viewer("view")
    fixed_frame: str = argument("", "the frame that stands still; empty: the view's, else a root")
    namespace: str = argument("", "the only robot to show, if several are recorded; empty: all")
    max_size: float = argument(
        256, "MB of an uncompressed message or chunk; larger ones are not read", at_least=0.0
    )
    grpc_port: int = _viewer("grpc_port")
    web_port: int = _viewer("web_port")
    open_browser: bool = _viewer("open_browser")


_RRD = ".rrd"
_RRD_STARTS = (b"RRF", b"RRIO")  # any version of Rerun writes one of them
_ALL = "100%"  # memory limit, so that a page that is opened later gets everything
_WATCH_EVERY = 0.1  # s


def run(argv: Sequence[str]) -> int:
    """Run the command and return its exit code."""
    arguments = split(argv)
    if arguments.help or arguments.show:
        print(f"{HELP}\n" * arguments.help + table(ReplaySettings.arguments()))
        return 0
    if len(arguments.positional) != 1:
        raise UsageError(f"onebot replay takes one recording, not {len(arguments.positional)}")
    settings = ReplaySettings.read(arguments.given)
    if settings.viewer == "none" and not settings.save:
        raise UsageError("viewer:=none needs save:=FILE.rrd, or nothing would be shown")
    source = Path(arguments.positional[0]).expanduser()
    use_environment_prefix()  # it is needed to find meshes and views
    with KeyboardInterrupts() as interrupts:
        _replay(source, settings, interrupts)
    return 0


def _replay(source: Path, settings: ReplaySettings, interrupts: KeyboardInterrupts) -> None:
    is_rrd = source.suffix == _RRD and not source.is_dir()  # record:=run.rrd makes a folder, too
    if is_rrd:
        _check_rrd(source, settings)
    else:
        bag = _shown_bag(source, settings, interrupts)
    with _server(settings) as server:
        if is_rrd:
            server.stream.log_file_from_path(source)
            _Log().info(f"showing {source}")
        else:
            replayed = bag.log(server.stream)
            server.replace_file()
            robot = f' of "{replayed.robot}"' if replayed.robot else ""
            _Log().info(f"showing {replayed.seconds:.1f} s{robot}: {replayed.messages} messages")
        with suppress(KeyboardInterrupt):  # the normal end of a view
            while settings.viewer != "none":
                interrupts.check()
                server.watch()
                time.sleep(_WATCH_EVERY)


def _shown_bag(
    source: Path, settings: ReplaySettings, interrupts: KeyboardInterrupts
) -> "ShownBag":
    from onebot_bringup.bags.bag_reader import Bag  # slower to import

    bag = Bag(source, int(settings.max_size * 1e6))
    from onebot_bringup.bags.shown_bag import ShownBag  # the slowest

    def progress(text: str) -> None:
        interrupts.check()
        _Log().info(text)

    return ShownBag(
        bag,
        view=settings.view,
        fixed_frame=settings.fixed_frame,
        namespace=settings.namespace,
        progress=progress,
        warn=_Log().warning,
    )


def _check_rrd(source: Path, settings: ReplaySettings) -> None:
    from onebot_bringup.bags.contents import open_file  # slower to import

    with open_file(source) as file:
        if not file.read(4).startswith(_RRD_STARTS):
            raise OneBotError(f"{source} is not a Rerun recording")
    for name in ("view", "save", "fixed_frame", "namespace"):
        if value := getattr(settings, name):
            raise UsageError(f"{name}:={value}: a .rrd file is shown as it is")


class _Log:
    """A logger that prints; warnings go to stderr."""

    def info(self, message: str) -> None:
        print(message, flush=True)

    def warning(self, message: str) -> None:
        warn(message)


def _server(settings: ReplaySettings) -> "closing[DisplayServer]":
    from onebot_bringup.viewer.display_server import DisplayServer  # slower to import

    parameters = read(ViewerParameters, settings.parameters(_VIEWER))
    return closing(DisplayServer(replace(parameters, memory_limit=_ALL), _Log()))
