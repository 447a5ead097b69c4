"""The stage, which all displays share: the robots, the TF tree, the fixed frame and the time."""

import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import rerun as rr

from onebot_bringup.introspection.transforms import FrameTree
from onebot_bringup.viewer.columns import ReadyColumn, joinable, joined, one_row, time_column
from onebot_bringup.viewer.displays.tf_display import TransformStream
from onebot_bringup.viewer.inbox import MessageType, message_type
from onebot_bringup.viewer.shown_robot import WORLD_DESCRIPTION, RobotToShow, ShownRobot
from onebot_bringup.viewer.view_config import ViewConfig
from onebot_description.description import Description
from onebot_description.errors import did_you_mean, listing
from onebot_description.ros.wire.interface_text import full_definition

if TYPE_CHECKING:
    from onebot_bringup.viewer.displays.drawing import MessageDisplay

_TRANSFORM_TIMEOUT_NS = 200_000_000
_LISTED = 5  # robots named in a message


class Stage:
    """What all displays draw on: a recording, the robots in it and their frames."""

    def __init__(
        self,
        recording: rr.RecordingStream,
        view: ViewConfig,
        robots: Sequence[RobotToShow] = (RobotToShow(),),
        *,
        resolve: Callable[[str], str] = str,
        clock: Callable[[], float] = time.monotonic,
        definitions: Callable[[str], str] = full_definition,
    ) -> None:
        """Prepare for robots whose descriptions follow; see ``RobotView`` for the arguments."""
        self.recording = recording
        self.view = view
        self.resolve = resolve
        self.clock = clock
        self._definitions = definitions
        self.frames = FrameTree()
        self.transforms = TransformStream(recording, self.frames)
        self.alone = len(robots) == 1
        self.robots = [
            ShownRobot(self, names, "" if self.alone else names.entity) for names in robots
        ]
        # The things that stand around the robots.
        self.world = ShownRobot(self, RobotToShow(description=WORLD_DESCRIPTION), "world")
        self.message_displays: Sequence[MessageDisplay] = ()
        self.now_ns = 0  # the time on the timeline, nanoseconds
        self.transform_timeout_ns = _TRANSFORM_TIMEOUT_NS  # how long messages wait for transforms
        self.robot_size = 0.0  # the diagonal of the smallest robot, metres; 0: not known yet

    def message_type(self, name: str, *, live: bool = True) -> MessageType[Any]:
        """Return a message type whose messages are decoded by its definition.

        Raises:
            OneBotError: there is no definition of it.
            ValueError: the definition cannot be read.
        """
        return message_type(name, self._definitions(name), live)

    # --- what is logged ---------------------------------------------------------------------------

    def log_rows(
        self, entity: str, rows: Sequence[tuple[int, Sequence[rr.AsComponents | ReadyColumn]]]
    ) -> None:
        """Log messages, each at its time, in as few calls as possible."""
        ready = [
            (stamp_ns, [column for archetype in archetypes for column in one_row(archetype)])
            for stamp_ns, archetypes in rows
        ]
        for same in joinable(ready):
            stamps = np.array([stamp_ns for stamp_ns, _ in same])
            columns = joined([columns for _, columns in same])
            self.recording.send_columns(entity, indexes=[time_column(stamps)], columns=columns)

    def clear(self, entity: str, stamp_ns: int, frame: str) -> None:
        """Remove what is drawn at an entity; the view would report one without a frame."""
        self.log_rows(entity, [(stamp_ns, [rr.Clear(recursive=False)])])
        if frame:
            self.log_rows(entity, [(stamp_ns, [rr.CoordinateFrame(frame)])])

    # --- robots -----------------------------------------------------------------------------------

    @property
    def descriptions(self) -> dict[str, Description]:
        """The descriptions of the robots shown now, by their namespaces."""
        robots = ((str(robot.names), robot.description) for robot in self.robots)
        return {name: description for name, description in robots if description is not None}

    def robot_of(self, topic: str) -> ShownRobot:
        """Return the robot whose namespace a topic is in, by its full name, or else the first."""
        namespaces = {robot.full_name("x")[:-1]: robot for robot in self.robots}
        inside = filter(topic.startswith, namespaces)
        return namespaces[max(inside, key=len, default=next(iter(namespaces)))]

    def wrong_names(self) -> list[str]:
        """Return a sentence if no robot has the link that the camera should follow."""
        follow = self.view.camera.follow
        links = {link for robot in self.descriptions.values() for link in robot.link_names}
        names = set(links)
        for robot in () if self.alone else self.robots:  # several robots' links go by frame
            names.update(map(robot.frame_of, links))
        if not links or not follow or follow in names:
            return []
        hint = did_you_mean(follow, links, "links")
        return [f'camera.follow: the robot has no link "{follow}"{hint}']

    def late(self) -> list[str]:
        """Return a sentence per kind of frames and descriptions that are missing."""
        frame = self.wanted_frame
        if not self.descriptions:
            fixed, frame = self.fixed_frame, self.view.fixed_frame
            return [] if frame in ("", fixed) else [self.unknown_frame(frame, fixed)]
        sentences = []
        for robot in (*self.robots, self.world):
            sentences += robot.late(frame)
        lacking = [str(robot.names) for robot in self.robots if robot.description is None]
        if lacking:
            sentences.append(f"no description yet of the robots in {listing(lacking, _LISTED)}")
        return sentences

    # --- frames -----------------------------------------------------------------------------------

    def unknown_frame(self, wanted: str, fixed_frame: str) -> str:
        """Return a warning that ``wanted`` is unknown, and which frame is used instead."""
        hint = did_you_mean(wanted, self.frames.names, "frames received")
        return (
            f'the fixed frame "{wanted}" is not on /tf or /tf_static{hint}; '
            f'shown in "{fixed_frame}" until it is'
        )

    def connected(self, frame: str) -> bool:
        """Whether transforms lead from ``frame`` to the fixed frame.

        Entities in any other frame have to wait: the view would report an error.
        """
        return self.frames.top(frame) == self.frames.top(self.fixed_frame)

    @property
    def fixed_frame(self) -> str:
        """The frame in which everything is shown; "" while there is none.

        It is the view's, with or without the frame_prefix. If that is unknown, or each of several
        robots has such a frame, it is the topmost frame above the first robot's root link, or
        without a robot the topmost frame of most messages.
        """
        for robot in self.robots:
            if robot.description is not None:
                return robot.fixed_frame(self.wanted_frame)
        view_frame = self.view.fixed_frame
        if view_frame and (view_frame in self.frames.names or view_frame in self._message_frames):
            return view_frame
        return self.frame_without_robot or view_frame

    @property
    def frame_without_robot(self) -> str:
        """The topmost frame of most messages shown, or else of any transform; "" for none.

        Without transforms, it is the frame of most messages.
        """
        names, tops = self.frames.names, [self.frames.top(frame) for frame in self._message_frames]
        if tops:
            return max(tops, key=lambda top: (top in names, tops.count(top)))
        return self.frames.top(min(names)) if names else ""

    @property
    def _message_frames(self) -> list[str]:
        """The frame of each message that is shown."""
        return [
            drawing.frame
            for display in self.message_displays
            for drawing in display.items.values()
            if drawing.frame
        ]

    @property
    def wanted_frame(self) -> str:
        """The frame that the view names; "" if several robots have it with their own prefix."""
        view_frame = self.view.fixed_frame
        if self.alone or view_frame in self.frames.names:
            return view_frame
        prefixed = (robot.frame_of(view_frame) for robot in self.robots)
        return "" if any(frame in self.frames.names for frame in prefixed) else view_frame

    @property
    def missing(self) -> list[str]:
        """The frames of the robots' and the world's links not connected with the fixed frame."""
        fixed = self.fixed_frame
        return [frame for robot in (*self.robots, self.world) for frame in robot.missing(fixed)]

    @property
    def has_fixed_frame(self) -> bool:
        """Whether the frame that the view names is known; True if it names none."""
        wanted = self.wanted_frame
        return not wanted or any(robot.known_as(wanted) for robot in self.robots)
