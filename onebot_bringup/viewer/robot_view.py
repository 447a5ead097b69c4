"""Displays robots from their incoming messages, live or recorded, in a Rerun recording."""

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import rerun as rr
from std_msgs.msg import String

from onebot_bringup.introspection.interfaces import full_definition
from onebot_bringup.viewer.automatic import (
    MESSAGE_DISPLAYS,
    LoadLimit,
    OfferedTopic,
    TopicSelection,
)
from onebot_bringup.viewer.blueprint import BlueprintSender, Layout
from onebot_bringup.viewer.displays import DISPLAYS
from onebot_bringup.viewer.displays.display import (
    OTHER_CLOCK_NS,
    SELDOM,
    WARN_AFTER,
    Context,
    Display,
    MessageType,
    WantedTopic,
    one_by_one,
)
from onebot_bringup.viewer.displays.message_display import MessageDisplay
from onebot_bringup.viewer.displays.tf import TF, TransformStream
from onebot_bringup.viewer.frames import FrameTree
from onebot_bringup.viewer.robot_size import robot_size
from onebot_bringup.viewer.shown_robot import RobotToShow, ShownRobot
from onebot_bringup.viewer.view_config import ViewConfig
from onebot_description.description import Description
from onebot_description.errors import OneBotError, did_you_mean, listing
from onebot_description.wire.cdr import SYSTEM_TIME_NS
from onebot_description.wire.messages import deserialize_message

DESCRIPTION: MessageType[str] = MessageType(
    "std_msgs/msg/String",
    one_by_one(lambda data: str(deserialize_message(data, String).data)),
    lambda _: 0,
)
# How long the view waits for every link's frame before it is laid out without them (seconds).
_PATIENCE = 1.0
_MOST_WARNINGS = 100  # of one description
_LONGEST_WARNING = 1000  # characters
_LISTED = 5  # names of robots

WORLD_DESCRIPTION = "/world_description"
_WORLD = RobotToShow(description=WORLD_DESCRIPTION)  # what stands around the robots

ReportBad = Callable[[str, Exception], object]


