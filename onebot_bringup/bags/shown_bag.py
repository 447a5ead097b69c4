"""Shows a whole bag in Rerun, as the live viewer would have shown it."""

import time
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import islice
from typing import TYPE_CHECKING, NamedTuple

from onebot_bringup.bags.bag_reader import Bag
from onebot_bringup.viewer.core.inbox import DESCRIPTION
from onebot_bringup.viewer.core.shown_robot import MAX_PLOTTED, WORLD_DESCRIPTION, RobotToShow
from onebot_bringup.viewer.core.transform_stream import TF
from onebot_bringup.viewer.displays.joint_plot import JOINT_STATE
from onebot_bringup.viewer.robot_view import RobotView
from onebot_bringup.viewer.view_source import ViewSource
from onebot_description.description import Description, parse_description
from onebot_description.errors import OneBotError, did_you_mean, listing, printable
from onebot_description.ros.names import absolute
from onebot_description.ros.wire.message_arrays import BAD_MESSAGE, tf_arrays
from onebot_description.timing import NS_PER_S

if TYPE_CHECKING:
    import rerun as rr

_DESCRIPTION_NAME = "robot_description"
_TF_NAMES = ("/tf", "/tf_static")
_FIRST = 1000  # messages of /tf within which every robot is expected to appear
_TICK = 500_000_000  # ns of the recording between two calls into Rerun
_MAX_QUEUED = 64_000_000  # bytes queued in Rerun, which itself has no limit
# ns after the end, for data that is shown only if nothing better has arrived.
_SETTLE = 10 * NS_PER_S
_REPORT_EVERY = 2.0  # s

Log = Callable[[str], None]


class Shown(NamedTuple):
    """Summary of what was shown of a recording."""

    robot: str  # name of the first robot; "" if the recording has no description
    messages: int  # number of messages shown
    seconds: float  # duration, first to last message


