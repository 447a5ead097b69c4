"""Logs every transform of TF, so that entities move with their frames, and draws frames' axes."""

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

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


class TfDisplay(Display[AxesSettings]):
    """Logs /tf and /tf_static, and draws axes in new frames."""

    key = "axes"
    order, of_all_robots = 0, True

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._look: tuple[object, ...] = ()  # everything that the look of drawn axes depends on
        self._only: set[str] = set()  # frames that have axes; empty for all
        # The frames that have axes: their length, and whether they have names.
        self._drawn: dict[str, tuple[float, bool] | None] = {}
        self._lengths: dict[str, float] = {}  # lengths of axes in the links' frames, m
        self._shown_of: tuple[object, ...] | None = None  # the tree that ``_drawn`` is for
        self._retired: set[str] = set()  # frames of links that a robot no longer has

    def topics(self) -> Sequence[WantedTopic]:
        static = WantedTopic(_STATIC, (TF,), latched=True, stamped_when_sent=False)
        return [WantedTopic("/tf", (TF,), reliable=True), static]

    def apply(self, settings: AxesSettings) -> None:
        super().apply(settings)
        self._only = set(settings.frames)
        for robot in self.stage.robots:
            self._only.update(map(robot.frame_of, settings.frames))
        self._shown_of = None

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
        self._shown_of = None
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
        self._show_connected()
        self._draw(())

    def warnings(self) -> list[str]:
        frame = self.stage.transforms.ignored
        reason = "it is not finite, or its rotation is not a unit quaternion"
        return [f'a transform of "{frame}" is ignored: {reason}'] if frame else []

    def layout(self) -> Sequence[LayoutPart]:
        return [LayoutPart(visible=((FRAMES_ENTITY, self.settings.visible),))]

    def _show_connected(self) -> None:
        """Draw axes in the frames connected with the fixed frame.

        The view would report an error for others, such as frames of another robot on the same /tf.
        """
        frames, fixed_frame = self.stage.frames, self.stage.fixed_frame
        if self._shown_of == (frames.version, fixed_frame):
            return
        self._shown_of = frames.version, fixed_frame
        connected = set(frames.names)
        if self._lengths:
            top = frames.top(fixed_frame)
            connected = {frame for frame in connected if frames.top(frame) == top}
            connected.update(self._lengths)
        connected -= self._retired
        if self._only:
            connected &= self._only
        self._hide(self._drawn.keys() - connected)
        new_frames = connected - self._drawn.keys()
        self._drawn |= dict.fromkeys(new_frames)
        self._draw(new_frames)

    def _draw(self, frames: Collection[str]) -> None:
        """Draw axes in ``frames``; in all frames if the look has changed."""
        settings, lengths = self.settings, self._lengths
        names = settings.names and len(self._drawn) <= settings.names_up_to
        usual = max(lengths.values(), default=0.0) or _DEFAULT_LENGTH
        look = settings.length, lengths, names
        if look != self._look:
            self._look, frames = look, self._drawn
        for frame in frames:
            axes = settings.length or lengths.get(frame) or usual, names
            if self._drawn[frame] != axes:
                self._drawn[frame] = axes
                self._log(frame, frame, rr.TransformAxes3D(axes[0], show_frame=names))

    def _hide(self, frames: Iterable[str]) -> None:
        # Static data cannot be cleared but overwritten, in a frame that exists.
        home = next((robot.root_frame for robot in self.stage.robots if robot.root_frame), "")
        for frame in frames:
            del self._drawn[frame]
            self._log(frame, home, rr.TransformAxes3D.cleared())

    def _log(self, frame: str, parent: str, axes: rr.TransformAxes3D) -> None:
        entity = axes_entity(frame)
        self.stage.recording.log(entity, rr.CoordinateFrame(parent), axes, static=True)
