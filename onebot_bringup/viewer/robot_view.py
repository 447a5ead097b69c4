"""Displays one robot from its incoming messages, live or recorded, in a Rerun recording."""

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import rerun as rr
from std_msgs.msg import String

from onebot_bringup.viewer.blueprint import BlueprintSender, Layout
from onebot_bringup.viewer.displays import DISPLAYS
from onebot_bringup.viewer.displays.display import (
    OTHER_CLOCK_NS,
    WARN_AFTER,
    Context,
    Display,
    MessageType,
    WantedTopic,
    one_by_one,
)
from onebot_bringup.viewer.displays.tf import TransformStream
from onebot_bringup.viewer.frames import FrameResolution, FrameTree
from onebot_bringup.viewer.scene import Scene
from onebot_bringup.viewer.view_config import ViewConfig
from onebot_description.description import Description, parse_description
from onebot_description.errors import OneBotError, did_you_mean
from onebot_description.wire.cdr import SYSTEM_TIME_NS
from onebot_description.wire.messages import deserialize_message

DESCRIPTION: MessageType[str] = MessageType(
    "std_msgs/msg/String",
    one_by_one(lambda data: str(deserialize_message(data, String).data)),
    lambda _: 0,
)
_DESCRIPTION_TOPIC = WantedTopic("robot_description", (DESCRIPTION,), latched=True)
# How long the view waits for every link's frame before it is laid out without them (seconds).
_PATIENCE = 1.0
_MOST_WARNINGS = 100  # of one description
_LONGEST_WARNING = 1000  # characters

ReportBad = Callable[[str, Exception], object]


