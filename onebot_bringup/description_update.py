"""description_watcher: edits of a robot's files take effect while it runs.

Run as ``python -m onebot_bringup.description_watcher [--digest SHA256] FILE [name:=value ...]
--ros-args ...``; FILE is a URDF or xacro file, the rest are xacro's arguments.

Calls:
    robot_state_publisher/set_parameters (rcl_interfaces/srv/SetParameters): robot_description.

A file that cannot be used is reported and changes nothing: the last good description stays.
"""

import sys
from pathlib import Path
from typing import Any

from rcl_interfaces.srv import SetParameters
from rclpy.node import Node
from rclpy.parameter import Parameter

from onebot_bringup.description_files import Signature, digest_of, signature_of
from onebot_bringup.launcher.arguments import split
from onebot_bringup.xacro_arguments import included_files
from onebot_description.description import load_description, published_urdf
from onebot_description.errors import OneBotError
from onebot_description.ros import run_node
from onebot_description.ros_arguments import ros_arguments

_LOOK_EVERY = 0.1  # seconds; an edit is loaded when two looks in a row agree
_PUBLISHER = "robot_state_publisher"


class DescriptionWatcher(Node):
    """See the module's docstring."""

    def __init__(self, model: str, arguments: dict[str, str], digest: str) -> None:
        """Watch ``model`` and what it includes.

        Args:
            model: a URDF or xacro file.
            arguments: of xacro.
            digest: of the URDF that robot_state_publisher has (see ``digest_of``); empty: unknown.
        """
        super().__init__("description_watcher")
        self._model = model
        self._arguments = arguments
        self._sent = digest
        self._files: tuple[Path, ...] = included_files(model)
        self._last_look: Signature | None = None
        self._loaded: Signature | None = None
        self._client = self.create_client(SetParameters, f"{_PUBLISHER}/set_parameters")
        self.create_timer(_LOOK_EVERY, self._look)

    def _look(self) -> None:
        """Load if a file has changed, and once at the start: it may have changed by then."""
        if not self._client.service_is_ready():
            return  # and find the change once it is
        signature = signature_of(self._files)
        if signature != self._last_look:  # an editor may still be writing
            self._last_look = signature
        elif signature != self._loaded:
            self._loaded = signature
            self._load()

    def _load(self) -> None:
        try:
            description = load_description(self._model, self._arguments)
        except OneBotError as error:
            self.get_logger().error(f"{error}\nThe robot stays as it was until this is mended.")
            # Where the mistake is may be a file that was included only just now.
            self._watch((*self._files, *included_files(self._model)))
            return
        self._watch(description.files)
        self._send(published_urdf(description))

    def _watch(self, files: tuple[Path, ...]) -> None:
        files = tuple(dict.fromkeys(files))
        if files != self._files:
            self._files = files
            self._loaded = self._last_look = signature_of(files)

    def _send(self, urdf: str) -> None:
        digest = digest_of(urdf)
        if digest == self._sent:
            return
        self._sent = digest
        parameter = Parameter("robot_description", value=urdf).to_parameter_msg()
        future = self._client.call_async(SetParameters.Request(parameters=[parameter]))
        future.add_done_callback(self._on_answer)

    def _on_answer(self, future: Any) -> None:
        result = future.result().results[0]
        if result.successful:
            self.get_logger().info(f"{self._model} was edited: the robot is up to date")
        else:
            self._sent = ""
            self.get_logger().error(f"{_PUBLISHER} refused the edited robot: {result.reason}")


def main(args: list[str] | None = None) -> int:
    """Run the node until it is told to stop."""
    arguments = list(sys.argv if args is None else args)
    words = list(ros_arguments(arguments).others)
    # To rcl, name:=value outside of --ros-args is a remapping in its old form: keep it from that.
    for_ros = arguments[arguments.index("--ros-args") :] if "--ros-args" in arguments else []
    digest = ""
    if words[:1] == ["--digest"]:
        digest, words = words[1], words[2:]
    try:
        parts = split(words)
        if len(parts.positional) != 1:
            raise OneBotError("write the one file to watch, a URDF or xacro file")
    except OneBotError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    model = parts.positional[0]
    return run_node(
        lambda: DescriptionWatcher(model, dict(parts.given), digest), [*arguments[:1], *for_ros]
    )


if __name__ == "__main__":
    sys.exit(main())
