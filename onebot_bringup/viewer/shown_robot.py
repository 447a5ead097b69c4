"""One of the robots of a view: its names, its description, and what is drawn of it."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from onebot_bringup.viewer.displays.display import Context, Display, LayoutPart, below
from onebot_bringup.viewer.displays.tf import axes_entity
from onebot_bringup.viewer.frames import FrameResolution
from onebot_bringup.viewer.scene import COLLISION_ENTITY, Scene
from onebot_description.description import Description, parse_description

ROBOT_DESCRIPTION = "robot_description"
MOST_PLOTTED = 5  # robots, unless they are chosen: there is no room for more tabs


@dataclass(frozen=True)
class RobotToShow:
    """Which robot to show: how its topics and its frames are named."""

    namespace: str = ""  # of its topics; "" for none before those that the view names
    frame_prefix: str = ""  # put before link names to get their frames
    description: str = ROBOT_DESCRIPTION  # the topic of its URDF
    plotted: bool = True  # with its curves

    def topic(self, name: str) -> str:
        """Return the name of a topic of the robot; one that is absolute stays as it is."""
        relative = self.namespace and not name.startswith("/")
        return f"{self.namespace.rstrip('/')}/{name}" if relative else name

    @property
    def entity(self) -> str:
        """The entity below which it is logged, where there are several."""
        return self.namespace.strip("/")

    def __str__(self) -> str:
        """Return where it is, for messages."""
        return self.namespace or "/"


class ShownRobot:
    """A robot in a recording, from its description on."""

    def __init__(
        self,
        names: RobotToShow,
        context: Context,
        displays: Iterable[type[Display[Any]]],
    ) -> None:
        """Show nothing yet: the description follows.

        Args:
            names: of the robot.
            context: of its displays.
            displays: what is drawn of it beside its shapes.
        """
        self.names = names
        self.context = context
        self.scene = Scene(context.recording, names.frame_prefix)
        self.resolution = FrameResolution(context.frames, context.frame_of)
        self.displays: Sequence[Display[Any]] = [display(context) for display in displays]
        self.urdf = ""  # that it is shown by

    @property
    def robot(self) -> Description | None:
        """Its description; None before it has come."""
        return self.context.robot

    def set_description(self, urdf: str, known: Description | None = None) -> list[str]:
        """Show the robot of this text, in place of the one before.

        Args:
            urdf: the text.
            known: what the text describes, where that is known.

        Returns:
            What could not be drawn, a sentence each.

        Raises:
            OneBotError: the text is wrong.
        """
        robot = known or parse_description(urdf, self.names.description.strip("/"))
        warnings = self.scene.set_robot(robot)
        self.urdf, self.context.robot = urdf, robot
        for display in self.displays:
            display.set_robot()
        return warnings

    def is_complete(self, fixed_frame: str) -> bool:
        """Whether its links are known, and each has a transform to this frame ("": any)."""
        return self.robot is not None and self.resolution.is_complete(self.robot, fixed_frame)

    def entity_of(self, link: str) -> str:
        """Return the entity that moves with a link: its first visual, or else its axes."""
        visual = self.scene.visual_of(link)
        if visual is None:
            return axes_entity(self.context.frame_of(link))
        return below(self.context.root, visual)

    def layout(self, *, collision: bool) -> list[LayoutPart]:
        """Return its part of the layout.

        Args:
            collision: show its collision shapes.
        """
        parts = [LayoutPart(visible=((COLLISION_ENTITY, collision),))]
        parts += [display.layout() for display in self.displays]
        return [part.below(self.context.root) for part in parts]
