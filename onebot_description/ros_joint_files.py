"""The files that joint_state_publisher takes up as soon as they are saved."""

from collections.abc import Callable
from pathlib import Path

from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from onebot_description.description import Description, load_description
from onebot_description.errors import DescriptionError, OneBotError
from onebot_description.joints.state import JointsState
from onebot_description.joints.watch import FileWatch
from onebot_description.ros_description import is_path
from onebot_description.ros_joint_parameters import JointParameters
from onebot_description.text import listing

_LOOK_EVERY = 0.05  # seconds between looks at the files


class JointFiles:
    """Parameter files and the description's files, watched."""

    def __init__(
        self,
        node: Node,
        description_file: str | None,
        parameters: JointParameters,
        state: Callable[[], JointsState],
        offer: Callable[[Description], None],
    ) -> None:
        """Nothing is watched before ``watch``.

        Args:
            node: whose files they are.
            description_file: URDF or xacro file, None if a parameter or a topic gives it.
            parameters: the node's.
            state: returns the state in force.
            offer: takes a changed description.
        """
        self._node, self._description_file = node, description_file
        self._parameters, self._state, self._offer = parameters, state, offer
        self._broken: set[str] = set()
        self._unread = False
        self._watch = FileWatch(())

    def watch(self) -> None:
        """Watch the files as they are now."""
        self._watch.watch(self._watched())
        # Not ROS time: it may stand still.
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._node.create_timer(_LOOK_EVERY, self._look, clock=steady)

    def read_soon(self) -> None:
        """Read the parameter files at the next look, saved or not."""
        self._unread = True

    def read_broken(self) -> None:
        """Try the parameter files again, if they could not be taken up so far."""
        if self._parameters.live.names in self._broken:
            self._reload_parameters()

    def keep(self, what: str, error: OneBotError) -> None:
        """Say why something new was not taken up."""
        self._broken.add(what)
        self._node.get_logger().error(f"{what} not applied, the robot goes on as before:\n{error}")

    def _watched(self) -> list[Path]:
        state = self._state()
        from_file = self._description_file or is_path(state.values.get("robot_description", ""))
        described = state.description.files if state.description and from_file else ()
        return [*self._parameters.live.files, *described]

    def _look(self) -> None:
        """Take up what was saved since the last look."""
        self._watch.watch(self._watched())
        saved, files = self._watch.saved(), self._parameters.live.files
        if self._unread or any(file in saved for file in files):
            self._unread = False
            self._reload_parameters()
        if any(file not in self._parameters.live.files for file in saved):
            self._reload_description()

    def _reload_parameters(self) -> None:
        """Set every parameter as the files say; what they do not name goes back to its default."""
        live, log = self._parameters.live, self._node.get_logger()
        names, before = live.names, live.file
        try:
            file = live.read()
            overruled = live.overruled(file)
            changes = live.changes(file, self._state().values)
            live.file = file
            self._parameters.set_all(changes, file.places)
        except OneBotError as error:
            live.file = before
            self.keep(names, error)
            return
        mended = "mended, " if names in self._broken else ""
        self._broken.discard(names)
        said = f"applied, changed: {listing(changes)}" if changes else "applied, nothing changed"
        log.info(f"{names}: {mended}{said}")
        for name in overruled:
            log.warning(f"{name} is set on the command line, which comes first")
        if live.remark:
            log.warning(live.remark)

    def _reload_description(self) -> None:
        path = self._description_file or self._state().values["robot_description"]
        try:
            description = load_description(path)
        except DescriptionError as error:
            self.keep(str(path), error)
        else:
            self._offer(description)
