"""Shows a bag in Rerun as the live viewer would have shown it, all of its time at once."""

import time
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path

import rerun as rr

from onebot_bringup.bags.contents import BagMessage
from onebot_bringup.bags.reader import Bag
from onebot_bringup.viewer.displays.joint_plot import JOINT_STATE
from onebot_bringup.viewer.displays.tf import TF
from onebot_bringup.viewer.inbox import DESCRIPTION
from onebot_bringup.viewer.robot_view import RobotView
from onebot_bringup.viewer.shown_robot import MOST_PLOTTED, WORLD_DESCRIPTION, RobotToShow
from onebot_bringup.viewer.view_source import ViewSource
from onebot_description.description import Description, parse_description
from onebot_description.errors import OneBotError, did_you_mean, listing, printable
from onebot_description.wire.messages import tf_arrays

_DESCRIPTION_NAME, _JOINTS_NAME = "robot_description", "joint_states"
_TF_NAMES = ("/tf", "/tf_static")
_FIRST = 1000  # messages of /tf in which every robot has turned up
_TICK = 500_000_000  # ns of the recording between two calls into Rerun
_MOST_WAITING = 64_000_000  # bytes of messages that Rerun has not written; it has no limit itself
_SETTLE = 10.0  # s after its end, for what is shown only once nothing better came
_REPORT_EVERY = 2.0  # s

Log = Callable[[str], None]


@dataclass(frozen=True)
class Shown:
    """What of a recording is shown."""

    robot: str  # the first one's name; "" where the recording has no description
    messages: int  # that could be shown
    seconds: float  # from the first to the last of them


def log_bag(
    bag: Bag,
    stream: rr.RecordingStream,
    *,
    view: Path | None = None,
    fixed_frame: str = "",
    frame_prefix: str = "",
    namespace: str = "",
    from_start: bool = True,
    progress: Log = print,
    warn: Log = print,
) -> Shown:
    """Log all that ``bag`` holds of its robots, and each topic that has a display.

    Args:
        bag: the recording.
        stream: where to log.
        view: a .yaml, .rviz or .rbl file; None for the view of the robot's description, if that is
            installed.
        fixed_frame: the frame to show everything in; "" for the view's, else the one above the
            robot, or above the frames of most topics.
        frame_prefix: put before link names to get their frames; "" to find it out.
        namespace: of the robot to show; "" for all.
        from_start: the viewer plays it from its beginning; False: it shows its end.
        progress: called with how far it is, when that takes over two seconds.
        warn: called with what cannot be shown, and with damage of the recording.

    Raises:
        OneBotError: there is nothing to show in it or in the namespace, or the view is wrong.
    """
    recorded = robots_of(bag, namespace)
    names = recorded[0]
    if len(recorded) > 1:
        there = listing([each.space or "/" for each in recorded])
        if frame_prefix:
            raise OneBotError(
                f"frame_prefix:={frame_prefix} is one robot's, and several are recorded, in "
                f"{there}: choose one by namespace:="
            )
        progress(f"showing the robots in {there}; namespace:= chooses one")
    elif not names.descriptions:
        warn(f"{bag.source} holds no {_DESCRIPTION_NAME}: showing the rest without the robot")
    if names.tf_elsewhere and not namespace:
        warn(f"not shown: the transforms in {listing(names.tf_elsewhere)}; namespace:= chooses one")
    known = descriptions_in(bag, [topic for each in recorded for topic in each.descriptions[:1]])
    source = ViewSource("" if view is None else str(view), warn)
    if known:
        name = next(iter(known.values())).robot_name
        source.set_robot(name, in_world=WORLD_DESCRIPTION in bag.topics)
    config = replace(source.view, fixed_frame=fixed_frame or source.view.fixed_frame)
    for warning in bag.warnings:
        warn(warning)
    warned = len(bag.warnings)
    player = _Player(bag, stream, warn)
    robot_view = RobotView(
        stream,
        config,
        blueprint=source.blueprint_file,
        robots=_named_robots(bag, recorded, known, frame_prefix),
        resolve=names.resolved,
        clock=lambda: player.now_ns / 1e9,
        report=player.report,
        from_start=from_start,
        definitions=bag.definition,
    )
    for warning in robot_view.offer(_with_messages(bag, names, namespace)):
        warn(warning)
    shown = player.play(robot_view, progress)
    for warning in bag.warnings[warned:]:
        warn(warning)
    if not shown.messages:
        topics = [f"{topic} ({kind})" for topic, kind in bag.topics.items()]
        raise OneBotError(f"nothing of {bag.source} can be shown: it has {listing(topics)}")
    return shown