class ShownBag:
    """A bag and the view in which to show it: its robots, and each topic that has a display."""

    def __init__(
        self,
        bag: Bag,
        *,
        view: str = "",
        fixed_frame: str = "",
        namespace: str = "",
        progress: Log = print,
        warn: Log = print,
    ) -> None:
        """Choose what to show, and read the view; nothing is logged yet.

        Args:
            bag: the recording.
            view: see ``ViewSource``.
            fixed_frame: the fixed frame; "" for the view's, or else the frame above the robot, or
                above most topics' frames.
            namespace: the namespace of the robot to show; "" for all robots.
            progress: called with the progress if loading takes over two seconds.
            warn: called with a sentence about each thing that cannot be shown, and about damage.

        Raises:
            OneBotError: the view or another argument has a mistake.
        """
        self._bag, self._namespace = bag, namespace
        self._progress, self._warn = progress, warn
        self._bad: Counter[str] = Counter()  # number of bad messages by topic
        self._first_errors: dict[str, Exception] = {}  # keys: topics
        self._now_ns = bag.start_ns
        robots = robots_of(bag, namespace)
        first = self._first = robots[0]
        if len(robots) > 1:
            spaces = listing([robot.space or "/" for robot in robots])
            progress(f"showing the robots in {spaces}; namespace:= chooses one")
        elif not first.description:
            warn(f"{bag.source} holds no {_DESCRIPTION_NAME}: showing the rest without the robot")
        hidden_spaces = sorted({*_tf_spaces(bag)} - {"", first.tf_space})
        if hidden_spaces and not namespace:
            warn(f"not shown: the transforms in {listing(hidden_spaces)}; namespace:= chooses one")
        descriptions = descriptions_in(bag, [robot.description for robot in robots])
        source = ViewSource(view, warn)
        if descriptions:
            name = next(iter(descriptions.values())).robot_name
            source.set_robot(name, in_world=WORLD_DESCRIPTION in bag.topics)
        self._config = replace(source.view, fixed_frame=fixed_frame or source.view.fixed_frame)
        self._robots = _robots_to_show(bag, robots, descriptions)

    def log(self, stream: "rr.RecordingStream", *, from_start: bool = True) -> Shown:
        """Log the bag.

        Args:
            stream: where to log.
            from_start: play from the beginning; False shows the end.

        Raises:
            OneBotError: nothing can be shown.
        """
        bag = self._bag
        view = RobotView(
            stream,
            self._config,
            robots=self._robots,
            resolve=self._first.resolved,
            clock=lambda: self._now_ns / 1e9,
            report=self._report,
            from_start=from_start,
            definitions=bag.definition,
        )
        self._warn_of(view.offer(_with_messages(bag, self._first, self._namespace)))
        count = self._play(view, stream) - self._bad.total()
        self._warn_of(
            f"{self._bad[topic]} messages of {topic} were skipped; the first: {error}"
            for topic, error in self._first_errors.items()
        )
        self._warn_of(dict.fromkeys(bag.warnings))
        if not count:
            topics = [f"{topic} ({kind})" for topic, kind in bag.topics.items()]
            raise OneBotError(f"nothing in {bag.source} can be shown: it has {listing(topics)}")
        robot = printable(view.robot.robot_name) if view.robot is not None else ""
        return Shown(robot, count, (bag.end_ns - bag.start_ns) / 1e9)

    def _report(self, topic: str, error: Exception) -> None:
        """Note a message that cannot be shown."""
        self._bad[topic] += 1
        self._first_errors.setdefault(topic, error)

    def _warn_of(self, sentences: Iterable[str]) -> None:
        for sentence in sentences:
            self._warn(sentence)

    def _play(self, view: RobotView, stream: "rr.RecordingStream") -> int:
        """Show all messages in a view, whose clock is the bag's time; return their number."""
        bag = self._bag
        count, last_tick, waiting = 0, 0, 0
        next_report = time.monotonic() + _REPORT_EVERY
        for message in bag.messages([t for t, kind in bag.topics.items() if view.wants(t, kind)]):
            self._now_ns = max(self._now_ns, message.time)
            view.take(message.topic, message.type, message.data, message.time)
            count += 1
            waiting += len(message.data)
            if self._now_ns - last_tick >= _TICK or waiting >= _MAX_QUEUED:
                last_tick = self._now_ns
                self._warn_of(view.tick(self._now_ns))
                if waiting >= _MAX_QUEUED:
                    waiting = 0
                    stream.flush()
                if time.monotonic() >= next_report:
                    next_report = time.monotonic() + _REPORT_EVERY
                    self._progress(f"loading {bag.source}: message {count} of {bag.count}")
        self._warn_of(view.tick(self._now_ns))
        self._now_ns += _SETTLE
        self._warn_of(view.tick(self._now_ns))
        view.finish()
        return count


def _with_messages(bag: Bag, robot: "RecordedRobot", namespace: str) -> dict[str, str]:
    """Return the types of the topics that have messages, except topics of robots not shown."""
    spaces = {*_spaces(bag, _DESCRIPTION_NAME, DESCRIPTION.name)} if namespace else set()
    other_prefixes = tuple(f"{space}/" for space in spaces - {"", robot.space})
    return {
        topic: kind
        for topic, kind in bag.topics.items()
        if bag.counts[topic] and not topic.startswith(other_prefixes)
    }


@dataclass(frozen=True)
class RecordedRobot:
    """The topics of a robot in a recording."""

    space: str  # its namespace: "" or "/name"
    description: str  # the topic of its description; "" for none
    tf_space: str  # the namespace of its transforms, which some robots publish in their own

    def resolved(self, name: str) -> str:
        """Return the full name of a topic that the view names."""
        if name in _TF_NAMES:
            return f"{self.tf_space}{name}"
        return name if name.startswith("/") else f"{self.space}/{name}"


