"""Displays robots in a Rerun recording from their messages, live or recorded.

A message is queued and decoded in the inbox, then a display draws it on the stage. The blueprint
lays out what is drawn.
"""

import time
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import rerun as rr

from onebot_bringup.viewer.automatic import OfferedTopic, choose_topics
from onebot_bringup.viewer.blueprint import BlueprintSender, Layout
from onebot_bringup.viewer.core.columns import below
from onebot_bringup.viewer.core.display import Display, LayoutPart, LegendEntry
from onebot_bringup.viewer.core.drawing import MessageDisplay
from onebot_bringup.viewer.core.inbox import (
    DESCRIPTION,
    WARN_AFTER,
    Inbox,
    Subscription,
    WantedTopic,
)
from onebot_bringup.viewer.core.rerun_limits import SELDOM
from onebot_bringup.viewer.core.robot_shapes import COLLISION_ENTITY, robot_size
from onebot_bringup.viewer.core.shown_robot import RobotToShow, ShownRobot
from onebot_bringup.viewer.core.stage import Stage
from onebot_bringup.viewer.displays import MESSAGE_DRAWINGS, ROBOT_DISPLAYS
from onebot_bringup.viewer.view_config import ViewConfig
from onebot_description.description import Description
from onebot_description.errors import OneBotError, did_you_mean
from onebot_description.ros.wire.interface_text import full_definition

# Seconds to wait for all links' frames before laying out without them.
_PATIENCE = 1.0
_MAX_WARNINGS = 100  # per description
_LONGEST_WARNING = 1000  # characters
_HINT = (
    "waiting for the robot's description on robot_description; it comes from robot_state_publisher"
)

ReportBad = Callable[[str, Exception], object]