class RobotView:
    """Everything between the topics and the recording; it waits for nothing and never blocks."""

    def __init__(
        self,
        recording: rr.RecordingStream,
        view: ViewConfig | None = None,
        *,
        blueprint: Path | None = None,
        robots: Sequence[RobotToShow] = (RobotToShow(),),
        resolve: Callable[[str], str] = str,
        clock: Callable[[], float] = time.monotonic,
        report: ReportBad | None = None,
        from_start: bool = False,
        plots: bool = True,
        definitions: Callable[[str], str] = full_definition,
        live: bool = False,
    ) -> None:
        """Show one robot or several in ``recording``.

        Args:
            recording: where to log.
            view: what is shown, and how.
            blueprint: a ``.rbl`` file, saved in the viewer, that replaces ours.
            robots: those to show; of several each has its entities below its namespace.
            resolve: returns the full name of a topic that the view names.
            clock: seconds.
            report: called with the topic and the error of a bad message; by default it is raised.
            from_start: the viewer plays from the beginning, in place of following the end.
            plots: show those of the view beside the robot; of a single moment they are empty.
            definitions: returns the definition of a message type that is offered; raises
                OneBotError.
            live: messages come as they are published: of a flood, old ones are dropped, and a
                description may still come.

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
        self._now_ns = 0  # on the timeline
        self._definitions = definitions
        self._live = live
        self._published: Mapping[str, str] = {}
        self._laid_out_ns = 0
        self._laid_out_of: tuple[object, ...] = ()
        self._selection = TopicSelection(resolve)
        self.frames = FrameTree()
        self._transforms = TransformStream(recording, self.frames)
        self._alone = len(robots) == 1
        self._robots = [self._shown(one) for one in robots]
        self._world = ShownRobot(_WORLD, self._context(_WORLD, "world"), ())
        contexts = [shown.context for shown in self._robots]
        self._whole = whole = self._context(RobotToShow(), "")
        self._of_all = [
            display(whole, *contexts) if issubclass(display, MessageDisplay) else display(*contexts)
            for display in DISPLAYS
            if display.of_all
        ]
        self._blueprint = BlueprintSender(recording, self._robots, from_start=from_start)
        self._own_blueprint = True
        self._plots = plots
        displays = [*self._of_all, *(each for shown in self._robots for each in shown.displays)]
        self._displays = [
            _Shown(display, LoadLimit() if live and isinstance(display, MessageDisplay) else None)
            for display in displays
        ]
        self._of_messages = [each for each in displays if isinstance(each, MessageDisplay)]
        self._limits = {id(each.display): each.limit for each in self._displays if each.limit}
        for display in displays:
            display.apply(self._view.of(type(display)))
        self._queues: dict[tuple[str, str], _Queue] = {}
        problems = self._make_queues()
        if problems:
            raise OneBotError("; ".join(problems))
        if blueprint is not None:
            self.use_blueprint(blueprint)

    def _shown(self, robot: RobotToShow) -> ShownRobot:
        displays = [
            display
            for display in DISPLAYS
            if not display.of_all and (robot.plotted or not display.plots)
        ]
        return ShownRobot(
            robot, self._context(robot, "" if self._alone else robot.entity), displays
        )

    def _context(self, names: RobotToShow, root: str) -> Context:
        return Context(
            self._recording,
            self.frames,
            self._transforms,
            lambda: self.fixed_frame,
            names.frame_prefix,
            self._clock,
            root,
            self._definitions,
            lambda topic: self._full_name(names, topic),
            lambda: self._now_ns,
        )

    # --- messages -------------------------------------------------------------------------------

    @property
    def topics(self) -> dict[str, WantedTopic]:
        """What to subscribe now, by full names; another view may want others."""
        return self._topics

    @property
    def offered(self) -> Sequence[OfferedTopic]:
        """The topics that could be shown, by full names, and whether they are."""
        return self._selection.offered

    def offer(self, topics: Mapping[str, str]) -> list[str]:
        """Show of the topics that there are now those that have a display, and are not hidden.

        Args:
            topics: the type of each by its full name.

        Returns:
            What cannot be shown, a sentence each.
        """
        if topics == self._published:
            return []
        self._published = dict(topics)
        return self._select()

    def _select(self) -> list[str]:
        """Pass the topics on that are to be shown; where that changes them, subscribe anew."""
        readable, problems = self._readable()
        drawn = {name for name, display, _ in self._named() if display and not display.plots}
        self._selection.choose(readable, self._view, drawn)
        if self._selection.crowded:
            crowded = listing(self._selection.crowded, _LISTED)
            problems.append(
                f"too many topics to show all: not {crowded}; shown: in a view adds some"
            )
        changed = [
            shown for shown in self._displays if shown.display.offer(self._offered_to(shown))
        ]
        if changed:
            self._deliver(self._displays)
        for shown in changed:
            shown.display.flush()
            shown.display.apply(self._view.of(type(shown.display)))
        return problems + (self._make_queues() if changed else [])

    def _offered_to(self, shown: "_Shown") -> Mapping[str, str]:
        """Return the topics that a display may draw."""
        if isinstance(shown.display, MessageDisplay):
            return self._selection.of(shown.display)
        return self._published

    def _readable(self) -> tuple[dict[str, str], list[str]]:
        """Return the topics whose type has a display, and a definition that can be read."""
        found, bad = {}, {}
        for topic, kind in self._published.items():
            if kind in MESSAGE_DISPLAYS and kind not in bad:
                try:
                    self._of_all[0].context.message_type(kind)
                    found[topic] = kind
                except (OneBotError, ValueError) as error:
                    topics = [name for name, each in self._published.items() if each == kind]
                    bad[kind] = f"{listing(topics, _LISTED)} cannot be shown: {error}"
        return found, list(bad.values())

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
            queue.append(data, time_ns)

    def tick(self, now_ns: int) -> list[str]:
        """Log what was taken and set the view up; call it some 20 times a second.

        Args:
            now_ns: the time, nanoseconds.

        Returns:
            What the user should know now, a sentence each.
        """
        warnings = self._update(now_ns)
        # To see whether the layout is another takes as long as a scan.
        tree, steady_ns = (self.frames.version, self._changed), self._steady_ns(now_ns)
        if tree == self._laid_out_of and 0 < steady_ns - self._laid_out_ns < SELDOM:
            return warnings
        self._laid_out_ns, self._laid_out_of = steady_ns, tree
        if self.robot is None:
            return warnings + self._show_without_robot()
        wanted = self._wanted_frame
        self._lay_out(self._is_complete(wanted))
        late = self._display_warnings()
        if self._clock() - self._changed >= WARN_AFTER:
            late += self._late(wanted)
        return warnings + self._warnings.once(dict.fromkeys(late))

    def _is_complete(self, wanted: str) -> bool:
        """Whether all robots' links are known and placed, in the frame that the view names."""
        return all(shown.is_complete(wanted) for shown in self._robots)

    def _show_without_robot(self) -> list[str]:
        """Lay out what else there is; return what the user should know."""
        fixed, late = self.fixed_frame, self._display_warnings()
        if fixed or any(each.visible for each in self.offered):
            self._lay_out(complete=False)
        wanted = self._view.fixed_frame
        if wanted not in ("", fixed) and self._clock() - self._changed >= WARN_AFTER:
            late.append(self.frames.unknown(wanted, fixed))
        nothing = self._live and not self._frame_without_robot
        hints = self._warnings.waiting() if nothing else []
        return self._warnings.once(dict.fromkeys(late)) + hints

    def _display_warnings(self) -> list[str]:
        late = [*self._stamps.warnings.values()]
        for shown in self._active:
            late += shown.warnings()
        return late

    def _late(self, wanted: str) -> list[str]:
        """Return what has not come in all the time, a sentence each."""
        late = []
        for shown in (*self._robots, self._world):
            if shown.robot is not None:
                late += shown.resolution.warnings(shown.robot, wanted)
        lacking = [str(shown.names) for shown in self._robots if shown.robot is None]
        if lacking:
            late.append(f"no description yet of the robots in {listing(lacking, _LISTED)}")
        return late

    def finish(self) -> list[str]:
        """Log all that is still kept back, before the recording is closed."""
        warnings = self._update(None)
        self._transforms.flush()  # what the other displays have placed
        if self.robot is not None:
            self._lay_out(self._is_complete(self._wanted_frame))
        return warnings

    def _update(self, now_ns: int | None) -> list[str]:
        """Decode and log what is due; None: everything."""
        warnings = self._update_robot()
        if now_ns is not None:
            self._now_ns = self._stamps.display_time(0, now_ns)
            steady_ns = self._steady_ns(now_ns)
            due = [shown for shown in self._active if shown.is_due(now_ns, steady_ns)]
        else:
            self._whole.transform_timeout_ns = 0
            due = self._active
        self._deliver(due)
        for shown in due:
            shown.flush()
        return warnings

    def _steady_ns(self, now_ns: int) -> int:
        """Return a time that goes on while simulated time stands still, nanoseconds."""
        return int(self._clock() * 1e9) if self._live else now_ns

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
                    limit = self._limits.get(id(display))
                    found: Sequence[tuple[int, Any]] = decoded[id(kind)]
                    if limit is not None:
                        found = limit.admit(found, map(len, messages))
                    display.add(name, kind, found)

    def _decoded(
        self, topic: str, kind: MessageType[Any], messages: Sequence[bytes], times: Sequence[int]
    ) -> list[tuple[int, Any]]:
        found = kind.decode(messages, lambda error: self._report(topic, error))
        source = StampSource(topic, kind.live, kind is TF)
        return [
            (self._stamps.display_time(kind.stamp_ns(message), time_ns, source), message)
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
        for name, display, topic in self._wanted():
            try:
                topics[name] = _merged(replace(topic, name=name), topics.get(name))
            except ValueError as error:
                if not topic.optional:
                    problems.append(str(error))
                continue
            for kind in topic.types:
                queue = queues.setdefault((name, kind.name), _Queue())
                # Several items of a display may be of one topic.
                if display is not None and (display, topic.name, kind) not in queue.takers:
                    queue.takers.append((display, topic.name, kind))
        for (name, kind_name), queue in queues.items():
            limits = [self._limits.get(id(display)) for display, *_ in queue.takers]
            if all(limits):
                queue.limits, queue.most = [each for each in limits if each], topics[name].depth
            before = self._queues.get((name, kind_name))
            if before is not None:
                queue.messages, queue.times = before.empty()
        self._queues, self._topics = queues, topics
        # There are many displays, most without a topic.
        self._active = [
            shown
            for shown in self._displays
            if not isinstance(shown.display, MessageDisplay) or shown.display.items
        ]
        return problems

    def _wanted(self) -> Iterable[tuple[str, Display[Any] | None, WantedTopic]]:
        """Yield each topic by its full name, the display that takes it, and how it wants it."""
        yield from self._named()
        for display in self._of_messages:
            for topic in display.topics():
                yield topic.name, display, topic

    def _named(self) -> Iterable[tuple[str, Display[Any] | None, WantedTopic]]:
        """Yield, of the same, the topics that the view names or every robot has."""
        of_all = [each for each in self._of_all if not isinstance(each, MessageDisplay)]
        for number, shown in enumerate(self._robots):
            names = shown.names
            description = WantedTopic(names.description, (DESCRIPTION,), latched=True)
            yield self._full_name(names, description.name), None, description
            displays = shown.displays if number else [*of_all, *shown.displays]
            for display in displays:
                for topic in display.topics():
                    if not number or not topic.name.startswith("/"):  # which is no robot's own
                        yield self._full_name(names, topic.name), display, topic

        world = WantedTopic(_WORLD.description, (DESCRIPTION,), latched=True, optional=True)
        yield self._full_name(_WORLD, world.name), None, world

    def _full_name(self, names: RobotToShow, topic: str) -> str:
        return self._resolve(names.topic(topic))

    # --- the robot and the view -----------------------------------------------------------------

    @property
    def robots(self) -> dict[str, Description]:
        """The robots shown now, by their namespaces."""
        found = ((str(shown.names), shown.robot) for shown in self._robots)
        return {name: robot for name, robot in found if robot is not None}

    @property
    def robot(self) -> Description | None:
        """The robot shown now, or the first of them."""
        return next(iter(self.robots.values()), None)

    @property
    def fixed_frame(self) -> str:
        """The frame everything is shown in; "" before there is any.

        The view's, also with the frame_prefix before it; while no such frame is known, the one
        above the robot's root link, or without a robot above the frames of most messages. That
        one, too, of several robots that each have the view's.
        """
        for shown in self._robots:
            if shown.robot is not None:
                return shown.resolution.fixed_frame(shown.robot, self._wanted_frame)
        wanted = self._view.fixed_frame
        if wanted and (wanted in self.frames.names or wanted in self._message_frames):
            return wanted
        return self._frame_without_robot or wanted

    @property
    def _frame_without_robot(self) -> str:
        """The root of the transforms that most messages shown have, or of any; "" for none.

        Without transforms, the frame that most have.
        """
        known, tops = self.frames.names, [self.frames.top(each) for each in self._message_frames]
        if tops:
            return max(tops, key=lambda top: (top in known, tops.count(top)))
        return self.frames.top(min(known)) if known else ""

    @property
    def _message_frames(self) -> list[str]:
        """The frames of the messages that are shown."""
        return [
            item.frame
            for display in self._of_messages
            for item in display.items.values()
            if item.frame
        ]

    @property
    def _wanted_frame(self) -> str:
        """The frame that the view names; "" where each of several robots has one of that name."""
        wanted = self._view.fixed_frame
        if self._alone or wanted in self.frames.names:
            return wanted
        prefixed = (shown.context.frame_of(wanted) for shown in self._robots)
        return "" if any(frame in self.frames.names for frame in prefixed) else wanted

    @property
    def missing(self) -> list[str]:
        """The frames of links that no transform connects with the fixed frame, the world's, too."""
        fixed = self.fixed_frame
        return [
            frame
            for shown in (*self._robots, self._world)
            if shown.robot is not None
            for frame in shown.resolution.missing(shown.robot, fixed)
        ]

    @property
    def has_fixed_frame(self) -> bool:
        """The frame that the view names, if any, is known."""
        wanted = self._wanted_frame
        return not wanted or any(
            shown.robot is not None and bool(shown.resolution.known_as(shown.robot, wanted))
            for shown in self._robots
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
        self._laid_out_ns = 0
        problems = [*self._select(), *self._make_queues()]
        self._warnings.forget()
        self._changed = self._clock()
        return problems + self._wrong_names()

    def use_blueprint(self, blueprint: Path | None) -> None:
        """Arrange the viewer as a ``.rbl`` file that was saved in it; None: as the view has it."""
        self._own_blueprint = blueprint is None
        self._laid_out_ns = 0
        if blueprint is None:
            self._blueprint.forget()
        else:
            self._recording.log_file_from_path(blueprint)

    def _update_robot(self) -> list[str]:
        """Show the robots of the descriptions that have come, each in place of the one before."""
        warnings = []
        for shown in (*self._robots, self._world):
            name = self._full_name(shown.names, shown.names.description)
            messages, times = self._queues[name, DESCRIPTION.name].empty()
            for _, urdf in self._decoded(name, DESCRIPTION, messages, times):
                try:
                    warnings += self._set_robot(shown, urdf)
                except OneBotError as error:
                    self._report(name, error)
        return warnings

    def _set_robot(self, shown: ShownRobot, urdf: str) -> list[str]:
        before = self.robot
        # Of several that are alike the first is parsed, and warned of.
        alike = (each.robot for each in self._robots if each is not shown and each.urdf == urdf)
        known = next(alike, None)
        warnings = shown.set_description(urdf, known)
        for display in self._of_all:
            display.set_robot()
        self._whole.robot_size = min(map(robot_size, self.robots.values()), default=0.0)
        robot = self.robot
        if robot is not None and (before is None or robot.robot_name != before.robot_name):
            several = f" and {len(self._robots) - 1} more" * (not self._alone)
            self._recording.send_recording_name(f"{robot.robot_name}{several}")
        self._changed = self._clock()
        if known is not None:
            return []
        self._warnings.forget()
        return warnings + self._wrong_names()

    def _wrong_names(self) -> list[str]:
        follow = self._view.camera.follow
        known = {link for robot in self.robots.values() for link in robot.link_names}
        names = set(known)
        for shown in self._robots[: 0 if self._alone else None]:  # one of several, by its frame
            names.update(map(shown.context.frame_of, known))
        if not known or not follow or follow in names:
            return []
        hint = did_you_mean(follow, known, "links")
        return [f'camera.follow: the robot has no link "{follow}"{hint}']

    def _lay_out(self, complete: bool) -> None:
        """Send the blueprint once all frames are known, or do not come."""
        if complete or self._clock() - self._changed >= _PATIENCE:
            active = {id(shown.display) for shown in self._active}
            parts = [each.layout() for each in self._of_all if id(each) in active]
            for shown in (*self._robots, self._world):
                parts += shown.layout(collision=self._view.collision)
            layout = Layout.of(self._view, parts, self.fixed_frame, complete, self._robots)
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
    limits: list[LoadLimit] = field(default_factory=list)  # if each of them has one:
    most: int = 0  # that wait then; of more, the oldest are dropped

    def append(self, data: bytes, time_ns: int) -> None:
        """Add a message."""
        self.messages.append(data)
        self.times.append(time_ns)
        if self.limits and len(self.messages) > self.most:
            del self.messages[0], self.times[0]
            for limit in self.limits:
                limit.dropped += 1

    def empty(self) -> tuple[list[bytes], list[int]]:
        """Return the messages and when each was received, and keep none."""
        found = self.messages, self.times
        self.messages, self.times = [], []
        return found


@dataclass
class _Shown:
    """A display, and when it was flushed last."""

    display: Display[Any]
    limit: LoadLimit | None = None
    flushed_ns: tuple[int, ...] = ()

    def is_due(self, *now_ns: int) -> bool:
        """Whether it is time to flush it by one of several clocks; if so, that is noted."""
        period = self.display.period_ns
        times = zip(now_ns, self.flushed_ns, strict=False)
        if self.flushed_ns and all(abs(now - last) < period for now, last in times):
            return False
        if self.limit is not None and not self.limit.ready(time.monotonic()):
            return False
        self.flushed_ns = now_ns
        return True

    def flush(self) -> None:
        """Log what has come; what that takes is measured where it is limited."""
        began = time.perf_counter()
        self.display.flush()
        if self.limit is not None:
            self.limit.spent(time.perf_counter() - began)

    def warnings(self) -> list[str]:
        """Return what of it cannot be shown, a sentence each."""
        if self.limit is None or not self.limit.dropped:
            return self.display.warnings()
        return [
            *self.display.warnings(),
            f"{self.display.key}: more comes than can be shown without delay: old messages are "
            "dropped",
        ]


class StampSource(NamedTuple):
    """Whose stamps they are."""

    topic: str
    live: bool  # they are the times when the messages were sent
    is_tf: bool


class Stamps:
    """Chooses the time at which a message is shown: its stamp, or without one the receive time.

    Messages without a stamp get the receive time, shifted to simulated time if the stamps of /tf,
    or before there is any those of others, differ from it by more than 10 s. So do those from the
    future: one that is shown years ahead would hold there the viewer that follows the latest.
    """

    def __init__(self) -> None:
        self.warnings: dict[str, str] = {}  # of a wrong clock, by topic
        self._shift = 0  # ns, from the receive time to the time of the stamps
        self._has_tf = False
        self._other_since: dict[str, int] = {}  # of each topic, while its clock is another (ns)

    def display_time(self, stamp_ns: int, time_ns: int, source: StampSource | None = None) -> int:
        """Return the time, nanoseconds.

        Args:
            stamp_ns: of the header; 0 for none.
            time_ns: when it was received.
            source: whose stamp it is; not needed without one.
        """
        if SYSTEM_TIME_NS < time_ns < stamp_ns - OTHER_CLOCK_NS:
            ahead = f"{(stamp_ns - time_ns) * 1e-9:.0f} s ahead of their receive time"
            self.warnings.setdefault("", f"stamps {ahead} are ignored: is a clock wrong?")
            stamp_ns = 0
        if not stamp_ns:
            return time_ns + self._shift
        if source is not None and source.live:
            self._compare(stamp_ns - time_ns, time_ns, source)
        return stamp_ns

    def _compare(self, shift: int, time_ns: int, source: StampSource) -> None:
        """Set the shift, or compare another with it."""
        if source.is_tf or not self._has_tf:
            self._has_tf = source.is_tf
            self._shift = shift if abs(shift) > OTHER_CLOCK_NS else 0
        elif abs(shift - self._shift) <= OTHER_CLOCK_NS:
            self._other_since.pop(source.topic, None)
        elif time_ns - self._other_since.setdefault(source.topic, time_ns) > WARN_AFTER * 1e9:
            self.warnings[source.topic] = (
                f"the stamps of {source.topic} are {shift * 1e-9:.0f} s from their receive time, "
                f"those of /tf {self._shift * 1e-9:.0f} s: is a clock wrong?"
            )


class WarningFilter:
    """Passes each warning once per description; warns now and then while there is none."""

    def __init__(self, clock: Callable[[], float]) -> None:
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
    return WantedTopic(
        topic.name,
        both,
        reliable=topic.reliable or other.reliable,
        latched=topic.latched or other.latched,
        optional=topic.optional and other.optional,
        as_published=topic.as_published or other.as_published,
        depth=max(topic.depth, other.depth),
    )


def _raise(_: str, error: Exception) -> None:
    raise error
