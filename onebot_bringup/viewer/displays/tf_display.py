"""Logs every transform of TF, so that entities move with their frames, and draws frames' axes."""

import time
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import chain, compress
from typing import TYPE_CHECKING, Any

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from onebot_bringup.introspection.transforms import FrameTree
from onebot_bringup.viewer.columns import ColumnMaker, ReadyColumn, entity_path, ready, time_column
from onebot_bringup.viewer.displays.display import LARGEST, Display, LayoutPart, is_old
from onebot_bringup.viewer.inbox import OTHER_CLOCK_NS, MessageType, WantedTopic, one_by_one
from onebot_bringup.viewer.settings import name_list, setting
from onebot_description.arrays import Floats
from onebot_description.ros.wire.messages import TfArrays, tf_arrays

if TYPE_CHECKING:
    from onebot_bringup.viewer.stage import Stage

TF_ENTITY = "tf"
TF_STATIC_ENTITY = "tf_static"
FRAMES_ENTITY = "frames"
_DEFAULT_LENGTH = 0.5  # length of axes while the robot's size is unknown, metres
# How long after a new description messages may still name frames of the old one (seconds).
_STRAGGLING = 1.0
_UNIT = 0.01  # tf2's tolerance of the square of a quaternion's length


def _stamp_ns(message: TfArrays) -> int:
    return int(message.stamps_ns[-1]) if len(message.stamps_ns) else 0


TF: MessageType[TfArrays] = MessageType("tf2_msgs/msg/TFMessage", one_by_one(tf_arrays), _stamp_ns)
TF_STATIC: MessageType[TfArrays] = MessageType(TF.name, TF.decode, _stamp_ns, live=False)


@dataclass(frozen=True)
class AxesSettings:
    """The frames' axes."""

    visible: bool = setting(True, "draw it")
    length: float = setting(0.0, "metres; 0: by the robot's size")
    names: bool = setting(True, "draw it")
    names_up_to: int = setting(16, "write no names if there are more frames")
    frames: tuple[str, ...] = setting((), "draw only these frames; empty: all", name_list)


class TfDisplay(Display[AxesSettings]):
    """Logs /tf and /tf_static, and draws axes in new frames."""

    key = "axes"

    def __init__(self, stage: "Stage") -> None:
        super().__init__(stage)
        self._settings = AxesSettings()
        self._look: tuple[object, ...] = ()  # everything that the look of drawn axes depends on
        self._only: set[str] = set()  # frames that have axes; empty for all
        self._drawn: set[str] = set()
        self._links: set[str] = set()  # frames of the robots' links
        self._shown_of: tuple[object, ...] | None = None  # the tree that ``_drawn`` is for
        self._retired: set[str] = set()  # frames of links of the previous robot
        self._retired_at = 0.0

    def topics(self) -> Sequence[WantedTopic]:
        static = WantedTopic("/tf_static", (TF_STATIC,), latched=True)
        return [WantedTopic("/tf", (TF,), reliable=True), static]

    def apply(self, settings: AxesSettings) -> None:
        self._settings = settings
        self._only = set(settings.frames)
        for robot in self.stage.robots:
            self._only.update(map(robot.frame_of, settings.frames))
        if self._only:
            self._hide(self._drawn - self._only)
        self._shown_of = None
        self._draw(())

    def set_robot(self) -> None:
        """Draw the axes of the links; the next flush hides the axes of links that are gone."""
        old_links, self._links = self._links, set()
        for robot in self.stage.robots:
            if robot.description is not None:
                self._links.update(map(robot.frame_of, robot.description.link_names))
        self._show(self._links)
        self._retired = (self._retired | old_links) - self._links
        self._retired_at = self.stage.clock()
        self._shown_of = None
        self.stage.transforms.forget(self._retired)

    def add(
        self, _topic: str, kind: MessageType[Any], messages: Sequence[tuple[int, TfArrays]]
    ) -> None:
        for stamp_ns, message in messages:
            if kind is TF_STATIC:
                self.stage.transforms.add_static(message)
            else:
                self.stage.transforms.add(stamp_ns, message)

    def flush(self) -> None:
        self.stage.transforms.flush()
        if self._retired and self.stage.clock() - self._retired_at > _STRAGGLING:
            self.stage.transforms.forget(self._retired)
            self._retired = set()
            self._shown_of = None
        self._show_connected()
        self._draw(())

    def warnings(self) -> list[str]:
        frame = self.stage.transforms.ignored
        reason = "it is not finite, or its rotation no unit quaternion"
        return [f'a transform of "{frame}" is ignored: {reason}'] if frame else []

    def layout(self) -> LayoutPart:
        return LayoutPart(visible=((FRAMES_ENTITY, self._settings.visible),))

    def _show_connected(self) -> None:
        """Draw axes in the frames connected with the fixed frame.

        The view would report an error for others, such as frames of another robot on the same /tf.
        """
        frames, fixed_frame = self.stage.frames, self.stage.fixed_frame
        if self._shown_of == (frames.version, fixed_frame):
            return
        self._shown_of = frames.version, fixed_frame
        connected = set(frames.names)
        if self._links:
            top = frames.top(fixed_frame)
            connected = {frame for frame in connected if frames.top(frame) == top} | self._links
        connected -= self._retired
        self._hide(self._drawn - connected)
        self._show(connected)

    def _show(self, frames: Iterable[str]) -> None:
        chosen_frames = self._only.intersection(frames) if self._only else set(frames)
        new_frames = chosen_frames - self._drawn
        self._drawn |= new_frames
        self._draw(new_frames)

    def _draw(self, frames: Collection[str]) -> None:
        """Draw axes in ``frames``; in all frames if the look has changed."""
        settings, robot = self._settings, self.stage.robots[0]
        lengths = robot.axes_lengths
        names = settings.names and len(self._drawn) <= settings.names_up_to
        usual = robot.fitting_length or _DEFAULT_LENGTH
        look = settings.length, usual, lengths, names
        if look != self._look:
            self._look, frames = look, self._drawn
        for frame in frames:
            length = settings.length or lengths.get(frame) or usual
            self._log(frame, frame, rr.TransformAxes3D(length, show_frame=names))

    def _hide(self, frames: Iterable[str]) -> None:
        # Static data cannot be cleared but overwritten, in a frame that exists.
        home = next((robot.home for robot in self.stage.robots if robot.home), "")
        for frame in self._drawn.intersection(frames):
            self._drawn.discard(frame)
            self._log(frame, home, rr.TransformAxes3D.cleared())

    def _log(self, frame: str, parent: str, axes: rr.TransformAxes3D) -> None:
        entity = axes_entity(frame)
        self.stage.recording.log(entity, rr.CoordinateFrame(parent), axes, static=True)


