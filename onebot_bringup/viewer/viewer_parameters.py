"""The parameters of rerun_viewer, some of which are also launch arguments."""

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from onebot_control.conventions import namespace_prefix
from onebot_description.errors import OneBotError, did_you_mean
from onebot_description.parameters.reader import parameter
from onebot_description.parameters.values import MAX_PORT

if TYPE_CHECKING:
    from onebot_bringup.viewer.core.shown_robot import RobotToShow

VIEWERS = ("web", "native", "none")
_NO_VIEW = "none"
_VIEW_FILES = (".yaml", ".yml", ".rviz")


def view_file(view: str) -> Path | None:
    """Return the file that the parameter ``view`` names; None if it is empty or "none".

    Raises:
        OneBotError: there is no such file.
    """
    if view in ("", _NO_VIEW):
        return None
    path = Path(view).expanduser().absolute()
    if not path.is_file():
        files = [file.name for file in path.parent.glob("*.*") if file.suffix in _VIEW_FILES]
        raise OneBotError(f"view:={view}: no such file{did_you_mean(path.name, files, 'there')}")
    return path


def _port(default: int, description: str) -> Any:
    return parameter(default, description, at_least=0, at_most=MAX_PORT, read_only=True)


@dataclass(frozen=True)
class ViewerParameters:
    """The node's own parameters."""

    viewer: str = parameter("web", "where the robot is shown", choices=VIEWERS, read_only=True)
    save: str = parameter("", "a .rrd file to write the recording to", read_only=True)
    view: str = parameter(
        "",
        "a .yaml or .rviz file, reloaded when edited; empty: config/view.yaml of "
        "<robot name>_description; none: the default view",
        read_only=True,
    )
    robots: tuple[str, ...] = parameter(
        (),
        "namespaces of the robots to show, the first five with curves; empty: the node's own",
        pattern=re.compile(r"/?[A-Za-z_]\w*(/[A-Za-z_]\w*)*", re.ASCII),
        write="a list of namespaces, such as [robot1, robot2]",
        unique=True,
        read_only=True,
    )
    frame_prefix: str = parameter(
        "", "as for robot_state_publisher; with robots: each namespace", read_only=True
    )
    grpc_port: int = _port(9876, "port on 127.0.0.1 for viewers; 0: any")
    web_port: int = _port(9090, "port on 127.0.0.1 for the page; 0: any")
    open_browser: bool = parameter(True, "open the page, if there is a display", read_only=True)
    embedded: bool = parameter(
        False,
        "part of another page: its address is neither logged nor opened",
        read_only=True,
    )
    memory_limit: str = parameter(
        "256MB",
        "limit of the data kept for viewers that join later",
        pattern=re.compile(r"\d+(\.\d+)?\s*(%|[kMGT]i?B|B)"),
        write="a size such as 256MB, 1GiB or 10%",
        read_only=True,
    )
    save_view_to: str = parameter("", "the file that ~/save_view writes; empty: the view's own")

    def robots_to_show(self, resolve: Callable[[str], str]) -> "list[RobotToShow]":
        """Return the robots to show; ``resolve`` returns the full name of a topic."""
        from onebot_bringup.viewer.core.shown_robot import (  # slow to import
            MAX_PLOTTED,
            RobotToShow,
        )

        robots = [
            RobotToShow(space, namespace_prefix(space), plotted=number < MAX_PLOTTED)
            for number, space in enumerate(map(resolve, self.robots))
        ]
        return robots or [RobotToShow(frame_prefix=self.frame_prefix)]

    @property
    def recording(self) -> Path | None:
        """The file to record to; None if there is none."""
        return Path(self.save).expanduser().absolute() if self.save else None