def _with_messages(bag: Bag, names: "RobotTopics", namespace: str) -> dict[str, str]:
    """The types of the topics that have messages, without the robots' that are not shown."""
    others = tuple(
        f"{space}/" for space in names.spaces if namespace and space not in ("", names.space)
    )
    return {
        topic: kind
        for topic, kind in bag.topics.items()
        if (bag.counts[topic] or not bag.count) and not topic.startswith(others)
    }


class _Player:
    """Plays a bag into a view whose clock is the bag's."""

    def __init__(self, bag: Bag, stream: rr.RecordingStream, warn: Log) -> None:
        self._bag = bag
        self._stream = stream
        self._warn = warn
        self._bad: dict[str, int] = {}  # messages by topic
        self.now_ns = bag.start_ns

    def report(self, topic: str, error: Exception) -> None:
        """Count a message that cannot be shown; warn of the first of each topic."""
        self._bad[topic] = self._bad.get(topic, 0) + 1
        if self._bad[topic] == 1:
            self._warn(f"a message of {topic} is left out: {error}")

    def play(self, view: RobotView, progress: Log) -> Shown:
        """Show all of the bag; ``progress`` is called if it takes over two seconds."""
        bag = self._bag
        count, start, last_tick, waiting = 0, None, 0, 0
        next_report = time.monotonic() + _REPORT_EVERY
        for message in bag.messages([t for t, kind in bag.topics.items() if view.wants(t, kind)]):
            self.now_ns = max(self.now_ns, message.time)
            start = message.time if start is None else start
            view.take(message.topic, message.type, message.data, message.time)
            count += 1
            waiting += len(message.data)
            if self.now_ns - last_tick >= _TICK or waiting >= _MOST_WAITING:
                last_tick = self.now_ns
                self._tick(view)
                if waiting >= _MOST_WAITING:
                    waiting = 0
                    self._stream.flush()
                if time.monotonic() >= next_report:
                    next_report = time.monotonic() + _REPORT_EVERY
                    part = f" of {bag.count}" if bag.count else ""
                    progress(f"loading {bag.source}: message {count}{part}")
        seconds = (self.now_ns - start) / 1e9 if start is not None else 0.0
        self._tick(view)
        self.now_ns += int(_SETTLE * 1e9)
        self._tick(view)
        view.finish()
        for topic, number in self._bad.items():
            if number > 1:
                self._warn(f"{number} messages of {topic} were left out")
        robot = printable(view.robot.robot_name) if view.robot is not None else ""
        return Shown(robot, count - sum(self._bad.values()), seconds)

    def _tick(self, view: RobotView) -> None:
        for sentence in view.tick(self.now_ns):
            self._warn(sentence)


# --- which robot ----------------------------------------------------------------------------


