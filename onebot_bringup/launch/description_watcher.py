"""description_watcher: edits of a robot's files take effect while it runs.

Run as ``python -m onebot_bringup.launch.description_watcher [--known JSON] FILE [name:=value ...]
--ros-args ...``; FILE is a URDF or xacro file, the rest are xacro's arguments. JSON says as what
the files are known already (see ``description_files.Known``).

Calls:
    robot_state_publisher/set_parameters (rcl_interfaces/srv/SetParameters): robot_description.

A file that cannot be used is reported and changes nothing: the last good description stays. Files
that are known are only looked at until one is edited: ROS, and the memory it takes, comes then.
"""

import json
import signal
import sys
import time
import zlib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from rcl_interfaces.srv import SetParameters
from rclpy.node import Node
from rclpy.parameter import Parameter

from onebot_description.description import load_description
from onebot_description.description.xacro import included_files
from onebot_description.errors import OneBotError
from onebot_description.file_watch import FileState, FileWatch, file_states

# What a bringup publishes of a robot's files, and how it notices that they have changed.

LOOK_EVERY = 0.1  # seconds; an edit counts when two looks in a row agree


class Known(NamedTuple):
    """What is known of a robot's files when they have been read.

    Attributes:
        digest: of the URDF that came out.
        files: each file, as it was then.
    """

    digest: str
    files: Mapping[Path, FileState]

    @classmethod
    def of(cls, urdf: str, files: Iterable[Path], before: Mapping[Path, FileState]) -> "Known":
        """Return it for ``files``; those looked at ``before`` they were read, as they were then."""
        now = file_states(files)
        return cls(digest_of(urdf), {file: before.get(file, state) for file, state in now.items()})

    def to_json(self) -> str:
        """Return it as text."""
        files = {str(file): signature for file, signature in self.files.items()}
        return json.dumps({"digest": self.digest, "files": files})

    @classmethod
    def from_json(cls, text: str) -> "Known":
        """Return what ``to_json`` has written."""
        content = json.loads(text)
        files = {Path(name): value and tuple(value) for name, value in content["files"].items()}
        return cls(content["digest"], files)

    def wait_for_edit(self) -> None:
        """Return when a file is another one than is known, and is no longer being written."""
        watch = FileWatch(self.files, known=self.files)
        while not watch.changed():
            time.sleep(LOOK_EVERY)


def digest_of(urdf: str) -> str:
    """Return a short name for a URDF text, which an edited one does not have."""
    return f"{len(urdf):x}-{zlib.crc32(urdf.encode()):08x}"


# The node of description_watcher: it hands the edited robot on to robot_state_publisher.

_PUBLISHER = "robot_state_publisher"


class DescriptionUpdate(Node):
    """See the docstring of ``onebot_bringup.launch.description_watcher``."""

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
        # Read once at the start, too: it may have changed by then.
        self._watch = FileWatch(included_files(model), unread=True)
        self._client = self.create_client(SetParameters, f"{_PUBLISHER}/set_parameters")
        self.create_timer(LOOK_EVERY, self._look)

    def _look(self) -> None:
        """Load the robot if a file has changed."""
        if not self._client.service_is_ready():
            return  # and find the change once it is
        if self._watch.changed():
            self._load()

    def _load(self) -> None:
        try:
            description = load_description(self._model, self._arguments)
        except OneBotError as error:
            self.get_logger().error(f"{error}\nThe robot stays as it was until this is mended.")
            # Where the mistake is may be a file that was included only just now.
            self._watch.watch((*self._watch.files, *included_files(self._model)))
            return
        self._watch.watch(description.files)
        self._send(description.urdf)

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


def main(args: Sequence[str] | None = None) -> int:
    """Run the node until it is told to stop."""
    arguments = list(sys.argv if args is None else args)
    known = None
    if arguments[1:2] == ["--known"]:
        known = Known.from_json(arguments[2])
        del arguments[1:3]
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.default_int_handler)
    try:
        if known is not None:
            known.wait_for_edit()
        return _run(arguments, known.digest if known is not None else "")
    except KeyboardInterrupt:
        return 0


def _run(arguments: list[str], digest: str) -> int:
    """Load the file whenever it is edited; ``digest`` is that of the URDF in force."""
    from onebot_bringup.launch.arguments import split
    from onebot_description.errors import OneBotError
    from onebot_description.node import ros_arguments

    try:
        parts = split(ros_arguments(arguments).others)
        if len(parts.positional) != 1:
            raise OneBotError("write the one file to watch, a URDF or xacro file")
    except OneBotError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    from onebot_description.node import run_node

    # To rcl, name:=value outside of --ros-args is a remapping in its old form: keep it from that.
    start = arguments.index("--ros-args") if "--ros-args" in arguments else len(arguments)
    model, of_xacro = parts.positional[0], dict(parts.given)
    return run_node(
        lambda: DescriptionUpdate(model, of_xacro, digest), [*arguments[:1], *arguments[start:]]
    )


if __name__ == "__main__":
    sys.exit(main())