class RobotView:
    """Turns messages of topics into a recording; never waits or blocks."""

    def __init__(
        self,
        recording: rr.RecordingStream,
        view: ViewConfig | None = None,
        *,
        robots: Sequence[RobotToShow] = (RobotToShow(),),
        resolve: Callable[[str], str] = str,
        clock: Callable[[], float] = time.monotonic,
        report: ReportBad | None = None,
        from_start: bool = False,
        definitions: Callable[[str], str] = full_definition,
        live: bool = False,
    ) -> None:
        """Show one robot or several in ``recording``.

        Args:
            recording: where to log.
            view: what is shown, and how.
            robots: the robots to show; if there are several, each logs below its namespace.
            resolve: returns the full name of a topic that the view names.
            clock: returns the time, seconds.
            report: called with the topic and the error of a bad message; the default raises it.
            from_start: play from the beginning instead of following the latest data.
            definitions: returns the definition of a message type, or raises an OneBotError.
            live: messages arrive as they are published, so old ones may be dropped, and a
                description may still arrive.

        Raises:
            OneBotError: two displays want the same topic with different types.
        """
        self.inbox = Inbox(report or _raise)
        self._view = view or ViewConfig()
        self.stage = stage = Stage(
            recording,
            self._view.fixed_frame,
            robots,
            resolve=resolve,
            clock=clock,
            definitions=definitions,
        )
        self._live = live
        self._changed = clock()  # when the robot or the view changed
        self._passed_warnings: set[str] = set()  # passed to the user, for this description and view
        self._published: Mapping[str, str] = {}
        self._laid_out_ns = 0
        self._laid_out_of: tuple[object, ...] = ()
        # The topics that could be shown, and whether they are.
        self.offered: Sequence[OfferedTopic] = ()
        self._blueprint = BlueprintSender(recording, stage.robots, from_start=from_start)
        # Topics whose pictures the page around the view shows itself; None without a page.
        self.page_cameras: Collection[str] | None = None
        self.message_displays = [MessageDisplay(stage, draws) for draws in MESSAGE_DRAWINGS]
        self.robot_displays = [
            display(stage, robot)
            for robot in (None, *stage.robots)
            for display in ROBOT_DISPLAYS
            if display.of_all_robots == (robot is None)
            and (robot is None or robot.names.plotted or not display.only_plots)
        ]
        self._displays: Sequence[Display[Any]] = [*self.robot_displays, *self.message_displays]
        for display in self._displays:
            display.apply(self._view.settings_of(display))
        for message_display in self.message_displays:
            message_display.limited = live
        problems = self.inbox.subscribe(self._subscriptions())
        if problems:
            raise OneBotError("; ".join(problems))

    # --- messages -------------------------------------------------------------------------------

    @property
    def topics(self) -> Mapping[str, WantedTopic]:
        """The topics to subscribe to now, by full names; ``set_view`` may change them."""
        return self.inbox.topics

    def wants(self, topic: str, type_name: str) -> bool:
        """Whether anything is shown of this topic (its full name) and type."""
        return self.inbox.wants(topic, type_name)

    def take(self, topic: str, type_name: str, data: bytes, time_ns: int) -> None:
        """Queue a message, which a later ``tick`` shows; see ``Inbox.take``."""
        self.inbox.take(topic, type_name, data, time_ns)

    @property
    def legend(self) -> list[LegendEntry]:
        """The entries of a legend, without duplicates for robots that are drawn alike."""
        entries = (entry for display in self._displays for entry in display.legend())
        return list(dict.fromkeys(entries))

    def offer(self, topics: Mapping[str, str]) -> list[str]:
        """Show those of the existing topics that have a display and are not hidden.

        Args:
            topics: message types by full topic names.

        Returns:
            One sentence per thing that cannot be shown.
        """
        if topics == self._published:
            return []
        self._published = dict(topics)
        return self._select()

    def _select(self) -> list[str]:
        """Choose the topics to show and offer them to the displays; update the subscriptions."""
        drawn = {
            name
            for name, display, _ in self._subscriptions_of_robots()
            if display and not display.only_plots
        }.union(*(robot.clouds_of_scans for robot in self.stage.robots))
        self.offered, problems = choose_topics(
            self.stage, self._view, self._published, drawn, self.offered
        )
        visible = {offer.topic: offer.type for offer in self.offered if offer.visible}
        changed = []
        for display in self._displays:
            topics = self._published
            if isinstance(display, MessageDisplay):
                types = display.draws.message_types
                topics = {topic: kind for topic, kind in visible.items() if kind in types}
            if display.offer(topics):
                changed.append(display)
        if changed:
            self._deliver(self._displays)
            self._apply(changed)
            problems += self.inbox.subscribe(self._subscriptions())
        return problems

    def _subscriptions(self) -> Iterator[Subscription]:
        """Yield all topics to subscribe to."""
        yield from self._subscriptions_of_robots()
        for display in self.message_displays:
            for topic in display.topics():
                yield topic.name, display, topic

    def _subscriptions_of_robots(self) -> Iterator[tuple[str, Display[Any] | None, WantedTopic]]:
        """Yield the topics of descriptions, and of all displays but those of message types."""
        stage = self.stage
        for robot in (*stage.robots, stage.world):
            name, optional = robot.names.description, robot is stage.world
            topic = WantedTopic(name, (DESCRIPTION,), latched=True, optional=optional)
            yield robot.full_name(name), None, topic
        for display in self.robot_displays:
            for topic in display.topics():
                # An absolute name belongs to no robot: the first robot's displays draw it.
                is_first = display.shown_robot in (None, stage.robots[0])
                if is_first or not topic.name.startswith("/"):
                    yield display.full_name(topic.name), display, topic

    # --- time -----------------------------------------------------------------------------------

    def tick(self, now_ns: int) -> list[str]:
        """Log the queued messages and lay out the view; call this about 20 times a second.

        Args:
            now_ns: the time, nanoseconds.

        Returns:
            New messages for the user, one sentence each.
        """
        # This clock runs even while simulated time is paused.
        steady_ns = int(self.stage.clock() * 1e9) if self._live else now_ns
        warnings = self._set_descriptions()
        self.stage.now_ns = self.inbox.stamps.display_time(0, now_ns)
        self._flush([item for item in self._displays if item.is_due(steady_ns)])
        # Comparing layouts costs as much as drawing a scan.
        tree = self.stage.frames.version, self._changed
        if tree == self._laid_out_of and 0 < steady_ns - self._laid_out_ns < SELDOM:
            return warnings
        self._laid_out_ns, self._laid_out_of = steady_ns, tree
        self._lay_out()
        return warnings + self._late()

    def finish(self) -> list[str]:
        """Log everything that is still queued, before the recording is closed."""
        warnings = self._set_descriptions()
        self.stage.transform_timeout_ns = 0
        self._flush(self._displays)
        if self.robot is not None:
            self._lay_out()
        return warnings

    def _deliver(self, displays: Collection[Display[Any]]) -> None:
        """Decode the messages for these displays.

        The messages' frames determine the fixed frame if there is no robot.
        """
        self.inbox.deliver(displays)
        self.stage.message_frames = [
            drawing.frame
            for display in self.message_displays
            for drawing in display.items.values()
            if drawing.frame
        ]

    def _flush(self, displays: Collection[Display[Any]]) -> None:
        """Decode and log the messages for these displays."""
        self._deliver(displays)
        for display in displays:
            display.flush()

    def _apply(self, displays: Iterable[Display[Any]]) -> None:
        """Use the view's settings from now on."""
        for display in displays:
            display.flush()
            display.apply(self._view.settings_of(display))
        self._deliver(())

    def _late(self) -> list[str]:
        """Return one sentence per new problem: something is overdue, or cannot be shown."""
        stage = self.stage
        late = [*self.inbox.stamps.warnings.values()]
        for display in self._displays:
            late += display.warnings()
            if display.dropped:
                late.append(
                    f"{display.key}: more messages arrive than can be shown without delay: old "
                    "ones are dropped"
                )
        if stage.clock() - self._changed >= WARN_AFTER:
            late += stage.late()
            if self.robot is None and self._live and not stage.frame_without_robot:
                late.append(_HINT)
        passed = self._passed_warnings
        # They may quote long names that other nodes publish.
        short = dict.fromkeys(sentence[:_LONGEST_WARNING] for sentence in late)
        new = [sentence for sentence in short if sentence not in passed]
        new = new[: _MAX_WARNINGS - len(passed)]
        passed.update(new)
        return new

    # --- the robot and the view -----------------------------------------------------------------

    @property
    def robots(self) -> dict[str, Description]:
        """The descriptions of the robots shown now, by their namespaces."""
        return self.stage.descriptions

    @property
    def robot(self) -> Description | None:
        """The description of the first robot shown now; None if there is none."""
        return next(iter(self.robots.values()), None)

    def set_view(self, view: ViewConfig) -> list[str]:
        """Replace the view.

        Returns:
            One sentence per setting that does not fit the robot or the other topics.
        """
        self._deliver(self._displays)
        old_view, self._view = self._view, view
        self.stage.view_frame = view.fixed_frame
        self._apply(
            display
            for display in self._displays
            if view.settings_of(display) != old_view.settings_of(display)
        )
        self._laid_out_ns = 0
        problems = [*self._select(), *self.inbox.subscribe(self._subscriptions())]
        self._passed_warnings.clear()
        self._changed = self.stage.clock()
        return problems + self._wrong_names()

    def _set_descriptions(self) -> list[str]:
        """Show the received descriptions, each in place of the robot's previous one."""
        warnings = []
        for robot in (*self.stage.robots, self.stage.world):
            topic = robot.full_name(robot.names.description)
            for _, urdf in self.inbox.descriptions(topic):
                try:
                    warnings += self._set_description(robot, urdf)
                except OneBotError as error:
                    self.inbox.report(topic, error)
        return warnings

    def _set_description(self, robot: ShownRobot, urdf: str) -> list[str]:
        stage, previous = self.stage, self.robot
        # If several robots are alike, only the first one's description is parsed and warned about.
        twins = (twin for twin in stage.robots if twin is not robot and twin.urdf == urdf)
        alike = next((twin.description for twin in twins), None)
        warnings = robot.set_description(urdf, alike)
        if alike is None:
            stage.robot_size = min(map(robot_size, self.robots.values()), default=0.0)
        for display in self._displays:
            if display.shown_robot in (None, robot):
                display.set_robot()
        warnings += self._select()
        first = self.robot
        if first is not None and (previous is None or first.robot_name != previous.robot_name):
            several = "" if stage.alone else f" and {len(stage.robots) - 1} more"
            stage.recording.send_recording_name(f"{first.robot_name}{several}")
        self._changed = stage.clock()
        if alike is not None:
            return []
        self._passed_warnings.clear()
        return warnings + self._wrong_names()

    def _wrong_names(self) -> list[str]:
        """Return a sentence if no robot has the link that the camera should follow."""
        follow = self._view.camera.follow
        links = {link for robot in self.robots.values() for link in robot.link_names}
        if not links or not follow or follow in links or self._blueprint.followed(follow):
            return []
        hint = did_you_mean(follow, links, "links")
        return [f'camera.follow: the robot has no link "{follow}"{hint}']

    def _lay_out(self) -> None:
        """Send the blueprint once all frames are known, or after a timeout."""
        stage = self.stage
        if self.robot is None:
            complete = False
            if not stage.fixed_frame and not any(offer.visible for offer in self.offered):
                return
        else:
            is_known = len(self.robots) == len(stage.robots) and stage.has_fixed_frame
            complete = is_known and not stage.missing
        if not complete and stage.clock() - self._changed < _PATIENCE:
            return
        collisions = [below(robot.root, COLLISION_ENTITY) for robot in (*stage.robots, stage.world)]
        visible = tuple((entity, self._view.collision) for entity in collisions)
        parts = [LayoutPart(visible=visible)]
        for display in (*self.message_displays, *self.robot_displays):
            parts += (replace(part, robot=display.root) for part in display.layout())
        view, names = self._view, tuple(self.robots)
        settings = view.grid, view.background, view.camera, view.panels
        layout = Layout(*settings, tuple(parts), stage.fixed_frame, complete, names)
        if self.page_cameras is not None:
            layout = layout.in_page(self.page_cameras)
        self._blueprint.update(layout)


def _raise(_: str, error: Exception) -> None:
    raise error