def axes_entity(frame: str) -> str:
    """Return the entity of the axes of ``frame``."""
    return entity_path(FRAMES_ENTITY, frame)


# --- transforms -------------------------------------------------------------------------------

_TRANSLATIONS = ColumnMaker(rr.Transform3D.columns(translation=np.zeros((1, 3))))
_ROTATIONS = ColumnMaker(rr.Transform3D.columns(quaternion=np.zeros((1, 4))))


def _usable(translations: Floats, rotations: Floats) -> NDArray[np.bool_]:
    """Return a mask of the rows that are valid: finite, with a quaternion of unit length."""
    with np.errstate(all="ignore"):
        lengths, distances = (np.einsum("ij,ij->i", a, a) for a in (rotations, translations))
        usable: NDArray[np.bool_] = np.abs(lengths - 1.0) <= _UNIT  # both are squared lengths
        usable &= distances <= LARGEST**2
        return usable


def _sane(stamps: NDArray[np.int64], instead: NDArray[np.int64]) -> NDArray[np.int64]:
    return np.where((stamps == 0) | (stamps > instead + OTHER_CLOCK_NS), instead, stamps)


@lru_cache(maxsize=32)
def _name_columns(parents: tuple[str, ...], children: tuple[str, ...]) -> Sequence[ReadyColumn]:
    """Return columns with the frame of each row, and its parent."""
    return ready(rr.Transform3D.columns(parent_frame=parents, child_frame=children))


