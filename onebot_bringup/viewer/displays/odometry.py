"""A robot that drives: its trails, its speeds and how sure it is, as a view asks for them."""

from collections.abc import Callable

import rerun as rr

from onebot_bringup.viewer.displays.covariance import CovarianceStream
from onebot_bringup.viewer.displays.speeds import SpeedStream
from onebot_bringup.viewer.displays.tf import FrameTree, TransformStream
from onebot_bringup.viewer.displays.trail import TrailStream
from onebot_bringup.viewer.view_config import ViewConfig
from onebot_description.wire.messages import OdometrySample, TwistSample

# Easily told apart on a dark ground; a view may name others.
COLORS = ((255, 176, 32), (77, 208, 225), (240, 98, 146), (174, 213, 129), (179, 157, 219))
_COMPLAIN_AFTER = 3.0  # seconds
# Nanoseconds between two calls into Rerun: each costs a kilobyte of file and of server memory, and
# what lags behind of a trail is under the robot.
_FLUSH_EVERY = 200_000_000


class DriveStream:
    """Passes what comes on a topic to every trail and curve that is of it."""

    def __init__(
        self,
        recording: rr.RecordingStream,
        view: ViewConfig,
        transforms: TransformStream,
        frames: FrameTree,
        clock: Callable[[], float],
    ) -> None:
        """Log into ``recording`` what ``view`` asks for.

        Args:
            recording: where to log.
            view: its trails, speeds and covariances.
            transforms: what logs /tf there.
            frames: what is known of /tf.
            clock: seconds.
        """
        self._frames = frames
        self._clock = clock
        self._trails = {
            name: TrailStream(recording, name, trail, COLORS[index % len(COLORS)])
            for index, (name, trail) in enumerate(view.trails.items())
        }
        self._covariances = {
            name: CovarianceStream(
                recording, transforms, name, item, COLORS[index % len(COLORS)], clock
            )
            for index, (name, item) in enumerate(view.covariance.items())
        }
        self._speeds = {
            name: SpeedStream(recording, name, line.color or COLORS[index % len(COLORS)])
            for index, (name, line) in enumerate(view.speeds.lines.items())
        }
        self._trails_of = _by_topic({name: item.topic for name, item in view.trails.items()})
        self._speeds_of = _by_topic({name: item.topic for name, item in view.speeds.lines.items()})
        self._covariances_of = _by_topic({n: item.topic for n, item in view.covariance.items()})
        self._waiting_since: dict[str, float] = {}
        self._flushed_ns: int | None = None

    def add_odometry(self, topic: str, stamp_ns: int, sample: OdometrySample) -> None:
        """Take in an Odometry message of ``topic``, of the time ``stamp_ns``."""
        for name in self._trails_of.get(topic, ()):
            self._trails[name].add(stamp_ns, sample)
        for name in self._covariances_of.get(topic, ()):
            self._covariances[name].add(stamp_ns, sample)
        for name in self._speeds_of.get(topic, ()):
            linear, angular = float(sample.linear[0]), float(sample.angular[2])
            self._speeds[name].add(stamp_ns, linear, angular, held=False)

    def add_command(self, topic: str, stamp_ns: int, sample: TwistSample) -> None:
        """Take in a Twist or TwistStamped of ``topic``, of the time ``stamp_ns``."""
        for name in self._speeds_of.get(topic, ()):
            linear, angular = float(sample.linear[0]), float(sample.angular[2])
            self._speeds[name].add(stamp_ns, linear, angular, held=True)

    def tick(self, fixed_frame: str, now_ns: int) -> list[str]:
        """Log what was collected, when it is time for that.

        Args:
            fixed_frame: the frame everything is shown in.
            now_ns: the time, nanoseconds.

        Returns:
            What cannot be shown, a sentence each.
        """
        if self._flushed_ns is None or abs(now_ns - self._flushed_ns) >= _FLUSH_EVERY:
            self._flushed_ns = now_ns
            self.flush(fixed_frame)
        return self._problems(fixed_frame)

    def flush(self, fixed_frame: str) -> None:
        """Log what was collected."""
        for speed in self._speeds.values():
            speed.flush()
        top = self._frames.top(fixed_frame)
        for trail in self._trails.values():
            trail.flush(lambda frame: self._frames.top(frame) == top)
        for covariance in self._covariances.values():
            covariance.flush(lambda frame: self._frames.top(frame) == top)

    def _problems(self, fixed_frame: str) -> list[str]:
        top = self._frames.top(fixed_frame)
        shown = [(f'trail "{name}"', trail.frame) for name, trail in self._trails.items()]
        shown += [(f'covariance "{name}"', item.frame) for name, item in self._covariances.items()]
        return [
            f'{what} is in the frame "{frame}", which no transform connects with '
            f'"{fixed_frame}": not shown until /tf or /tf_static brings one'
            for what, frame in shown
            if frame and self._waits(what, self._frames.top(frame) != top)
        ]

    def _waits(self, name: str, waiting: bool) -> bool:
        """Whether something has waited for its frame so long that it must be said."""
        if not waiting:
            self._waiting_since.pop(name, None)
            return False
        return self._clock() - self._waiting_since.setdefault(name, self._clock()) > _COMPLAIN_AFTER


def _by_topic(topics: dict[str, str]) -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    for name, topic in topics.items():
        found.setdefault(topic, []).append(name)
    return found
