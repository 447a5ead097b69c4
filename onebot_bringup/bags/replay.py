"""Shows a recording in Rerun as the live viewer would have shown it, all of its time at once."""

import time
from collections.abc import Callable, Collection, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any, cast

import rerun as rr
import rerun.blueprint as rrb
from std_msgs.msg import String

from onebot_bringup.bags.reader import Bag, BagMessage
from onebot_bringup.viewer.displays.tf import TIMELINE
from onebot_bringup.viewer.robot_view import LiveView
from onebot_bringup.viewer.topics import wanted_topics
from onebot_bringup.viewer.view_config import ViewConfig, load_view, view_for
from onebot_description.description import Description, read_description
from onebot_description.errors import OneBotError, did_you_mean, listing
from onebot_description.wire.messages import (
    BAD_MESSAGE,
    deserialize_message,
    odometry_sample,
    one_joint_state,
    tf_arrays,
    twist_sample,
    twist_stamped_sample,
)

# Which robot a recording shows: its topics, its namespace, its description and its frames.

TF, STRING, JOINTS = (
    "tf2_msgs/msg/TFMessage",
    "std_msgs/msg/String",
    "sensor_msgs/msg/JointState",
)
DESCRIPTION = "robot_description"
_FIRST = 1000  # messages of /tf in which every robot has turned up


class RobotTopics:
    """Which topics of a recording show the robot, and its namespace.

    Attributes:
        space: the robot's namespace, "" or "/name".
        spaces: of every robot that is described.
        descriptions: topics of its description.
        joints: topic of its joint states.
        tf: topics of transforms.
        shown: all of these that are recorded.
    """

    def __init__(self, bag: Bag, namespace: str = "") -> None:
        """Choose the robot in ``namespace``, or the first one.

        Raises:
            OneBotError: there is none.
        """
        self._types = bag.topics
        self.descriptions = sorted(
            (topic for topic, kind in bag.topics.items() if _is(topic, DESCRIPTION, kind, STRING)),
            key=lambda topic: (topic.count("/"), topic),
        )
        joints = [t for t, kind in bag.topics.items() if _is(t, "joint_states", kind, JOINTS)]
        self.spaces = [_space(topic) for topic in self.descriptions]
        self.space = self.spaces[0] if self.spaces else ""
        if namespace:
            self.space = f"/{namespace.strip('/')}".rstrip("/")
            known = [*self.spaces, *map(_space, joints)]
            if self.space not in known:
                there = did_you_mean(namespace, {space or "/" for space in known}, "robots")
                raise OneBotError(f"namespace:={namespace}: {bag.source} has no robot there{there}")
            self.descriptions = [t for t in self.descriptions if _space(t) == self.space]
        self.joints = self.resolved("joint_states")
        if not self.descriptions and not namespace and joints and self.joints not in joints:
            self.joints = joints[0]
        self.tf = [t for t in ("/tf", "/tf_static") if bag.topics.get(t) == TF]
        joints = [self.joints] if self.joints in joints else []
        self.shown = [*self.tf, *self.descriptions[:1], *joints]

    def resolved(self, name: str) -> str:
        """Return the full name of a topic that the view names."""
        return name if name.startswith("/") else f"{self.space}/{name}"

    def of_view(self, view: ViewConfig) -> Mapping[str, str]:
        """Return the recorded topics that ``view`` asks for, and how it names them."""
        wanted = {self.resolved(name): name for name in wanted_topics(view)}
        return {full: name for full, name in wanted.items() if full in self._types}


def robot_of(bag: Bag, names: RobotTopics) -> Description | None:
    """Return the robot by its first description, if that can be read."""
    for message in bag.messages(names.descriptions[:1]):
        with suppress(OneBotError, ValueError):  # it is complained of when it is shown
            return read_description(text_of(message), DESCRIPTION)
    return None


def frames_of(bag: Bag, names: RobotTopics) -> set[str]:
    """Return the frames that are named at the beginning."""
    frames: set[str] = set()
    for message in islice(bag.messages(names.tf), _FIRST):
        with suppress(ValueError, IndexError):
            transforms = tf_arrays(message.data)
            frames.update(transforms.parents, transforms.children)
    return frames


def text_of(message: BagMessage) -> str:
    """Return the text of a String.

    Raises:
        ValueError: it is none.
    """
    return str(deserialize_message(message.data, String).data)


def _space(topic: str) -> str:
    return topic.rpartition("/")[0]


def _is(topic: str, name: str, kind: str, wanted: str) -> bool:
    return kind == wanted and topic.rpartition("/")[2] == name


# Feeds the messages of a recording to a view, whose clock is the recording's.

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
        return Shown(robot.robot_name if robot is not None else "", count, seconds)

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
            state = one_joint_state(data)
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


# Finds out which frame_prefix a robot was recorded with.


def frame_prefix_of(
    root: str, links: Collection[str], frames: Collection[str], namespace: str
) -> str:
    """Return what stands before the links' names in ``frames``.

    Args:
        root: the root link.
        links: all links, the root among them.
        frames: those that were recorded, of other robots too.
        namespace: the robot's; of several robots' prefixes that fit as well, the one named like it
            is taken.

    Returns:
        The prefix; "" where there is none, or no frame of the root link.
    """
    known = set(frames)
    found = {frame[: len(frame) - len(root)] for frame in known if frame.endswith(root)}

    def fit(prefix: str) -> tuple[int, bool, bool, int, str]:
        links_known = sum(prefix + link in known for link in links)
        named_so = prefix.strip("/_") == namespace.strip("/")
        return links_known, named_so, not prefix, -len(prefix), prefix

    return max(found, key=fit, default="")


def log_bag(
    bag: Bag,
    stream: rr.RecordingStream,
    *,
    view: Path | None = None,
    fixed_frame: str = "",
    frame_prefix: str = "",
    namespace: str = "",
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
        frame_prefix: put before link names to get their frames; "" to find it out.
        namespace: of the robot to show; "" for the first.
        from_start: the viewer plays it from its beginning; False: it shows its end.
        progress: told how far it is when that takes over two seconds.
        warn: told what cannot be shown, and of damage.

    Raises:
        OneBotError: there is nothing to show in it or in the namespace, or the view is wrong.
    """
    names = RobotTopics(bag, namespace)
    if not names.shown:
        raise OneBotError(
            f"{bag.source} holds nothing of a robot: no description, transforms or joint states "
            f"(topics: {listing(bag.topics)})"
        )
    if len(names.spaces) > 1 and not namespace:
        there = listing([space or "/" for space in names.spaces])
        warn(
            f"several robots are recorded, in {there}: showing that in {names.space or '/'} "
            "(namespace:= chooses)"
        )
    elif not names.descriptions:
        warn(f"{bag.source} holds no {DESCRIPTION}: showing the frames without the robot")
    robot = robot_of(bag, names)
    view = view or (view_for(robot.robot_name) if robot is not None else None)
    if robot is not None and not frame_prefix:
        frames = frames_of(bag, names)
        frame_prefix = frame_prefix_of(robot.root_link, robot.link_names, frames, names.space)
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
    shown = BagFeed(names, played, config, blueprint, frame_prefix, warn).run(bag, progress)
    for sentence in bag.warnings[told:]:
        warn(sentence)
    if not shown.messages:
        raise OneBotError(f"nothing of {bag.source} can be shown")
    return shown


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
