"""Shows a recording in Rerun as the live viewer would have shown it, all of its time at once."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

import rerun as rr
import rerun.blueprint as rrb
from rclpy.serialization import deserialize_message
from std_msgs.msg import String

from onebot_bringup.bag.messages import BagMessage
from onebot_bringup.bag.reader import Bag
from onebot_bringup.raw_messages import (
    joint_state_arrays,
    odometry_sample,
    tf_arrays,
    twist_sample,
    twist_stamped_sample,
)
from onebot_bringup.rerun_topics import wanted_topics
from onebot_bringup.viewer.live_view import LiveView
from onebot_bringup.viewer.streams import TIMELINE
from onebot_bringup.viewer.view_config import ViewConfig, load_view
from onebot_bringup.viewer.view_files import view_for
from onebot_description.description import parse_description
from onebot_description.errors import OneBotError
from onebot_description.text import listing

_TF, _STRING, _JOINTS = (
    "tf2_msgs/msg/TFMessage",
    "std_msgs/msg/String",
    "sensor_msgs/msg/JointState",
)
_ODOMETRY = "nav_msgs/msg/Odometry"
_TWISTS = {
    "geometry_msgs/msg/Twist": twist_sample,
    "geometry_msgs/msg/TwistStamped": twist_stamped_sample,
}
_DESCRIPTION = "robot_description"
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


def log_bag(
    bag: Bag,
    stream: rr.RecordingStream,
    *,
    view: Path | None = None,
    fixed_frame: str = "",
    from_start: bool = True,
    progress: Say = print,
    warn: Say = print,
) -> Shown:
    """Log all that ``bag`` holds of a robot.

    Args:
        bag: the recording.
        stream: where to log.
        view: how to look at it, a .yaml or .rbl file; None for the view of the robot's
            description, if that is installed.
        fixed_frame: the frame to show everything in; "" for the view's.
        from_start: the viewer plays it from its beginning; False: it shows its end.
        progress: told how far it is when that takes over two seconds.
        warn: told what cannot be shown, and of damage.

    Raises:
        OneBotError: there is nothing to show in it, or the view is wrong.
    """
    names = _Names(bag)
    if not names.shown:
        raise OneBotError(
            f"{bag.source} holds nothing of a robot: no description, transforms or joint states "
            f"(topics: {listing(bag.topics)})"
        )
    if len(names.descriptions) > 1:
        warn(f"several robots are recorded; showing that of {names.descriptions[0]}")
    elif not names.descriptions:
        warn(f"{bag.source} holds no {_DESCRIPTION}: showing the frames without the robot")
    view = view or _own_view(bag, names)
    config, blueprint = ViewConfig(), None
    if view is not None and view.suffix == ".rbl":
        blueprint = view
    elif view is not None:
        config = load_view(view)
    if fixed_frame:
        config = replace(config, fixed_frame=fixed_frame)
    for sentence in bag.warnings:
        warn(sentence)
    told = len(bag.warnings)
    played = cast(rr.RecordingStream, _Played(stream)) if from_start else stream
    shown = _Replay(names, played, config, blueprint, warn).run(bag, progress)
    for sentence in bag.warnings[told:]:
        warn(sentence)
    return shown


def _own_view(bag: Bag, names: "_Names") -> Path | None:
    for message in bag.messages(names.descriptions[:1]):
        try:
            return view_for(parse_description(_text(message)).robot_name)
        except OneBotError:
            return None  # it is complained of when it is shown
    return None


def _text(message: BagMessage) -> str:
    return str(deserialize_message(message.data, String).data)


class _Names:
    """Which topics of a recording show the robot, and its namespace."""

    def __init__(self, bag: Bag) -> None:
        self._types = bag.topics
        self.descriptions = sorted(
            (
                topic
                for topic, kind in bag.topics.items()
                if _is(topic, _DESCRIPTION, kind, _STRING)
            ),
            key=lambda topic: (topic.count("/"), topic),
        )
        joints = [t for t, kind in bag.topics.items() if _is(t, "joint_states", kind, _JOINTS)]
        self.space = self.descriptions[0].rpartition("/")[0] if self.descriptions else ""
        self.joints = self.resolved("joint_states")
        if not self.descriptions and joints and self.joints not in joints:
            self.joints = joints[0]
        tf = [t for t in ("/tf", "/tf_static") if bag.topics.get(t) == _TF]
        joints = [self.joints] if self.joints in joints else []
        self.shown = [*tf, *self.descriptions[:1], *joints]

    def resolved(self, name: str) -> str:
        """The full name of a topic that the view names."""
        return name if name.startswith("/") else f"{self.space}/{name}"

    def of_view(self, view: ViewConfig) -> Mapping[str, str]:
        """The recorded topics that ``view`` asks for, and how it names them."""
        wanted = {self.resolved(name): name for name in wanted_topics(view)}
        return {full: name for full, name in wanted.items() if full in self._types}


def _is(topic: str, name: str, kind: str, wanted: str) -> bool:
    return kind == wanted and topic.rpartition("/")[2] == name


class _Replay:
    """Feeds messages to a view whose clock is the recording's."""

    def __init__(
        self,
        names: _Names,
        stream: rr.RecordingStream,
        view: ViewConfig,
        blueprint: Path | None,
        warn: Say,
    ) -> None:
        self._names = names
        self._of_view = names.of_view(view)
        self._warn = warn
        self._now = 0  # ns
        self._shift = 0  # ns, from the time of reception to that of the stamps
        self._live = LiveView(stream, view, blueprint=blueprint, clock=lambda: self._now / 1e9)

    def run(self, bag: Bag, progress: Say) -> Shown:
        count, start, last_tick = 0, None, 0
        next_word = time.monotonic() + _SAY_EVERY
        for message in bag.messages([*self._names.shown, *self._of_view]):
            self._now = max(self._now, message.time)
            start = message.time if start is None else start
            self._take_safely(message)
            count += 1
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
        robot = self._live.robot
        return Shown(robot.name if robot is not None else "", count, seconds)

    def _tick(self) -> None:
        sentences = self._live.tick(self._stamp(0))
        if self._live.robot is not None:  # else it asks for a description that will not come
            for sentence in sentences:
                self._warn(sentence)

    def _take_safely(self, message: BagMessage) -> None:
        try:
            self._take(message)
        except (OneBotError, ValueError, IndexError) as error:
            self._warn(f"a message of {message.topic} is left out: {error}")

    def _take(self, message: BagMessage) -> None:
        topic, data = message.topic, message.data
        if message.type == _TF:
            transforms = tf_arrays(data)
            if topic == "/tf" and len(transforms.stamps_ns):
                self._stamp(int(transforms.stamps_ns[-1]))
            self._live.add_transforms(transforms, static=topic == "/tf_static")
        elif topic in self._names.descriptions:
            for problem in self._live.set_description(_text(message)):
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


class _Played:
    """A recording whose layouts play it from its beginning, in the place of following its end."""

    def __init__(self, stream: rr.RecordingStream) -> None:
        self._stream = stream

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def send_blueprint(self, blueprint: rrb.Blueprint, **options: bool) -> None:
        blueprint.time_panel = rrb.TimePanel(
            state="collapsed", timeline=TIMELINE, play_state="playing"
        )
        self._stream.send_blueprint(blueprint, **options)
