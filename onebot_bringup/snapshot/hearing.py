"""The running robot as it stands now: heard on its topics until every link has its place."""

import sys
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from onebot_bringup.cli.ros_session import PATIENCE, Session
from onebot_bringup.raw_messages import (
    BAD_MESSAGE,
    deserialize_message,
    joint_state_arrays,
    tf_arrays,
)
from onebot_bringup.snapshot.view_choice import choose_view
from onebot_bringup.viewer.frames import FrameTree
from onebot_bringup.viewer.geometry import Robot, read_robot
from onebot_bringup.viewer.live_view import LiveView
from onebot_bringup.viewer.recording import open_recording
from onebot_description.errors import OneBotError
from onebot_description.qos import LATCHED, SENSOR, STATIC_TF
from onebot_description.text import did_you_mean, listing
from onebot_description.tf.tf_message import TFMessage
from onebot_description.tf.wire import TfArrays

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
            state = joint_state_arrays(data)
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
        view = choose_view(asked_view, robot.name)
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

    def _description(self) -> Robot:
        topic = self._session.full_name("robot_description")
        if not self._session.look_for(lambda: self._urdf, f"a robot on {topic}"):
            raise OneBotError(
                f"no robot is running: nothing on {topic}{self._elsewhere()}; start one "
                "(onebot_bringup), or name its URDF or xacro file"
            )
        return read_robot(self._urdf)

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

    def _await_frames(self, robot: Robot, fixed_frame: str) -> None:
        def placed() -> bool:
            return not self._missing(robot) and (not fixed_frame or self._known(fixed_frame))

        if not self._session.spin(placed, PATIENCE):
            missing = self._missing(robot) or [fixed_frame]
            print(f"waiting for the frames of {listing(missing, _LISTED)} ...", file=sys.stderr)
            self._session.spin(placed, _FRAMES - PATIENCE)
        missing = self._missing(robot)
        if missing:
            raise OneBotError(self._hint(robot, missing))

    def _missing(self, robot: Robot) -> list[str]:
        """Frames of links that nothing connects with the frame of the root link."""
        top = self._frames.top(self._prefix + robot.root)
        frames = [self._prefix + link for link in robot.links]
        return [frame for frame in frames if self._frames.top(frame) != top]

    def _hint(self, robot: Robot, missing: list[str]) -> str:
        text = f"no transform of {listing(missing, _LISTED)} within {_FRAMES:.0f} s"
        if not self._frames.edges:
            return (
                f"{text}: nothing on /tf and /tf_static; robot_state_publisher publishes them, "
                "or the simulation is paused"
            )
        prefixes = {
            name[: -len(robot.root)]
            for name in self._frames.names
            if name.endswith(robot.root) and name != self._prefix + robot.root
        }
        if prefixes and len(missing) >= len(robot.links) - 1:
            return f"{text}; try --frame-prefix {listing(prefixes)}"
        if not self._joints:
            joints = self._session.full_name("joint_states")
            return f"{text}: nothing on {joints}, so nobody knows where the joints stand"
        return f"{text} (frames heard: {listing(self._frames.names)})"

    def _known(self, frame: str) -> bool:
        return bool({frame, self._prefix + frame} & self._frames.names)