class RobotView:
    """Everything between the topics and the recording; it waits for nothing and never blocks."""

    def __init__(
        self,
        recording: rr.RecordingStream,
        view: ViewConfig | None = None,
        *,
        blueprint: Path | None = None,
        frame_prefix: str = "",
        resolve: Callable[[str], str] = str,
        clock: Callable[[], float] = time.monotonic,
        report: ReportBad | None = None,
        from_start: bool = False,
        plots: bool = True,
    ) -> None:
        """Show a robot in ``recording``.

        Args:
            recording: where to log.
            view: what is shown, and how.
            blueprint: a ``.rbl`` file, saved in the viewer, that replaces ours.
            frame_prefix: put before link names to get their frames.
            resolve: returns the full name of a topic that the view names.
            clock: seconds.
            report: called with the topic and the error of a bad message; by default it is raised.
            from_start: the viewer plays from the beginning, in place of following the end.
            plots: show those of the view beside the robot; of a single moment they are empty.

        Raises:
            OneBotError: two displays want a topic, each as another type.
        """
        self._recording = recording
        self._view = view or ViewConfig()
        self._resolve = resolve
        self._clock = clock
        self._report = report or _raise
        self._changed = clock()  # when the robot or the view did
        self._warnings = WarningFilter(clock)
        self._stamps = Stamps()
        self.frames = FrameTree()
        self._transforms = TransformStream(recording, self.frames)
        self._context = Context(
            recording,
            self.frames,
            self._transforms,
            lambda: self.fixed_frame,
            frame_prefix,
            clock,
        )
        self._scene = Scene(recording, frame_prefix)
        self._resolution = FrameResolution(self.frames, self._context.frame_of)
        self._blueprint = BlueprintSender(self._context, self._scene, from_start=from_start)
        self._own_blueprint = True
        self._plots = plots
        self._displays = [_Shown(display(self._context)) for display in DISPLAYS]
        for shown in self._displays:
            shown.display.apply(self._view.of(type(shown.display)))
        self._queues: dict[tuple[str, str], _Queue] = {}
        problems = self._make_queues()
        if problems:
            raise OneBotError("; ".join(problems))
        if blueprint is not None:
            self.use_blueprint(blueprint)

    # --- messages -------------------------------------------------------------------------------

    @property
    def topics(self) -> dict[str, WantedTopic]:
        """What to subscribe now, by full names; another view may want others."""
        return self._topics

    def wants(self, topic: str, type_name: str) -> bool:
        """Whether messages of a topic (its full name) of this type are shown."""
        return (topic, type_name) in self._queues

    def take(self, topic: str, type_name: str, data: bytes, time_ns: int) -> None:
        """Take a message; it is decoded and shown by a ``tick`` that follows.

        Args:
            topic: its full name; what no display wants is ignored.
            type_name: as ROS has it, such as "nav_msgs/msg/Odometry".
            data: the serialized message.
            time_ns: when it was received, nanoseconds.
        """
        queue = self._queues.get((topic, type_name))
        if queue is not None:
            queue.messages.append(data)
            queue.times.append(time_ns)

    def tick(self, now_ns: int) -> list[str]:
        """Log what was taken and set the view up; call it some 20 times a second.

        Args:
            now_ns: the time, nanoseconds.

        Returns:
            What the user should know now, a sentence each.
        """
        warnings = self._update(now_ns)
        if self.robot is None:
            return self._warnings.waiting()
        wanted = self._view.fixed_frame
        self._lay_out(complete=self._resolution.is_complete(self.robot, wanted))
        late = [self._stamps.warning] if self._stamps.warning else []
        for shown in self._displays:
            late += shown.display.warnings()
        if self._clock() - self._changed >= WARN_AFTER:
            late += self._resolution.warnings(self.robot, wanted)
        return warnings + self._warnings.once(late)

    def finish(self) -> list[str]:
        """Log all that is still kept back, before the recording is closed."""
        warnings = self._update(None)
        self._transforms.flush()  # what the other displays have placed
        return warnings

    def _update(self, now_ns: int | None) -> list[str]:
        """Decode and log what is due; None: everything."""
        warnings = self._update_robot()
        due = [shown for shown in self._displays if shown.is_due(now_ns)]
        self._deliver(due)
        for shown in due:
            shown.display.flush()
        return warnings

    def _deliver(self, due: Sequence["_Shown"]) -> None:
        """Decode the messages of the displays that are due, and pass them on."""
        displays = {id(shown.display) for shown in due}
        for (topic, _), queue in self._queues.items():
            if queue.messages and any(id(display) in displays for display, *_ in queue.takers):
                messages, times = queue.empty()
                decoded: dict[int, list[tuple[int, Any]]] = {}
                for display, name, kind in queue.takers:
                    if id(kind) not in decoded:
                        decoded[id(kind)] = self._decoded(topic, kind, messages, times)
                    display.add(name, kind, decoded[id(kind)])

    def _decoded(
        self, topic: str, kind: MessageType[Any], messages: Sequence[bytes], times: Sequence[int]
    ) -> list[tuple[int, Any]]:
        found = kind.decode(messages, lambda error: self._report(topic, error))
        return [
            (self._stamps.display_time(kind.stamp_ns(message), time_ns, live=kind.live), message)
            for message, time_ns in zip(found, times, strict=True)
            if message is not None
        ]

    def _make_queues(self) -> list[str]:
        """Make a queue for each topic and type that a display takes; keep what waits in others.

        Returns:
            What cannot be subscribed, a sentence each.
        """
        queues: dict[tuple[str, str], _Queue] = {}
        topics: dict[str, WantedTopic] = {}
        problems = []
        for display, topic in self._wanted():
            name = self._resolve(topic.name)
            try:
                topics[name] = _merged(replace(topic, name=name), topics.get(name))
            except ValueError as error:
                if not topic.optional:
                    problems.append(str(error))
                continue
            for kind in topic.types:
                queue = queues.setdefault((name, kind.name), _Queue())
                if display is not None:
                    queue.takers.append((display, topic.name, kind))
        for key, before in self._queues.items():
            if key in queues:
                queues[key].messages, queues[key].times = before.empty()
        self._queues, self._topics = queues, topics
        return problems

    def _wanted(self) -> Iterable[tuple[Display[Any] | None, WantedTopic]]:
        yield None, _DESCRIPTION_TOPIC
        for shown in self._displays:
            for topic in shown.display.topics():
                yield shown.display, topic

    # --- the robot and the view -----------------------------------------------------------------

    @property
    def robot(self) -> Description | None:
        """The robot shown now."""
        return self._context.robot

    @property
    def fixed_frame(self) -> str:
        """The frame everything is shown in; "" before there is any.

        The view's, also with the frame_prefix before it; while no such frame is known, the one
        above the robot's root link.
        """
        if self.robot is None:
            return self._view.fixed_frame
        return self._resolution.fixed_frame(self.robot, self._view.fixed_frame)

    @property
    def missing(self) -> list[str]:
        """The frames of links that no transform connects with the fixed frame."""
        if self.robot is None:
            return []
        return self._resolution.missing(self.robot, self.fixed_frame)

    @property
    def has_fixed_frame(self) -> bool:
        """The frame that the view names, if any, is known."""
        wanted = self._view.fixed_frame
        return not wanted or (
            self.robot is not None and bool(self._resolution.known_as(self.robot, wanted))
        )

    def set_view(self, view: ViewConfig) -> list[str]:
        """Show other things, or the same in another way.

        Returns:
            What in it does not fit the robot or the other topics, a sentence each.
        """
        self._deliver(self._displays)
        for shown in self._displays:
            kind = type(shown.display)
            if view.of(kind) != self._view.of(kind):
                shown.display.flush()
                shown.display.apply(view.of(kind))
        self._view = view
        problems = self._make_queues()
        self._warnings.forget()
        self._changed = self._clock()
        return problems + self._wrong_names()

    def use_blueprint(self, blueprint: Path | None) -> None:
        """Arrange the viewer as a ``.rbl`` file that was saved in it; None: as the view has it."""
        self._own_blueprint = blueprint is None
        if blueprint is None:
            self._blueprint.forget()
        else:
            self._recording.log_file_from_path(blueprint)

    def _update_robot(self) -> list[str]:
        """Show the robot of the descriptions that have come, each in place of the one before."""
        name = self._resolve(_DESCRIPTION_TOPIC.name)
        messages, times = self._queues[name, DESCRIPTION.name].empty()
        warnings = []
        for _, urdf in self._decoded(name, DESCRIPTION, messages, times):
            try:
                warnings += self._set_robot(urdf)
            except OneBotError as error:
                self._report(name, error)
        return warnings

    def _set_robot(self, urdf: str) -> list[str]:
        robot, before = parse_description(urdf, _DESCRIPTION_TOPIC.name), self.robot
        warnings = self._scene.set_robot(robot)
        self._context.robot = robot
        for shown in self._displays:
            shown.display.set_robot()
        if before is None or robot.robot_name != before.robot_name:
            self._recording.send_recording_name(robot.robot_name)
        self._changed = self._clock()
        self._warnings.forget()
        return warnings + self._wrong_names()

    def _wrong_names(self) -> list[str]:
        follow = self._view.camera.follow
        if self.robot is None or not follow or follow in self.robot.link_names:
            return []
        known = did_you_mean(follow, self.robot.link_names, "links")
        return [f'camera.follow: the robot has no link "{follow}"{known}']

    def _lay_out(self, complete: bool) -> None:
        """Send the blueprint once all frames are known, or do not come."""
        if complete or self._clock() - self._changed >= _PATIENCE:
            displays = [shown.display for shown in self._displays]
            layout = Layout.of(self._view, displays, self.fixed_frame, complete)
            if not self._plots:
                layout = layout.without_plots()
            self._blueprint.update(layout, send=self._own_blueprint)


