"""What a soak measures, judged: pure, fed with samples; times are seconds since the soak began."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from onebot_control.poses import PlanarPose

_WINDOW = 5.0  # s, of a rate
_BUSY = 3.0  # times as long may a gap be where no processor is free
_LEAST_SAMPLES = 8  # of a process, to judge its growth
_MOST_PARTS = 40  # of its samples
_MOST_POSES = 200  # of odometry that wait for the truth


@dataclass(frozen=True)
class Tolerances:
    """Beyond which a measurement is a finding."""

    gap: float = 1.0  # s between two stamps, without what faults explain
    future: float = 0.02  # s that a stamp may be ahead of the clock
    rate: float = 0.7  # of the nominal rate, in each 5 s without a fault
    position: float = 0.02  # m of odometry error, with `drift` for each metre
    drift: float = 0.01
    heading: float = 0.05  # rad
    jump: float = 0.1  # m between two poses, beyond what `speed` explains
    speed: float = 1.5  # m/s
    warm_up: float = 60.0  # s of each process in which it may grow
    # What a process may grow by while it is watched.
    growth: dict[str, float] = field(
        default_factory=lambda: {"memory": 8.0, "handles": 8.0, "threads": 4.0}
    )


@dataclass
class Violation:
    """Something that went wrong, once or more often."""

    what: str
    at: float  # s, first
    amount: str  # of the worst
    size: float = 0.0  # of the worst, to compare
    count: int = 1
    last: float = 0.0  # s

    def __str__(self) -> str:
        """As a line of the verdict."""
        often = f" ({self.count} times until {clock(self.last)})" if self.count > 1 else ""
        amount = f": {self.amount}" if self.amount else ""
        return f"{clock(self.at)}  {self.what}{amount}{often}"


@dataclass
class Excuse:
    """A time in which topics may be silent."""

    begin: float
    topics: tuple[str, ...]  # parts of their names; "" is one of all
    end: float = math.inf

    def covers(self, topic: str, begin: float, end: float) -> float:
        """Return how many seconds of an interval it explains."""
        if not any(part in topic for part in self.topics):
            return 0.0
        return max(0.0, min(end, self.end) - max(begin, self.begin))


@dataclass
class Stream:
    """The messages of a topic."""

    rate: float  # Hz, nominal
    stamp: float = math.nan  # of the last message
    received: float = -math.inf  # the last message
    count: int = 0
    window: float = 0.0  # since when `in_window` is counted
    in_window: int = 0
    slowest: float = math.inf  # Hz
    longest: float = 0.0  # s without a message that no fault explains
    silent: float = math.nan  # since when, of the last such time that is a finding


@dataclass
class Samples:
    """What one process used over time."""

    times: list[float] = field(default_factory=list)
    values: dict[str, list[float]] = field(default_factory=dict)


class Watch:
    """Judges what is measured."""

    def __init__(self, tolerances: Tolerances | None = None) -> None:
        """Nothing is measured yet."""
        self.tolerances = tolerances or Tolerances()
        self._longest_gap = self.tolerances.gap
        self.findings: dict[str, Violation] = {}
        self.streams: dict[str, Stream] = {}
        self.processes: dict[tuple[str, int], Samples] = {}  # by name and process id
        self.drives: dict[str, OdometryCheck] = {}
        self.stops: list[float] = []  # s from Ctrl-C to the end
        self._excuses: list[Excuse] = []

    def find(
        self, at: float, what: str, amount: str = "", size: float = 0.0, *, again: bool = True
    ) -> None:
        """Add a finding; of the same thing the first time, the worst and the number are kept.

        Args:
            at: s.
            what: it is.
            amount: in words.
            size: to find the worst.
            again: it counts; False for one that goes on.
        """
        known = self.findings.setdefault(what, Violation(what, at, amount, size, 0))
        known.count, known.last = known.count + again, at
        if size > known.size:
            known.amount, known.size = amount, size

    def excuse(self, begin: float, *topics: str) -> Excuse:
        """Explain gaps of topics with these parts in their names, until its ``end`` is set."""
        excuse = Excuse(begin, topics or ("",))
        self._excuses.append(excuse)
        return excuse

    def _explained(self, topic: str, begin: float, end: float) -> float:
        return sum(excuse.covers(topic, begin, end) for excuse in self._excuses)

    @property
    def count(self) -> int:
        """How often something was found."""
        return sum(finding.count for finding in self.findings.values())

    # Messages

    def message(self, topic: str, rate: float, received: float, stamp: float) -> None:
        """Judge a message by its stamp; ``rate`` is the nominal one, Hz."""
        stream = self.streams.get(topic)
        if stream is None:
            stream = self.streams[topic] = Stream(rate, stamp, window=received)
        if stamp < stream.stamp:
            back = stream.stamp - stamp
            self.find(received, f"{topic}: stamps go back", f"by {back:.3f} s", back)
        if (ahead := stamp - received) > self.tolerances.future:
            self.find(received, f"{topic}: stamps in the future", f"by {ahead:.3f} s", ahead)
        self._gap(topic, stream, stamp, received)
        stream.stamp, stream.received = stamp, received
        stream.count += 1
        stream.in_window += 1

    def values(self, topic: str, at: float, *values: "NDArray[np.floating]") -> None:
        """Judge the numbers of a message."""
        if not all(np.isfinite(each).all() for each in values):
            self.find(at, f"{topic}: NaN or infinite")

    def poll(self, now: float, *, busy: bool = False) -> None:
        """Judge silence and rates; call it every second or so.

        Args:
            now: s.
            busy: this process had to wait for a processor: messages may be unread, or lost.
        """
        self._longest_gap = self.tolerances.gap * (_BUSY if busy else 1.0)
        for topic, stream in self.streams.items():
            self._gap(topic, stream, now, now)
            if busy:
                stream.window, stream.in_window = now, 0
            elif now - stream.window >= _WINDOW:
                self._judge_rate(topic, stream, now)
                stream.window, stream.in_window = now, 0

    def _judge_rate(self, topic: str, stream: Stream, now: float) -> None:
        if self._explained(topic, stream.window, now):
            return
        rate = stream.in_window / (now - stream.window)
        stream.slowest = min(stream.slowest, rate)
        if rate < self.tolerances.rate * stream.rate:
            amount = f"{rate:.0f} Hz instead of {stream.rate:.0f} Hz"
            self.find(now, f"{topic}: slow", amount, stream.rate - rate)

    def _gap(self, topic: str, stream: Stream, end: float, now: float) -> None:
        """Judge the time from the last stamp to ``end``."""
        begin = stream.stamp
        if end - begin <= self._longest_gap:
            return
        gap = end - begin - self._explained(topic, begin, end)
        stream.longest = max(stream.longest, gap)
        if gap > self._longest_gap:
            what, amount = f"{topic}: silent", f"for {gap:.1f} s without a reason"
            self.find(now, what, amount, gap, again=stream.silent != begin)
            stream.silent, stream.window, stream.in_window = begin, now, 0

    def is_alive(self, now: float) -> bool:
        """Whether all topics are being received."""
        return bool(self.streams) and all(
            now - stream.received < self.tolerances.gap for stream in self.streams.values()
        )

    # Processes

    def process(self, name: str, pid: int, at: float, **values: float) -> None:
        """Add what a process uses: ``memory`` (MB), ``handles``, ``threads``."""
        samples = self.processes.setdefault((name, pid), Samples())
        samples.times.append(at)
        for kind, value in values.items():
            samples.values.setdefault(kind, []).append(value)

    def judge_growth(self) -> None:
        """Find the processes that grow: that leak."""
        for (name, pid), samples in self.processes.items():
            begin = next(
                (i for i, at in enumerate(samples.times) if at >= self._warm(samples)), None
            )
            if begin is None or len(samples.times) - begin < _LEAST_SAMPLES:
                continue
            times = samples.times[begin:]
            for kind, values in samples.values.items():
                grown = growth(times, values[begin:])
                if grown > self.tolerances.growth[kind]:
                    unit = " MB" if kind == "memory" else ""
                    span = times[-1] - times[0]
                    amount = f"{grown:.0f}{unit} more in {span:.0f} s, now {values[-1]:.0f}{unit}"
                    self.find(times[-1], f"{name} ({pid}): {kind} grow", amount, grown)

    def used_now(self) -> list[dict[str, float]]:
        """Return what each process used last, of those that were sampled with the last one."""
        newest = max((s.times[-1] for s in self.processes.values()), default=0.0)
        return [
            {kind: values[-1] for kind, values in samples.values.items()}
            for samples in self.processes.values()
            if newest - samples.times[-1] < 1.0
        ]

    def _warm(self, samples: Samples) -> float:
        return samples.times[0] + self.tolerances.warm_up

    def report(self) -> list[str]:
        """Return what was measured, as lines."""
        lines = []
        for topic, stream in self.streams.items():
            slowest = "" if math.isinf(stream.slowest) else f"at least {stream.slowest:.0f} Hz, "
            longest = f"longest gap {stream.longest:.2f} s"
            lines.append(f"  {topic}: {stream.count} messages, {slowest}{longest}")
        for name, drive in self.drives.items():
            lines.append(
                f"  {name}: {drive.distance:.1f} m driven, odometry within "
                f"{1e3 * drive.worst:.1f} mm and {math.degrees(drive.worst_heading):.2f} degrees"
            )
        if self.stops:
            lines.append(f"  Ctrl-C: {len(self.stops)} times, at most {max(self.stops):.1f} s")
        lines += [f"  {line}" for line in self._used()]
        return lines

    def _used(self) -> Iterator[str]:
        """Yield a line for each name, of the process that was watched longest."""
        for name in dict.fromkeys(name for name, _ in self.processes):
            of_name = [each for (other, _), each in self.processes.items() if other == name]
            longest = max(of_name, key=lambda each: each.times[-1] - each.times[0])
            used = (
                f"{kind} {values[len(values) // 5]:.0f} to {values[-1]:.0f}"
                for kind, values in longest.values.items()
            )
            span = longest.times[-1] - longest.times[0]
            yield f"{name}, {len(of_name)} processes, one for {span:.0f} s: {', '.join(used)}"


def growth(times: Sequence[float], values: Sequence[float]) -> float:
    """Return by how much values have grown steadily: by the lower quartile of their slopes.

    That of all pairs of samples, or of the medians of some of them that follow each other. A leak
    grows between nearly all, but what has grown once or twice, or goes up and down, does not.
    """
    parts = min(len(times), _MOST_PARTS)
    t, v = (
        np.array([np.median(part) for part in np.array_split(np.asarray(each, float), parts)])
        for each in (times, values)
    )
    first, second = np.triu_indices(parts, 1)
    slopes = (v[second] - v[first]) / (t[second] - t[first])
    return float(np.percentile(slopes, 25) * (times[-1] - times[0]))


class OdometryCheck:
    """The odometry of a robot against the truth: both from where they were first compared."""

    def __init__(self, watch: Watch, name: str) -> None:
        """Findings go to ``watch``, with the robot's name."""
        self._watch, self._name = watch, name
        self.distance = self.worst = self.worst_heading = 0.0  # m, m and rad
        self.restart()
        watch.drives[name] = self

    def restart(self) -> None:
        """The robot starts anew, with its odometry."""
        self._odometry: dict[float, PlanarPose] = {}  # by stamp
        self._origins: tuple[PlanarPose, PlanarPose] | None = None  # of odometry and truth
        self._last: tuple[float, PlanarPose] | None = None  # stamp and truth
        self._driven = 0.0  # m, since then

    def odometry(self, stamp: float, pose: PlanarPose) -> None:
        """Keep a pose until the truth of that time is known."""
        self._odometry[stamp] = pose
        if len(self._odometry) > _MOST_POSES:
            del self._odometry[next(iter(self._odometry))]

    def truth(self, stamp: float, truth: PlanarPose) -> None:
        """Compare."""
        if self._last is not None:
            moved = math.hypot(truth.x - self._last[1].x, truth.y - self._last[1].y)
            self._move(stamp, moved, stamp - self._last[0])
        self._last = stamp, truth
        if (pose := self._odometry.pop(stamp, None)) is not None:
            if self._origins is None:
                self._origins = pose, truth
            self._compare(
                stamp,
                self._origins[0].inverse().compose(pose),
                self._origins[1].inverse().compose(truth),
            )

    def _move(self, stamp: float, moved: float, seconds: float) -> None:
        self.distance += moved
        self._driven += moved
        tolerances = self._watch.tolerances
        if moved > tolerances.jump + tolerances.speed * max(seconds, 0.0):
            self._watch.find(stamp, f"{self._name}: jumps", f"by {moved:.2f} m", moved)

    def _compare(self, stamp: float, pose: PlanarPose, truth: PlanarPose) -> None:
        error = math.hypot(pose.x - truth.x, pose.y - truth.y)
        turn = abs(math.remainder(pose.yaw - truth.yaw, math.tau))
        self.worst, self.worst_heading = max(self.worst, error), max(self.worst_heading, turn)
        tolerances, find = self._watch.tolerances, self._watch.find
        if error > tolerances.position + tolerances.drift * self._driven:
            amount = f"{1e3 * error:.0f} mm after {self._driven:.1f} m"
            find(stamp, f"{self._name}: odometry error", amount, error)
        if turn > tolerances.heading:
            find(stamp, f"{self._name}: heading error", f"{math.degrees(turn):.1f} degrees", turn)


def clock(seconds: float) -> str:
    """Return a time as minutes and seconds."""
    return f"{int(seconds) // 60:02d}:{int(seconds) % 60:02d}"