class TransformStream:
    """Logs transforms in batches, and stores the latest of each frame in ``frames``."""

    def __init__(self, recording: rr.RecordingStream, frames: FrameTree) -> None:
        self.recording = recording
        self._frames = frames
        self._pending: list[tuple[int, TfArrays]] = []
        self._static: dict[str, tuple[object, ...]] = {}
        self._logged: dict[str, float] = {}  # monotonic time of each child's last row
        self._repeated_at = 0.0
        self.ignored = ""  # the first frame with an invalid transform

    def add(self, stamp_ns: int, transforms: TfArrays) -> None:
        """Add a message of /tf; it is logged at the next ``flush``.

        Args:
            stamp_ns: its time, nanoseconds; replaces stamps that are zero, or more than 10 s later.
            transforms: the message.
        """
        if transforms.children:
            self._pending.append((stamp_ns, transforms))

    def add_static(self, transforms: TfArrays) -> None:
        """Log the changed transforms of a message of /tf_static, on one entity per frame.

        Of several static chunks on one entity, a file would keep only a part.
        """
        transforms = self._only_usable(transforms)
        self._frames.update(transforms, static=True)
        for row, child in enumerate(transforms.children):
            translation, rotation = transforms.translations[row], transforms.rotations[row]
            value = (transforms.parents[row], *translation.tolist(), *rotation.tolist())
            if self._static.get(child) == value:
                continue
            self._static[child] = value
            self.recording.log(
                entity_path(TF_STATIC_ENTITY, child),
                rr.Transform3D(
                    translation=translation,
                    quaternion=rr.Quaternion(xyzw=rotation),
                    parent_frame=transforms.parents[row],
                    child_frame=child,
                ),
                static=True,
            )

    def _only_usable(self, transforms: TfArrays) -> TfArrays:
        """Return the valid transforms; tf2 ignores the others, too."""
        usable = _usable(transforms.translations, transforms.rotations)
        if usable.all():
            return transforms
        bad = int(np.argmin(usable))
        self.ignored = self.ignored or transforms.children[bad]
        return TfArrays(
            list(compress(transforms.parents, usable)),
            list(compress(transforms.children, usable)),
            transforms.stamps_ns[usable],
            transforms.translations[usable],
            transforms.rotations[usable],
        )

    def forget(self, frames: Iterable[str]) -> None:
        """Drop ``frames`` until they are received again."""
        frames = list(frames)
        self._frames.forget(frames)
        for frame in frames:
            self._static.pop(frame, None)
            self._logged.pop(frame, None)

    def flush(self) -> bool:
        """Log the collected transforms in one call; return whether there were any."""
        pending, self._pending = self._pending, []
        if not pending:
            return False
        batch = [item for _, item in pending]
        stamps = np.concatenate([item.stamps_ns for item in batch])
        translations = np.concatenate([item.translations for item in batch])
        rotations = np.concatenate([item.rotations for item in batch])
        if not _usable(translations, rotations).all():
            for stamp_ns, item in pending:
                self.add(stamp_ns, self._only_usable(item))
            return self.flush()
        latest = max(stamp_ns for stamp_ns, _ in pending) + OTHER_CLOCK_NS
        if not stamps.all() or stamps.max() > latest:
            instead = [np.full(len(item.children), stamp_ns) for stamp_ns, item in pending]
            stamps = _sane(stamps, np.concatenate(instead))
        parents = tuple(chain.from_iterable(item.parents for item in batch))
        children = tuple(chain.from_iterable(item.children for item in batch))
        self._send(stamps, translations, rotations, parents, children)
        self._remember(batch, int(stamps.max()))
        return True

    def _remember(self, batch: Sequence[TfArrays], latest_ns: int) -> None:
        """Update ``frames``, and log frames again that have not come for a while."""
        now = time.monotonic()
        for item in batch:
            self._frames.update(item)
        # The list of frames is usually the same object, so look at each only once.
        for children in {id(item.children): item.children for item in batch}.values():
            self._logged.update(dict.fromkeys(children, now))
        if is_old(self._repeated_at):
            self._repeated_at = now
            self._repeat_slow(now, latest_ns)

    def _repeat_slow(self, now: float, stamp_ns: int) -> None:
        """Log frames again that have not come for a while, at the time of the newest."""
        slow = tuple(child for child, when in self._logged.items() if is_old(when))
        if not slow:
            return
        edges = [self._frames.edges[child] for child in slow]
        self._send(
            np.full(len(slow), stamp_ns),
            np.array([edge.translation for edge in edges]),
            np.array([edge.rotation for edge in edges]),
            tuple(edge.parent for edge in edges),
            slow,
        )
        self._logged.update(dict.fromkeys(slow, now))

    def _send(
        self,
        stamps_ns: NDArray[np.int64],
        translations: Floats,
        rotations: Floats,
        parents: tuple[str, ...],
        children: tuple[str, ...],
    ) -> None:
        numbers = [_TRANSLATIONS.column(translations), _ROTATIONS.column(rotations)]
        columns = [*numbers, *_name_columns(parents, children)]
        self.recording.send_columns(TF_ENTITY, indexes=[time_column(stamps_ns)], columns=columns)