@dataclass
class _Queue:
    """Messages of one topic and type that wait to be decoded, and who takes them."""

    messages: list[bytes] = field(default_factory=list)
    times: list[int] = field(default_factory=list)
    # A display, the topic as it names it, and how it wants messages decoded.
    takers: list[tuple[Display[Any], str, MessageType[Any]]] = field(default_factory=list)

    def empty(self) -> tuple[list[bytes], list[int]]:
        """Return the messages and when each was received, and keep none."""
        found = self.messages, self.times
        self.messages, self.times = [], []
        return found


@dataclass
class _Shown:
    """A display, and when it was flushed last."""

    display: Display[Any]
    flushed_ns: int | None = None

    def is_due(self, now_ns: int | None) -> bool:
        """Whether it is time to flush it, which is noted; at None it always is."""
        last, period = self.flushed_ns, self.display.period_ns
        if now_ns is not None and last is not None and abs(now_ns - last) < period:
            return False
        self.flushed_ns = now_ns
        return True


class Stamps:
    """Chooses the time at which a message is shown: its stamp, or without one the receive time.

    Messages without a stamp get the receive time, shifted to simulated time if the other stamps
    differ from it by more than 10 s. So do those from the future: one that is shown years ahead
    would hold there the viewer that follows the latest.
    """

    def __init__(self) -> None:
        """Begin without a shift."""
        self._shift = 0  # ns, from the receive time to the time of the stamps
        self.warning = ""  # that a stamp was of the future

    def display_time(self, stamp_ns: int, time_ns: int, *, live: bool = True) -> int:
        """Return the time, nanoseconds.

        Args:
            stamp_ns: of the header; 0 for none.
            time_ns: when it was received.
            live: the stamp is the time when it was sent.
        """
        if SYSTEM_TIME_NS < time_ns < stamp_ns - OTHER_CLOCK_NS:
            ahead = f"{(stamp_ns - time_ns) * 1e-9:.0f} s ahead of their receive time"
            self.warning = self.warning or f"stamps {ahead} are ignored: is a clock wrong?"
            stamp_ns = 0
        if not stamp_ns:
            return time_ns + self._shift
        if live:
            shift = stamp_ns - time_ns
            self._shift = shift if abs(shift) > OTHER_CLOCK_NS else 0
        return stamp_ns