class RobotTopics:
    """Which topics of a recording are of the robot, and its namespace."""

    def __init__(self, bag: Bag, namespace: str = "") -> None:
        """Choose the robot in ``namespace``, or the first one.

        Raises:
            OneBotError: there is none.
        """
        found = _named(bag, _DESCRIPTION_NAME, DESCRIPTION.name)
        self.descriptions = sorted(found, key=lambda topic: (topic.count("/"), topic))
        joints = _named(bag, _JOINTS_NAME, JOINT_STATE.name)
        with_tf = [_space(each) for name in _TF_NAMES for each in _named(bag, name[1:], TF.name)]
        self.spaces = [_space(topic) for topic in self.descriptions]  # of every robot
        self.space = self.spaces[0] if self.spaces else ""  # of the robot: "" or "/name"
        if namespace:
            self.space = f"/{namespace.strip('/')}".rstrip("/")
            known = [*self.spaces, *map(_space, joints), *filter(None, with_tf)]
            if self.space not in known:
                there = did_you_mean(namespace, {space or "/" for space in known}, "robots")
                raise OneBotError(f"namespace:={namespace}: {bag.source} has no robot there{there}")
            self.descriptions = [t for t in self.descriptions if _space(t) == self.space]
        self.joints = f"{self.space}/{_JOINTS_NAME}"
        if not self.descriptions and not namespace and joints and self.joints not in joints:
            self.joints = joints[0]
        # Some robots publish their transforms below their namespace.
        spaces = ["", self.space, *([] if namespace else with_tf)]
        self._tf_space = next((space for space in spaces if space in with_tf), "")
        self.tf = [f"{self._tf_space}{name}" for name in _TF_NAMES]
        self.tf_elsewhere = sorted({*with_tf} - {"", self._tf_space})  # not shown

    def resolved(self, name: str) -> str:
        """Return the full name of a topic that the view names."""
        if name == _JOINTS_NAME:
            return self.joints
        if name in _TF_NAMES:
            return f"{self._tf_space}{name}"
        return name if name.startswith("/") else f"{self.space}/{name}"


def robots_of(bag: Bag, namespace: str = "") -> list[RobotTopics]:
    """Return the robot in ``namespace``, or all, the first one of none if there is no description.

    Raises:
        OneBotError: there is none in the namespace.
    """
    first = RobotTopics(bag, namespace)
    if namespace or len(first.spaces) < 2:
        return [first]
    return [RobotTopics(bag, space or "/") for space in first.spaces]


def _named_robots(
    bag: Bag,
    recorded: Sequence[RobotTopics],
    known: Mapping[str, Description],
    frame_prefix: str,
) -> list[RobotToShow]:
    """Return the names of the robots; the prefixes of their frames are found out, if not given."""
    frames = set() if frame_prefix or not known else frames_of(bag, recorded[0])
    found: list[RobotToShow] = []
    for each in recorded:
        robot = known.get(each.descriptions[0]) if each.descriptions else None
        prefix = frame_prefix
        if robot is not None and not prefix:
            prefix = frame_prefix_of(robot.root_link, robot.link_names, frames, each.space)
        # Of one alone, names.resolved knows where its joint states are.
        space = each.space if len(recorded) > 1 else ""
        found.append(RobotToShow(space, prefix, plotted=len(found) < MOST_PLOTTED))
    return found


def descriptions_in(bag: Bag, topics: Collection[str]) -> dict[str, Description]:
    """Return the first description on each of these topics that can be read."""
    found: dict[str, Description] = {}
    for message in bag.messages(topics) if topics else ():
        if message.topic not in found:
            with suppress(OneBotError, ValueError):  # it is reported when it is shown
                found[message.topic] = parse_description(_text(message), _DESCRIPTION_NAME)
        if len(found) == len(topics):
            break
    return {topic: found[topic] for topic in topics if topic in found}


def frames_of(bag: Bag, names: RobotTopics) -> set[str]:
    """Return the frames that are named at the beginning."""
    frames: set[str] = set()
    for message in islice(bag.messages(names.tf), _FIRST):
        with suppress(ValueError, IndexError):
            transforms = tf_arrays(message.data)
            frames.update(transforms.parents, transforms.children)
    return frames


def _text(message: BagMessage) -> str:
    [text] = DESCRIPTION.decode([message.data], lambda _: None)
    return text or ""


def _space(topic: str) -> str:
    return topic.rpartition("/")[0]


def _named(bag: Bag, name: str, kind: str) -> list[str]:
    """The topics of that name and type, in any namespace."""
    return [
        topic
        for topic, recorded in bag.topics.items()
        if recorded == kind and topic.rpartition("/")[2] == name
    ]


def frame_prefix_of(
    root: str, links: Collection[str], frames: Collection[str], namespace: str
) -> str:
    """Return what is before the links' names in ``frames``.

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
