"""description_watcher: edits of a robot's files take effect while it runs.

Run as ``python -m onebot_bringup.launch.description_watcher [--known JSON] FILE [name:=value ...]
--ros-args ...``; FILE is a URDF or xacro file, the rest are xacro's arguments. JSON is the state of
the files when they were read (see ``Known``).

Calls:
    robot_state_publisher/set_parameters (rcl_interfaces/srv/SetParameters): robot_description.

A file that cannot be used is reported and changes nothing: the last good description stays. Known
files are only polled until one is edited. ROS, and the memory it takes, comes then, which is why
this module imports it, and what reads a description, within functions.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from onebot_description.errors import OneBotError
from onebot_description.file_watch import FileState, FileWatch, file_states
from onebot_description.signals import KeyboardInterrupts

if TYPE_CHECKING:
    from rclpy.node import Node

_PUBLISHER = "robot_state_publisher"
_POLL = 0.1  # seconds; an edit counts when two polls in a row agree


class Known(NamedTuple):
    """The state of a robot's files when they were read, and what was published of them."""

    digest: str  # of the URDF (see digest_of)
    files: Mapping[Path, FileState]

    @classmethod
    def of(cls, urdf: str, files: Iterable[Path], before: Mapping[Path, FileState]) -> Known:
        """Return it for ``files``; ``before`` holds the states that some had before the reading."""
        from onebot_description.description.places import digest_of

        now = file_states(files)
        return cls(digest_of(urdf), {file: before.get(file, state) for file, state in now.items()})

    def to_json(self) -> str:
        """Return it as text."""
        files = {str(file): state for file, state in self.files.items()}
        return json.dumps({"digest": self.digest, "files": files})

    @classmethod
    def from_json(cls, text: str) -> Known:
        """Return what ``to_json`` has written."""
        content = json.loads(text)
        files = {Path(name): value and tuple(value) for name, value in content["files"].items()}
        return cls(content["digest"], files)

    def wait_for_edit(self) -> None:
        """Return when a file differs from its known state, and is no longer being written."""
        watch = FileWatch(self.files, known=self.files)
        while not any(watch.poll()):
            time.sleep(_POLL)


class DescriptionUpdates:
    """Passes the edited robot to robot_state_publisher, as long as its node runs."""

    def __init__(
        self, node: Node, model: str, arguments: Mapping[str, str], known: Known | None
    ) -> None:
        """Watch ``model`` and what it includes.

        Args:
            node: calls the service.
            model: a URDF or xacro file.
            arguments: of xacro.
            known: the files when robot_state_publisher was given the robot; None: unknown.
        """
        from rcl_interfaces.srv import SetParameters
        from rclpy.clock import Clock, ClockType

        from onebot_description.description.xacro import included_files

        self._log = node.get_logger()
        self._model, self._arguments = model, arguments
        self._edited: list[Path] = []  # since the robot was loaded
        self._refused = False  # the files as they are
        if known is None:
            self._sent = ""
            self._watch = FileWatch(included_files(model), unread=True)
        else:
            self._sent = known.digest
            self._watch = FileWatch(known.files, known=known.files)
        self._client = node.create_client(SetParameters, f"{_PUBLISHER}/set_parameters")
        # Not ROS time: it may stand still.
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        node.create_timer(_POLL, self._poll, clock=steady)

    def _poll(self) -> None:
        """Load the robot if a file has changed."""
        if not self._client.service_is_ready():
            return  # and find the change once it is
        saved, removed = self._watch.poll()
        if saved or removed:
            self._edited += [*saved, *removed]
            self._load()

    def _load(self) -> None:
        from onebot_description.description import load_description
        from onebot_description.description.places import keep_places
        from onebot_description.description.xacro import included_files

        try:
            description = load_description(self._model, self._arguments)
        except OneBotError as error:
            self._refuse(str(error))
            # The mistake may be in a file that was included only just now.
            self._watch.watch((*self._watch.files, *included_files(self._model)))
            return
        self._watch.watch(description.files)
        keep_places(description)
        names = ", ".join(map(str, dict.fromkeys(self._edited)))
        self._edited.clear()
        self._send(description.urdf, names)

    def _refuse(self, reason: str) -> None:
        self._refused = True
        self._log.error(f"{reason}\nThe robot stays as it was until this is mended.")

    def _send(self, urdf: str, names: str) -> None:
        """Have ``urdf`` published; ``names`` are the files edited."""
        from rcl_interfaces.srv import SetParameters
        from rclpy.parameter import Parameter

        from onebot_description.description.places import digest_of

        digest = digest_of(urdf)
        if digest == self._sent:
            if self._refused:
                self._refused = False
                self._log.info(f"{names}: mended, the robot is unchanged")
            return
        self._sent = digest
        parameter = Parameter("robot_description", value=urdf).to_parameter_msg()
        future = self._client.call_async(SetParameters.Request(parameters=[parameter]))
        future.add_done_callback(lambda answered: self._on_answer(answered, names))

    def _on_answer(self, future: Any, names: str) -> None:
        result = future.result().results[0]
        if result.successful:
            self._refused = False
            # Not more: every other node logs whether the new robot suits it.
            self._log.info(f"{names}: edited, {_PUBLISHER} publishes the new robot")
        else:
            self._sent = ""
            self._refuse(f"{names}: {_PUBLISHER} refused the edited robot: {result.reason}")


def main(args: Sequence[str] | None = None) -> int:
    """Run the node until a signal asks it to stop."""
    arguments = list(sys.argv if args is None else args)
    known = None
    if arguments[1:2] == ["--known"]:
        known = Known.from_json(arguments[2])
        del arguments[1:3]
    try:
        with KeyboardInterrupts():
            if known is not None:
                known.wait_for_edit()
            return _run(arguments, known)
    except KeyboardInterrupt:
        return 0


def _run(arguments: list[str], known: Known | None) -> int:
    """Load the robot whenever a file of it is edited; ``known`` is what is published of it."""
    from onebot_bringup.launch.arguments import split
    from onebot_description.node import ros_arguments, run_node

    try:
        parts = split(ros_arguments(arguments).others)
        if len(parts.positional) != 1:
            raise OneBotError("write the one file to watch, a URDF or xacro file")
    except OneBotError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1

    def make_node() -> Node:
        from rclpy.node import Node

        node = Node("description_watcher")
        DescriptionUpdates(node, parts.positional[0], parts.given, known)
        return node

    # To rcl, name:=value outside of --ros-args is a remapping in its old form: keep it from that.
    start = arguments.index("--ros-args") if "--ros-args" in arguments else len(arguments)
    return run_node(make_node, [*arguments[:1], *arguments[start:]])


if __name__ == "__main__":
    sys.exit(main())
