"""``onebot bag ...``: records topics; plays and describes recordings, like ``ros2 bag``."""

import json
import time
from argparse import Namespace
from collections.abc import Callable, Sequence
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from onebot_bringup.cli.options import (
    Subcommand,
    flag,
    not_negative,
    option,
    positional,
    positive,
    warn,
)
from onebot_bringup.cli.session import Session, await_acknowledgements
from onebot_description.errors import OneBotError, UsageError, did_you_mean
from onebot_description.ros.discovery import use_local_discovery
from onebot_description.ros.signals import KeyboardInterrupts
from onebot_description.timing import NS_PER_S

if TYPE_CHECKING:
    from onebot_bringup.bags.bag_reader import Bag
    from onebot_bringup.bags.writer import Qos

_DEPTH = 1000  # messages that a publisher of a latched topic keeps for late subscribers
_CLOCK = "/clock"
_CLOCK_RATE = 40.0  # Hz, as in ros2 bag play
_MIN_ROUND = 0.1  # minimum duration of a round with --loop, s


_SOURCE = (
    positional("BAG", "a folder of rosbag2, or its .mcap or .db3 file"),
    option("--max-size", "MB", "largest message or chunk that is read (256)", positive, 256.0),
)


def info(args: Namespace) -> None:
    """Show what a recording contains."""
    with KeyboardInterrupts():  # Ctrl-C leaves no temporary files
        bag = _open(args)
        print(_information(bag))


def _open(args: Namespace) -> "Bag":
    from onebot_bringup.bags.bag_reader import Bag

    bag = Bag(Path(args.bag).expanduser(), int(args.max_size * 1e6))
    _warn_of(bag)
    return bag


def _warn_of(bag: "Bag") -> None:
    """Print the warnings, each once."""
    for warning in bag.warnings:
        warn(warning)
    bag.warnings.clear()


def _information(bag: "Bag") -> str:
    """Return the text that ros2 bag info prints."""
    size = sum(file.stat().st_size for file in bag.files)
    topics = [
        f"Topic: {name} | Type: {bag.topics[name]} | Count: {bag.counts[name]} | "
        "Serialization Format: cdr"
        for name in sorted(bag.topics)
    ]
    rows = {
        "Files": _column([file.name for file in bag.files]),
        "Bag size": _size(size),
        "Storage id": bag.storage,
        "Duration": f"{_seconds(bag.end_ns - bag.start_ns)}s",
        "Start": _date(bag.start_ns) if bag.count else "-",
        "End": _date(bag.end_ns) if bag.count else "-",
        "Messages": str(bag.count),
        "Topic information": _column(topics),
    }
    return "\n" + "\n".join(f"{f'{title}:':18} {text}" for title, text in rows.items()) + "\n"


def _column(lines: Sequence[str]) -> str:
    return f"\n{'':19}".join(lines)


def _size(number: float) -> str:
    for unit in ("B", "KiB", "MiB"):
        if number < 1024:
            return f"{number:.1f} {unit}" if unit != "B" else f"{number:.0f} B"
        number /= 1024
    return f"{number:.1f} GiB"


def _seconds(nanoseconds: int) -> str:
    seconds, remainder = divmod(nanoseconds, NS_PER_S)
    return f"{seconds}.{remainder:09d}"


