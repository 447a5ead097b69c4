"""The frames that are drawn: all that were heard, but none of a robot that is gone."""

from collections.abc import Callable

from onebot_bringup.viewer.frames import FrameTree
from onebot_bringup.viewer.geometry import Robot
from onebot_bringup.viewer.scene import Scene
from onebot_bringup.viewer.streams import TransformStream

# For how long after a new description messages may still name the frames of the old one (seconds).
_STRAGGLING = 1.0


class ShownFrames:
    """Draws axes in new frames, and hides those of links that are no more."""

    def __init__(
        self,
        scene: Scene,
        transforms: TransformStream,
        frames: FrameTree,
        clock: Callable[[], float],
    ) -> None:
        """Draw in ``scene`` the ``frames`` that ``transforms`` hears; ``clock`` in seconds."""
        self._scene = scene
        self._transforms = transforms
        self._frames = frames
        self._clock = clock
        self._retired: set[str] = set()
        self._retired_at = clock()

    def retire(self, before: Robot | None, now: Robot) -> None:
        """Hide the frames of links that are no more."""
        frame_of = self._scene.frame_of
        old = set() if before is None else set(map(frame_of, before.links))
        self._retired = old - set(map(frame_of, now.links))
        self._retired_at = self._clock()
        self._transforms.forget(self._retired)
        self._scene.hide_frames(self._retired, frame_of(now.root))

    def show(self) -> None:
        """Draw new frames, but not those that only a straggling message still names."""
        if self._retired and self._clock() - self._retired_at > _STRAGGLING:
            self._transforms.forget(self._retired)
            self._retired = set()
        self._scene.show_frames(self._frames.names - self._retired)
