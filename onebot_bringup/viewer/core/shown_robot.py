"""A robot of a view: its names, its description and its frames."""

from collections.abc import Callable
from dataclasses import dataclass

import rerun as rr

from onebot_bringup.viewer.core.columns import entity_path
from onebot_bringup.viewer.core.robot_shapes import RobotShapes
from onebot_description.description import Description, parse_description
from onebot_description.errors import did_you_mean, listing
from onebot_description.ros.frame_tree import FrameTree

FRAMES_ENTITY = "frames"
ROBOT_DESCRIPTION = "robot_description"
WORLD_DESCRIPTION = "/world_description"
MAX_PLOTTED = 5  # robots with curves; there is no space for more tabs


@dataclass(frozen=True)
class RobotToShow:
    """Names the topics and frames of a robot to show."""

    namespace: str = ""  # prefix of the view's relative topics; "" for none
    frame_prefix: str = ""  # prefix of the links' frames
    description: str = ROBOT_DESCRIPTION  # the topic of its URDF
    plotted: bool = True  # whether its curves are shown

    def topic(self, name: str) -> str:
        """Return the name of a topic of the robot; an absolute name stays as it is."""
        relative = self.namespace and not name.startswith("/")
        return f"{self.namespace.rstrip('/')}/{name}" if relative else name

    @property
    def entity(self) -> str:
        """The entity below which the robot is logged if there are several."""
        return self.namespace.strip("/")

    def __str__(self) -> str:
        return self.namespace or "/"


def axes_entity(frame: str) -> str:
    """Return the entity of the axes of ``frame``."""
    return entity_path(FRAMES_ENTITY, frame)


class ShownRobot:
    """A robot on a stage, before and after its description is known."""

    def __init__(
        self,
        recording: rr.RecordingStream,
        names: RobotToShow,
        root: str,
        *,
        frames: FrameTree,
        resolve: Callable[[str], str],
    ) -> None:
        """Show nothing yet.

        Args:
            recording: where to log.
            names: the robot's topics and frames.
            root: the entity above the robot's; "" for the only robot.
            frames: the TF tree.
            resolve: returns the full name of a topic.
        """
        self.names, self.root = names, root
        self.frames, self._resolve = frames, resolve
        self.shapes = RobotShapes(recording, names.frame_prefix, root)
        self.description: Description | None = None
        self.urdf = ""  # the text of the description
        self.joint_positions: dict[str, float] = {}  # rad or m, for displays that ask for them

    def frame_of(self, link: str) -> str:
        """Return the TF frame of ``link``."""
        return self.names.frame_prefix + link

    def full_name(self, topic: str) -> str:
        """Return the full name of a topic of the robot."""
        return self._resolve(self.names.topic(topic))

    @property
    def root_frame(self) -> str:
        """The root link's frame, which exists."""
        return "" if self.description is None else self.frame_of(self.description.root_link)

    @property
    def clouds_of_scans(self) -> set[str]:
        """Full topic names of the clouds in which lidars publish the same data as in scans."""
        sensors = () if self.description is None else self.description.sensors
        return {
            self.full_name(sensor.topics["points"])
            for sensor in sensors
            if next(iter(sensor.topics)) == "scan" and "points" in sensor.topics
        }

    def set_description(self, urdf: str, description: Description | None = None) -> list[str]:
        """Show the robot of a URDF in place of the previous one.

        Args:
            urdf: the text of the URDF.
            description: the parsed URDF; None to parse it here.

        Returns:
            One sentence per thing that could not be drawn.

        Raises:
            OneBotError: the URDF is invalid.
        """
        robot = description or parse_description(urdf, self.names.description.strip("/"))
        warnings = self.shapes.set_robot(robot)
        self.urdf, self.description = urdf, robot
        return warnings

    # --- frames -----------------------------------------------------------------------------------

    @property
    def top_frame(self) -> str:
        """The topmost frame above the root link; "" without a description."""
        return self.frames.top(self.root_frame) if self.root_frame else ""

    def known_as(self, wanted: str) -> str:
        """Return the name of a known frame, with or without the prefix; "" if neither is known.

        Another robot's frame may have the name without the prefix, so a frame that is connected
        with this robot is preferred; if both are, the name without the prefix.
        """
        if not wanted or self.description is None:
            return ""
        frames, links = self.frames, self.description.link_names
        prefixed = self.frame_of(wanted)
        names = [prefixed] if prefixed in frames.names or wanted in links else []
        if wanted in frames.names or wanted in map(self.frame_of, links):
            names.insert(0, wanted)
        connected = [name for name in names if frames.top(name) == self.top_frame]
        return next(iter(connected + names), "")

    def fixed_frame(self, wanted: str) -> str:
        """Return the frame to show the robot in: ``wanted`` if known, or else the topmost frame."""
        return self.known_as(wanted) or self.top_frame

    def missing(self, fixed_frame: str) -> list[str]:
        """Return the frames of links that no transform connects with ``fixed_frame``."""
        links = () if self.description is None else self.description.link_names
        top = self.frames.top(fixed_frame)
        return [frame for frame in map(self.frame_of, links) if self.frames.top(frame) != top]

    def late(self, wanted: str) -> list[str]:
        """Return a sentence about links without a transform, one about an unknown fixed frame."""
        if self.description is None:
            return []
        warnings, fixed_frame = [], self.fixed_frame(wanted)
        missing = self.missing(fixed_frame)
        if missing:
            warnings.append(
                f'no transform yet from "{fixed_frame}" to {listing(missing, 5)}: '
                "not shown until /tf or /tf_static has it"
            )
        if wanted and not self.known_as(wanted):
            warnings.append(unknown_frame(wanted, fixed_frame, self.frames))
        return warnings

    def entity_of(self, link: str) -> str:
        """Return the entity that moves with a link: its first visual, or else its axes."""
        return self.shapes.visual_of(link) or axes_entity(self.frame_of(link))


def unknown_frame(wanted: str, fixed_frame: str, frames: FrameTree) -> str:
    """Return a warning that ``wanted`` is unknown, and which frame is used instead."""
    hint = did_you_mean(wanted, frames.names, "frames received")
    return (
        f'the fixed frame "{wanted}" is not on /tf or /tf_static{hint}; '
        f'shown in "{fixed_frame}" until it is'
    )