def robots_of(bag: Bag, namespace: str = "") -> list[RecordedRobot]:
    """Return the robots in a recording.

    Without any description, there is one robot, with the topics that may be a robot's.

    Args:
        bag: the recording.
        namespace: the namespace of the only robot to return; "" for all.

    Raises:
        OneBotError: there is no robot in ``namespace``.
    """
    described = _spaces(bag, _DESCRIPTION_NAME, DESCRIPTION.name)
    transforms = _tf_spaces(bag)
    spaces = described or [""]
    if namespace:
        spaces = [absolute(namespace)]
        joints = _spaces(bag, "joint_states", JOINT_STATE.name)
        known_spaces = {*described, *joints, *filter(None, transforms)}
        if spaces[0] not in known_spaces:
            hint = did_you_mean(namespace, {space or "/" for space in known_spaces}, "robots")
            raise OneBotError(f"namespace:={namespace}: {bag.source} has no robot there{hint}")
    robots = []
    for space in spaces:
        with_tf = [t for t in ("", space) if t in transforms]
        if not namespace and len(spaces) == 1:
            with_tf += transforms
        description = f"{space}/{_DESCRIPTION_NAME}" if space in described else ""
        robots.append(RecordedRobot(space, description, next(iter(with_tf), "")))
    return robots


def _robots_to_show(
    bag: Bag, robots: Sequence[RecordedRobot], descriptions: Mapping[str, Description]
) -> list[RobotToShow]:
    """Return the robots with their frame prefixes, which are found out."""
    frames = frames_of(bag, robots[0]) if descriptions else set()
    choice: list[RobotToShow] = []
    for robot in robots:
        prefix = ""
        if found := descriptions.get(robot.description):
            prefix = frame_prefix_of(found.root_link, found.link_names, frames, robot.space)
        # For a single robot, ``resolved`` returns its topics.
        space = robot.space if len(robots) > 1 else ""
        choice.append(RobotToShow(space, prefix, plotted=len(choice) < MAX_PLOTTED))
    return choice


def descriptions_in(bag: Bag, topics: Collection[str]) -> dict[str, Description]:
    """Return the first readable description on each of these topics."""
    named = [topic for topic in topics if topic]
    descriptions: dict[str, Description] = {}
    for message in bag.messages(named) if named else ():
        if message.topic not in descriptions:
            with suppress(OneBotError, *BAD_MESSAGE):  # reported when it is shown
                text = DESCRIPTION.read(message.data)
                descriptions[message.topic] = parse_description(text, _DESCRIPTION_NAME)
        if len(descriptions) == len(named):
            break
    return {topic: descriptions[topic] for topic in named if topic in descriptions}


def frames_of(bag: Bag, robot: RecordedRobot) -> set[str]:
    """Return the names of the frames at the beginning of a recording."""
    frames: set[str] = set()
    topics = [robot.resolved(name) for name in _TF_NAMES]
    for message in islice(bag.messages(topics), _FIRST):
        with suppress(ValueError, IndexError):
            transforms = tf_arrays(message.data)
            frames.update(transforms.parents, transforms.children)
    return frames


def _spaces(bag: Bag, name: str, kind: str) -> list[str]:
    """Return the namespaces with a topic of that name and type, outer namespaces first."""
    topics = [
        topic
        for topic, recorded in bag.topics.items()
        if recorded == kind and topic.rpartition("/")[2] == name
    ]
    return [topic.rpartition("/")[0] for topic in sorted(topics, key=lambda t: (t.count("/"), t))]


def _tf_spaces(bag: Bag) -> list[str]:
    return [space for name in _TF_NAMES for space in _spaces(bag, name[1:], TF.name)]


def frame_prefix_of(
    root: str, links: Collection[str], frames: Collection[str], namespace: str
) -> str:
    """Return the prefix that most links have in ``frames``; "" for none.

    Args:
        root: the root link.
        links: all links, including the root.
        frames: the recorded frames, also of other robots.
        namespace: the robot's namespace, which decides between prefixes that fit equally well.
    """
    prefixes = {frame.removesuffix(root) for frame in frames if frame.endswith(root)}

    def fit(prefix: str) -> tuple[int, bool, int, str]:
        count = sum(prefix + link in frames for link in links)
        return count, prefix.strip("/_") == namespace.strip("/"), -len(prefix), prefix

    return max(prefixes, key=fit, default="")
