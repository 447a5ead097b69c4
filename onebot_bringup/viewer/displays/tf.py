"""Logs every transform of TF, so that entities move with their frames, and draws frames' axes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import rerun as rr

from onebot_bringup.viewer.core.display import Display, LayoutPart
from onebot_bringup.viewer.core.inbox import MessageType, WantedTopic
from onebot_bringup.viewer.core.robot_shapes import axes_lengths
from onebot_bringup.viewer.core.settings import name_list, setting
from onebot_bringup.viewer.core.shown_robot import FRAMES_ENTITY, axes_entity
from onebot_bringup.viewer.core.transform_stream import TF
from onebot_description.ros.wire.message_arrays import TfArrays

_STATIC = "/tf_static"
_DEFAULT_LENGTH = 0.5  # length of axes while the robot's size is unknown, meters


@dataclass(frozen=True)
class AxesSettings:
    """The frames' axes."""

    visible: bool = setting(True, "draw it")
    length: float = setting(0.0, "meters; 0: fits the robot's size")
    names: bool = setting(True, "draw it")
    names_up_to: int = setting(16, "draw no names if there are more frames")
    frames: tuple[str, ...] = setting((), "draw only these frames; empty: all", name_list)


class Axes(NamedTuple):
    """How the axes of a frame are drawn."""

    length: float  # meters
    has_name: bool


class TfDisplay(Display[AxesSettings]):
    """Logs /tf and /tf_static, and draws axes in new frames."""

    key = "axes"
    order, of_all_robots = 0, True

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._only: set[str] = set()  # frames that have axes; empty for all
        self._drawn: dict[str, Axes] = {}  # keys: frames
        self._lengths: dict[str, float] = {}  # lengths of axes in the links' frames, m
        self._drawn_of: tuple[object, ...] | None = None  # the tree that ``_drawn`` is for
        self._retired: set[str] = set()  # frames of links that a robot no longer has

    def topics(self) -> Sequence[WantedTopic]:
        static = WantedTopic(_STATIC, (TF,), latched=True, stamped_when_sent=False)
        return [WantedTopic("/tf", (TF,), reliable=True), static]

    def apply(self, settings: AxesSettings) -> None:
        super().apply(settings)
        self._only = set(settings.frames)
        for robot in self.stage.robots:
            self._only.update(map(robot.frame_of, settings.frames))
        self._drawn_of = None

    def set_robot(self) -> None:
        """Draw the axes of new links, and hide those of removed links, at the next flush."""
        self._retired.update(self._lengths)
        self._lengths = {}
        last_robot, lengths = None, dict[str, float]()
        for robot in self.stage.robots:
            if robot.description is None:
                continue
            if robot.description is not last_robot:  # many robots may be alike
                last_robot = robot.description
                lengths = axes_lengths(last_robot, self.stage.robot_size)
            self._lengths |= {robot.frame_of(link): size for link, size in lengths.items()}
        self._retired -= self._lengths.keys()
        self._drawn_of = None
        self.stage.transforms.forget(self._retired)

    def add(
        self, topic: str, _kind: MessageType[Any], messages: Sequence[tuple[int, TfArrays]]
    ) -> None:
        for stamp_ns, message in messages:
            if topic == _STATIC:
                self.stage.transforms.add_static(message)
            else:
                self.stage.transforms.add(stamp_ns, message)

    def flush(self) -> None:
        self.stage.transforms.flush()
        tree = self.stage.frames.version, self.stage.fixed_frame
        if self._drawn_of != tree:
            self._drawn_of = tree
            self._draw(self._axes())

    def warnings(self) -> list[str]:
        frame = self.stage.transforms.ignored
        reason = "it is not finite, or its rotation is not a unit quaternion"
        return [f'a transform of "{frame}" is ignored: {reason}'] if frame else []

    def layout(self) -> Sequence[LayoutPart]:
        return [LayoutPart(visible=((FRAMES_ENTITY, self.settings.visible),))]

    def _axes(self) -> dict[str, Axes]:
        """Return the axes to draw, by frame: in the frames connected with the fixed frame.

        The view would report an error for others, such as frames of another robot on the same /tf.
        """
        tree, settings, lengths = self.stage.frames, self.settings, self._lengths
        frames = set(tree.names)
        if lengths:
            top = tree.top(self.stage.fixed_frame)
            frames = {frame for frame in frames if tree.top(frame) == top}
            frames.update(lengths)
        frames -= self._retired
        if self._only:
            frames &= self._only
        has_names = settings.names and len(frames) <= settings.names_up_to
        usual = max(lengths.values(), default=0.0) or _DEFAULT_LENGTH
        return {
            frame: Axes(settings.length or lengths.get(frame) or usual, has_names)
            for frame in frames
        }

    def _draw(self, axes: Mapping[str, Axes]) -> None:
        """Draw axes, and hide those in other frames."""
        # Static data cannot be cleared but overwritten, in a frame that exists.
        home = next((robot.root_frame for robot in self.stage.robots if robot.root_frame), "")
        for frame in self._drawn.keys() - axes.keys():
            del self._drawn[frame]
            self._log(frame, home, rr.TransformAxes3D.cleared())
        for frame, look in axes.items():
            if self._drawn.get(frame) != look:
                self._drawn[frame] = look
                self._log(frame, frame, rr.TransformAxes3D(look.length, show_frame=look.has_name))

    def _log(self, frame: str, parent: str, axes: rr.TransformAxes3D) -> None:
        entity = axes_entity(frame)
        self.stage.recording.log(entity, rr.CoordinateFrame(parent), axes, static=True)
