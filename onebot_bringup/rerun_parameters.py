"""The parameters of the viewer's node that hold from its start to its end."""

import re
from pathlib import Path

from rcl_interfaces.msg import ParameterDescriptor
from rclpy.node import Node

from onebot_bringup.viewer.display import Display
from onebot_description.errors import OneBotError
from onebot_description.text import did_you_mean

VIEWERS = ("web", "native", "none")

_PARAMETERS: dict[str, tuple[str | int | bool, str]] = {
    "viewer": ("web", "web, native or none"),
    "save": ("", "a .rrd file to write the recording to"),
    "view": ("", 'a saved view, .yaml or .rbl; "" for the robot\'s own, "none" for none'),
    "frame_prefix": ("", "put before link names, as robot_state_publisher does"),
    "grpc_port": (9876, "port on 127.0.0.1 for viewers; 0 for any"),
    "web_port": (9090, "port on 127.0.0.1 for the page; 0 for any"),
    "open_browser": (True, "open the page, if there is a display"),
    "memory_limit": ("256MB", "what is kept for viewers that join later"),
}


class ViewerParameters:
    """Reads and checks them."""

    def __init__(self, node: Node) -> None:
        """Declare them on ``node``."""
        self._node = node
        for name, (default, meaning) in _PARAMETERS.items():
            descriptor = ParameterDescriptor(description=meaning, read_only=True)
            node.declare_parameter(name, default, descriptor)

    def text(self, name: str) -> str:
        """Return a parameter's text."""
        return str(self._node.get_parameter(name).value)

    @property
    def viewer(self) -> str:
        """One of ``VIEWERS``; another is an OneBotError."""
        value = self.text("viewer")
        if value not in VIEWERS:
            known = did_you_mean(value, VIEWERS, "choices")
            raise OneBotError(f"viewer:={value}: there is no such viewer{known}")
        return value

    @property
    def save(self) -> Path | None:
        """The file to write, if any."""
        text = self.text("save")
        return Path(text).expanduser().absolute() if text else None

    @property
    def memory_limit(self) -> str:
        """As Rerun reads it; what it would not is an OneBotError."""
        text = self.text("memory_limit")
        if not re.fullmatch(r"\d+(\.\d+)?\s*(%|[kMGT]i?B|B)", text):
            raise OneBotError(f"memory_limit:={text}: write a size such as 256MB, 1GiB or 10%")
        return text

    def open_display(self) -> Display:
        """Open the recording and the viewer.

        Raises:
            OneBotError: a parameter is wrong, or it cannot be opened.
        """
        return Display(
            self.viewer,
            self.save,
            grpc_port=self._number("grpc_port"),
            web_port=self._number("web_port"),
            memory_limit=self.memory_limit,
            open_browser=bool(self._node.get_parameter("open_browser").value),
            log=self._node.get_logger(),
        )

    def _number(self, name: str) -> int:
        return int(self._node.get_parameter(name).value)
