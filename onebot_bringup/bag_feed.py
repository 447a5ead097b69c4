"""Feeds the messages of a recording to a view, whose clock is the recording's."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import rerun as rr

from onebot_bringup.bag.messages import BagMessage
from onebot_bringup.bag.reader import Bag
from onebot_bringup.bag_robot import TF, RobotTopics, text_of
from onebot_bringup.raw_messages import (
    BAD_MESSAGE,
    joint_state_arrays,
    odometry_sample,
    tf_arrays,
    twist_sample,
    twist_stamped_sample,
)
from onebot_bringup.viewer.live_view import LiveView
from onebot_bringup.viewer.view_config import ViewConfig
from onebot_description.errors import OneBotError

_ODOMETRY = "nav_msgs/msg/Odometry"
_TWISTS = {
    "geometry_msgs/msg/Twist": twist_sample,
    "geometry_msgs/msg/TwistStamped": twist_stamped_sample,
}
_TICK = 500_000_000  # ns of the recording between two calls into Rerun
_SETTLE = 10.0  # s after its end, for what is shown only once nothing better came
_SAY_EVERY = 2.0  # s
_ANOTHER_CLOCK = 10_000_000_000  # ns between a stamp and its reception: the stamp is simulated

Say = Callable[[str], None]


@dataclass(frozen=True)
class Shown:
    """What of a recording is shown.

    Attributes:
        robot: its name; "" where the recording has no description.
        messages: how many were taken in.
        seconds: from the first to the last of them.
    """

    robot: str
    messages: int
    seconds: float


class BagFeed:
    """Feeds a view; of each topic, one message that cannot be shown is told."""

    def __init__(
        self,
        names: RobotTopics,
        stream: rr.RecordingStream,
        view: ViewConfig,
        blueprint: Path | None,
        frame_prefix: str,
        warn: Say,
    ) -> None:
        """Open the view.

        Args:
            names: the topics that show the robot.
            stream: where to log.
            view: how to look at it.
            blueprint: a .rbl file whose layout takes the place of the view's.
            frame_prefix: put before link names to get their frames.
            warn: told what cannot be shown.
        """
        self._names = names
        self._of_view = names.of_view(view)
        self._warn = warn
        self._now = 0  # ns
        self._shift = 0  # ns, from the time of reception to that of the stamps
        self._left_out: dict[str, int] = {}  # messages by topic
        self._live = LiveView(
            stream,
            view,
            blueprint=blueprint,
            frame_prefix=frame_prefix,
            clock=lambda: self._now / 1e9,
        )

    def run(self, bag: Bag, progress: Say) -> Shown:
        """Show all of ``bag``; ``progress`` is told how far it is, if it takes over two seconds."""
        count, start, last_tick = 0, None, 0
        next_word = time.monotonic() + _SAY_EVERY
        for message in bag.messages([*self._names.shown, *self._of_view]):
            self._now = max(self._now, message.time)
            start = message.time if start is None else start
            count += self._take_safely(message)
            if self._now - last_tick >= _TICK:
                last_tick = self._now
                self._tick()
                if time.monotonic() >= next_word:
                    next_word = time.monotonic() + _SAY_EVERY
                    part = f" of {bag.count}" if bag.count else ""
                    progress(f"loading {bag.source}: message {count}{part}")
        seconds = (self._now - start) / 1e9 if start is not None else 0.0
        self._tick()
        self._now += int(_SETTLE * 1e9)
        self._tick()
        self._live.finish(self._stamp(0))
        for topic, number in self._left_out.items():
            if number > 1:
                self._warn(f"{number} messages of {topic} were left out")
        robot = self._live.robot
        return Shown(robot.name if robot is not None else "", count, seconds)

    def _tick(self) -> None:
        sentences = self._live.tick(self._stamp(0))
        if self._live.robot is not None:  # else it asks for a description that will not come
            for sentence in sentences:
                self._warn(sentence)

    def _take_safely(self, message: BagMessage) -> bool:
        """Take a message in; whether that could be done. Of each topic, one failure is told."""
        try:
            self._take(message)
        except (OneBotError, *BAD_MESSAGE) as error:
            number = self._left_out.get(message.topic, 0)
            self._left_out[message.topic] = number + 1
            if not number:
                self._warn(f"a message of {message.topic} is left out: {error}")
            return False
        return True

    def _take(self, message: BagMessage) -> None:
        topic, data = message.topic, message.data
        if message.type == TF:
            transforms = tf_arrays(data)
            if topic == "/tf" and len(transforms.stamps_ns):
                self._stamp(int(transforms.stamps_ns[-1]))
            self._live.add_transforms(transforms, static=topic == "/tf_static")
        elif topic in self._names.descriptions:
            for problem in self._live.set_description(text_of(message)):
                self._warn(problem)
        elif topic == self._names.joints:
            state = joint_state_arrays(data)
            stamp = self._stamp(state.stamp_ns)
            self._live.add_joints(stamp, state.names, state.positions, state.velocities)
        elif message.type == _ODOMETRY:
            odometry = odometry_sample(data)
            stamp = self._stamp(odometry.stamp_ns)
            self._live.add_odometry(self._of_view[topic], stamp, odometry)
        elif message.type in _TWISTS:
            twist = _TWISTS[message.type](data)
            self._live.add_command(self._of_view[topic], self._stamp(twist.stamp_ns), twist)

    def _stamp(self, stamp: int) -> int:
        """Return ``stamp``, or in the place of zero when it came, ns.

        Messages without a stamp belong to the others' time, which is simulated where those were
        stamped at quite another time than they were received.
        """
        if not stamp:
            return self._now + self._shift
        shift = stamp - self._now
        self._shift = shift if abs(shift) > _ANOTHER_CLOCK else 0
        return stamp