def _date(nanoseconds: int) -> str:
    moment = datetime.fromtimestamp(nanoseconds // NS_PER_S)
    return f"{moment:%b %e %Y %H:%M:%S}.{nanoseconds % NS_PER_S:09d} ({_seconds(nanoseconds)})"


def record(args: Namespace) -> int:
    """Record topics until Ctrl-C; return the exit code."""
    topics = [*args.topic, *args.topics]
    if not (topics or args.regex or args.all):
        raise UsageError("onebot bag record: name the topics, or -a for all")
    use_local_discovery()
    from onebot_bringup.bags import bag_recorder  # slow to import

    parameters = {
        "folder": args.output or f"rosbag2_{datetime.now():%Y_%m_%d-%H_%M_%S}",
        "topics": [] if args.all else topics,
        "regex": "" if args.all else args.regex,
        "exclude_regex": args.exclude_regex,
        "compression": args.compression_format,
        "use_sim_time": args.use_sim_time,
    }
    words = [
        word
        for name, value in parameters.items()
        if value
        for word in ("-p", f"{name}:={json.dumps(value)}")  # JSON is YAML
    ]
    return bag_recorder.main(["onebot", "--ros-args", *args.ros_args, *words])


_RECORD = (
    positional("TOPIC", "such as /tf", nargs="*"),
    option("--topics", "TOPIC", "the same", default=[], nargs="+"),
    flag("-a --all", "all topics but hidden ones"),
    option("-e --regex", "REGEX", "topics whose names match this", default=""),
    option("-x --exclude-regex", "REGEX", "but not those whose names match this", default=""),
    option("-o --output", "FOLDER", "a new folder (rosbag2_DATE-TIME)"),
    option(
        "--compression-format", None, "of the messages", default="zstd", choices=("zstd", "none")
    ),
    flag("--use-sim-time", "stamp messages with the time of /clock; recording begins with it"),
)


def play(args: Namespace) -> None:
    """Publish the messages of a recording."""
    ros_args = [*args.ros_args, *(word for rule in args.remap for word in ("-r", rule))]
    with KeyboardInterrupts():  # Ctrl-C leaves no temporary files, also while ROS is imported
        bag = _open(args)
        with Session(ros_args, "rosbag2_player") as session:
            _Player(session, bag, args).run()


_PLAY = (
    *_SOURCE,
    option("-r --rate", "RATE", "2 plays twice as fast (1)", positive, 1.0),
    option("--topics", "TOPIC", "play only these", default=[], nargs="+"),
    option("--exclude-topics", "TOPIC", "play all but these", default=[], nargs="+"),
    flag("-l --loop", "begin again at the end"),
    option("-m --remap", "OLD:=NEW", "publish under other names", default=[], nargs="+"),
    option(
        "--start-offset",
        "S",
        "begin S seconds after the start; earlier messages of latched topics are published, too",
        not_negative,
        0.0,
    ),
    option("--playback-duration", "S", "end after S s", positive),
    option(
        "--clock",
        "HZ",
        f"publish the recording's time on {_CLOCK}, HZ times a second ({_CLOCK_RATE:g})",
        positive,
        nargs="?",
        const=_CLOCK_RATE,
    ),
)


class _Player:
    """Publishes a recording at its own pace."""

    def __init__(self, session: Session, bag: "Bag", args: Namespace) -> None:
        self._session, self._bag, self._args = session, bag, args
        self._begin = bag.start_ns + int(args.start_offset * NS_PER_S)
        self._end = bag.end_ns
        if args.playback_duration is not None:
            self._end = min(self._end, self._begin + int(args.playback_duration * NS_PER_S))
        self._publishers: dict[str, Any] = {}
        self._clock: Any = None
        self._next_tick = self._begin

    def run(self) -> None:
        """Play it once, or with ``--loop`` until Ctrl-C."""
        self._advertise()
        self._session.discover()  # existing subscribers get the first message
        seconds = max(0, self._end - self._begin) / NS_PER_S
        print(f"playing {self._bag.source}: {seconds:.1f} s of {len(self._publishers)} topics")
        while True:
            began = time.monotonic()
            self._play()
            if not self._args.loop:
                break
            # Otherwise a recording of a single moment would flood its topics.
            self._session.spin_until(began + _MIN_ROUND)
        for publisher in self._publishers.values():
            await_acknowledgements(publisher)

    def _advertise(self) -> None:
        """Create the publishers, except those whose name or type ROS rejects."""
        from rosgraph_msgs.msg import Clock

        from onebot_bringup.introspection.interfaces import message_class
        from onebot_description.ros.topic_subscription import RCLError

        for topic in self._chosen():
            try:
                self._session.full_name(topic)
                kind = message_class(self._bag.topics[topic])
                qos = played_qos(self._bag.offered[topic])
                self._publishers[topic] = self._session.node.create_publisher(kind, topic, qos)
            except (OneBotError, RCLError) as error:
                reason = str(error).partition("\n")[0]
                warn(f"{topic} is not played: {reason}")
        if not self._publishers:
            raise OneBotError(f"{self._bag.source} has nothing to play")
        if self._begin > self._bag.end_ns:
            raise OneBotError(f"{self._bag.source} ends before --start-offset")
        if self._args.clock is not None:
            self._clock = self._session.node.create_publisher(Clock, _CLOCK, 10)

    def _chosen(self) -> list[str]:
        args, topics = self._args, self._bag.topics
        for name in (*args.topics, *args.exclude_topics):
            if name not in topics:
                hint = did_you_mean(name, topics, "topics")
                raise OneBotError(f"{self._bag.source} has no topic {name}{hint}")
        excluded_topics = {*args.exclude_topics, *([] if args.clock is None else [_CLOCK])}
        return [topic for topic in args.topics or topics if topic not in excluded_topics]

    def _play(self) -> None:
        latched = {topic for topic in self._publishers if _are_latched(self._bag.offered[topic])}
        started, rate = time.monotonic(), float(self._args.rate)

        def due(stamp: int) -> float:
            return started + (stamp - self._begin) / NS_PER_S / rate

        self._next_tick = self._begin
        for topic, kind, stamp, data in self._bag.messages(list(self._publishers)):
            if kind != self._bag.topics[topic] or stamp < self._begin and topic not in latched:
                continue
            if stamp > self._end:
                break
            self._wait(stamp, due)
            self._publishers[topic].publish(data)
        self._wait(self._end, due)
        _warn_of(self._bag)

    def _wait(self, stamp: int, due: Callable[[int], float]) -> None:
        """Wait until a message is due; meanwhile publish the clock."""
        from rosgraph_msgs.msg import Clock

        from onebot_description.ros.wire.messages import time_message

        while self._clock is not None and self._next_tick <= stamp:
            self._session.spin_until(due(self._next_tick))
            self._clock.publish(Clock(clock=time_message(self._next_tick)))
            self._next_tick += max(1, int(NS_PER_S / self._args.clock * self._args.rate))
        self._session.spin_until(due(stamp))


def _are_latched(offered: Sequence["Qos"]) -> bool:
    return bool(offered) and all(qos.durability == "transient_local" for qos in offered)


def played_qos(offered: Sequence["Qos"]) -> Any:
    """Return the QoS that suits every subscriber of the recorded publishers.

    It is reliable if any of them was (which also suits best-effort subscribers), and latched if all
    were.
    """
    from onebot_description.ros.topic_qos import make_qos

    reliable = not offered or any(qos.reliability == "reliable" for qos in offered)
    return make_qos(_DEPTH, reliable=reliable, latched=_are_latched(offered))


COMMANDS = {
    "info": Subcommand("show what a recording holds", info, *_SOURCE),
    "record": Subcommand("record topics into a new folder", record, *_RECORD),
    "play": Subcommand(
        "publish the messages of a recording", play, *_PLAY, endless=lambda args: args.loop
    ),
}
