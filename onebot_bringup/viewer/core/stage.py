"""The stage, which all displays share: the robots, the TF tree, the fixed frame and the time."""

import time
from collections import Counter
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import rerun as rr

from onebot_bringup.viewer.core.columns import ReadyColumn, batches, one_row, send
from onebot_bringup.viewer.core.inbox import MessageType, message_type
from onebot_bringup.viewer.core.shown_robot import (
    WORLD_DESCRIPTION,
    RobotToShow,
    ShownRobot,
    unknown_frame,
)
from onebot_bringup.viewer.core.transform_stream import TransformStream
from onebot_description.description import Description
from onebot_description.errors import listing
from onebot_description.ros.frame_tree import FrameTree
from onebot_description.ros.wire.interface_text import full_definition

_TRANSFORM_TIMEOUT_NS = 200_000_000
_LISTED = 5  # robots named in a message


class Stage:
    """The recording that all displays draw on, the robots in it and their frames.

    Attributes:
        view_frame: the fixed frame that the view names; "" for none.
        message_frames: the frame of each message that is shown.
        now_ns: the time on the timeline, nanoseconds.
    """

    def __init__(
        self,
        recording: rr.RecordingStream,
        view_frame: str = "",
        robots: Sequence[RobotToShow] = (RobotToShow(),),
        *,
        resolve: Callable[[str], str] = str,
        clock: Callable[[], float] = time.monotonic,
        definitions: Callable[[str], str] = full_definition,
    ) -> None:
        """Prepare for robots whose descriptions follow; see ``RobotView`` for the arguments."""
        self.recording = recording
        self.view_frame = view_frame
        self.message_frames: Sequence[str] = ()
        self.resolve = resolve
        self.clock = clock
        self._definitions = definitions
        self.frames = FrameTree()
        self.transforms = TransformStream(recording, self.frames)
        self.alone = len(robots) == 1
        make_robot = partial(ShownRobot, recording, frames=self.frames, resolve=resolve)
        self.robots = [make_robot(names, "" if self.alone else names.entity) for names in robots]
        # The surroundings of the robots.
        self.world = make_robot(RobotToShow(description=WORLD_DESCRIPTION), "world")
        self.now_ns = 0
        self.transform_timeout_ns = _TRANSFORM_TIMEOUT_NS  # how long messages wait for transforms
        self.robot_size = 0.0  # the diagonal of the smallest robot, meters; 0: not known yet

    def message_type(self, name: str) -> MessageType[Any]:
        """Return a message type whose messages are decoded by its definition.

        Raises:
            OneBotError: there is no definition of it.
            ValueError: the definition cannot be read.
        """
        return message_type(name, self._definitions(name))

    # --- what is logged ---------------------------------------------------------------------------

    def log_rows(
        self, entity: str, rows: Sequence[tuple[int, Sequence[rr.AsComponents | ReadyColumn]]]
    ) -> None:
        """Log messages, each at its time, in as few calls as possible."""
        ready = [
            (stamp_ns, [column for archetype in archetypes for column in one_row(archetype)])
            for stamp_ns, archetypes in rows
        ]
        for stamps_ns, columns in batches(ready):
            send(self.recording, entity, stamps_ns, columns)

    def clear(self, entity: str, stamp_ns: int, frame: str) -> None:
        """Clear an entity; it keeps a frame, since the view reports entities without one."""
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

    def late(self) -> list[str]:
        """Return a sentence per kind of frames and descriptions that are missing."""
        frame = self.wanted_frame
        if not self.descriptions:
            fixed, frame = self.fixed_frame, self.view_frame
            return [] if frame in ("", fixed) else [unknown_frame(frame, fixed, self.frames)]
        sentences = []
        for robot in (*self.robots, self.world):
            sentences += robot.late(frame)
        lacking = [str(robot.names) for robot in self.robots if robot.description is None]
        if lacking:
            sentences.append(f"no description yet of the robots in {listing(lacking, _LISTED)}")
        return sentences

    # --- frames -----------------------------------------------------------------------------------

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
        frame = self.view_frame
        if frame and (frame in self.frames.names or frame in self.message_frames):
            return frame
        return self.frame_without_robot or frame

    @property
    def frame_without_robot(self) -> str:
        """The topmost frame of most messages shown, or else of any transform; "" for none.

        Without transforms, it is the frame of most messages.
        """
        names, tops = self.frames.names, [self.frames.top(frame) for frame in self.message_frames]
        if tops:
            counts = Counter(tops)
            return max(tops, key=lambda top: (top in names, counts[top]))
        return self.frames.top(min(names)) if names else ""

    @property
    def wanted_frame(self) -> str:
        """The frame that the view names; "" if several robots have it with their own prefix."""
        frame = self.view_frame
        if self.alone or frame in self.frames.names:
            return frame
        prefixed = (robot.frame_of(frame) for robot in self.robots)
        return "" if any(name in self.frames.names for name in prefixed) else frame

    @property
    def missing(self) -> list[str]:
        """The frames of the robots' and the world's links not connected with the fixed frame."""
        fixed = self.fixed_frame
        return [frame for robot in (*self.robots, self.world) for frame in robot.missing(fixed)]

    @property
    def has_fixed_frame(self) -> bool:
        """Whether the frame that the view names is known; True if it names none."""
        frame = self.wanted_frame
        return not frame or any(robot.known_as(frame) for robot in self.robots)