class WarningFilter:
    """Passes each warning once per description; warns now and then while there is none."""

    def __init__(self, clock: Callable[[], float]) -> None:
        """Count from now, in the seconds of ``clock``."""
        self._clock = clock
        self._started = clock()
        self._passed: set[str] = set()
        self._next_hint = 2.0

    def forget(self) -> None:
        """Pass everything again where it is still true."""
        self._passed.clear()

    def once(self, sentences: Iterable[str]) -> list[str]:
        """Return those of ``sentences`` not passed so far, cut if long, and none after very many.

        They may name what others publish.
        """
        short = (sentence[:_LONGEST_WARNING] for sentence in sentences)
        new = [sentence for sentence in short if sentence not in self._passed]
        new = new[: _MOST_WARNINGS - len(self._passed)]
        self._passed.update(new)
        return new

    def waiting(self) -> list[str]:
        """Return, from time to time, that the description is waited for."""
        waited = self._clock() - self._started
        if waited < self._next_hint:
            return []
        self._next_hint = max(10.0, 2 * self._next_hint)
        return [
            f"waiting for the robot's description on robot_description ({waited:.0f} s); "
            "it comes from robot_state_publisher"
        ]


def _merged(topic: WantedTopic, other: WantedTopic | None) -> WantedTopic:
    """Return one subscription for two displays, of the types that both take.

    Raises:
        ValueError: there is no such type.
    """
    if other is None:
        return topic
    names = [kind.name for kind in topic.types]
    both = tuple(kind for kind in other.types if kind.name in names)
    if not both:
        raise ValueError(
            f'the view\'s topic "{topic.name}" cannot be subscribed as {" or ".join(names)}: '
            f"something else is shown of it, as {other.types[0].name}"
        )
    reliable, latched = topic.reliable or other.reliable, topic.latched or other.latched
    optional = topic.optional and other.optional
    return WantedTopic(topic.name, both, reliable, latched, optional)


def _raise(_: str, error: Exception) -> None:
    raise error
