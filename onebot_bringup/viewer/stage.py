"""The stage: what all displays share. The robots, the TF tree, the fixed frame and the time."""

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
_LISTED = 5  # names of robots


class Stage:
    """Where displays draw."""

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
        """Set the stage for robots whose descriptions follow; arguments are ``RobotView``'s."""
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
        # What stands around the robots.
        self.world = ShownRobot(self, RobotToShow(description=WORLD_DESCRIPTION), "world")
        self.message_displays: Sequence[MessageDisplay] = ()
        self.now_ns = 0  # on the timeline, nanoseconds
        self.transform_timeout_ns = _TRANSFORM_TIMEOUT_NS  # messages wait for transforms so long
        self.robot_size = 0.0  # the diagonal of the smallest robot, metres; 0: not known yet

    def message_type(self, name: str, *, live: bool = True) -> MessageType[Any]:
        """Return a type whose messages are decoded by its definition.

        Raises:
            OneBotError: there is no definition of it.
            ValueError: it cannot be read.
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
        """Remove what is drawn at an entity; without a frame it would be an error in the view."""
        self.log_rows(entity, [(stamp_ns, [rr.Clear(recursive=False)])])
        if frame:
            self.log_rows(entity, [(stamp_ns, [rr.CoordinateFrame(frame)])])

    # --- robots -----------------------------------------------------------------------------------

    @property
    def descriptions(self) -> dict[str, Description]:
        """The robots shown now, by their namespaces."""
        robots = ((str(robot.names), robot.description) for robot in self.robots)
        return {name: description for name, description in robots if description is not None}

    def robot_of(self, topic: str) -> ShownRobot:
        """Return the robot whose namespace a topic is in, by its full name, or else the first."""
        namespaces = {robot.full_name("x")[:-1]: robot for robot in self.robots}
        inside = filter(topic.startswith, namespaces)
        return namespaces[max(inside, key=len, default=next(iter(namespaces)))]

    def wrong_names(self) -> list[str]:
        """Return that no robot has the link that the camera is to follow."""
        follow = self.view.camera.follow
        links = {link for robot in self.descriptions.values() for link in robot.link_names}
        names = set(links)
        for robot in () if self.alone else self.robots:  # of several, by frames
            names.update(map(robot.frame_of, links))
        if not links or not follow or follow in names:
            return []
        hint = did_you_mean(follow, links, "links")
        return [f'camera.follow: the robot has no link "{follow}"{hint}']

    def late(self) -> list[str]:
        """Return which frames and descriptions are missing, a sentence each."""
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
        """Return a warning that ``wanted`` has not been received, and what is shown instead."""
        hint = did_you_mean(wanted, self.frames.names, "frames received")
        return (
            f'the fixed frame "{wanted}" is not on /tf or /tf_static{hint}; '
            f'shown in "{fixed_frame}" until it is'
        )

    def connected(self, frame: str) -> bool:
        """Whether transforms lead from ``frame`` to the fixed one.

        An entity in a frame without would be an error in the view: it has to wait.
        """
        return self.frames.top(frame) == self.frames.top(self.fixed_frame)

    @property
    def fixed_frame(self) -> str:
        """The frame everything is shown in; "" before there is any.

        The view's, also with the frame_prefix before it; while no such frame is known, the one
        above the robot's root link, or without a robot above the frames of most messages. That
        one, too, of several robots that each have the view's.
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
        """The root of the transforms that most messages shown have, or of any; "" for none.

        Without transforms, the frame that most have.
        """
        names, tops = self.frames.names, [self.frames.top(frame) for frame in self._message_frames]
        if tops:
            return max(tops, key=lambda top: (top in names, tops.count(top)))
        return self.frames.top(min(names)) if names else ""

    @property
    def _message_frames(self) -> list[str]:
        """The frames of the messages that are shown."""
        return [
            drawing.frame
            for display in self.message_displays
            for drawing in display.items.values()
            if drawing.frame
        ]

    @property
    def wanted_frame(self) -> str:
        """The frame that the view names; "" where each of several robots has one of that name."""
        view_frame = self.view.fixed_frame
        if self.alone or view_frame in self.frames.names:
            return view_frame
        prefixed = (robot.frame_of(view_frame) for robot in self.robots)
        return "" if any(frame in self.frames.names for frame in prefixed) else view_frame

    @property
    def missing(self) -> list[str]:
        """The frames of links that no transform connects with the fixed frame, the world's, too."""
        fixed = self.fixed_frame
        return [frame for robot in (*self.robots, self.world) for frame in robot.missing(fixed)]

    @property
    def has_fixed_frame(self) -> bool:
        """The frame that the view names, if any, is known."""
        wanted = self.wanted_frame
        return not wanted or any(robot.known_as(wanted) for robot in self.robots)
