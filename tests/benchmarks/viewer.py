"""What the viewer costs for each robot state and message, against bare calls of Rerun.

The viewer receives raw messages as its node does, decodes and draws them, 20 times a second. The
floor is a ``send_columns`` of the same rows, whose arrays lie ready, with columns as Rerun's own
makers make them; the viewer may be cheaper, since it makes its columns itself and keeps those of
names. Both write a file; then both files are read again, and must hold what was to be shown.
"""

import time
import warnings
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import onebot_bringup.viewer  # noqa: F401  before Rerun, whose log it quiets

# isort: split
import numpy as np
import rerun as rr
import rerun.chunk
from builtin_interfaces.msg import Time
from numpy.typing import NDArray
from rclpy.serialization import serialize_message
from std_msgs.msg import String

from onebot_bringup.viewer.core.columns import TIMELINE
from onebot_bringup.viewer.core.inbox import DESCRIPTION
from onebot_bringup.viewer.core.transform_stream import TF
from onebot_bringup.viewer.display_server import Recording, open_recording
from onebot_bringup.viewer.robot_view import RobotView
from onebot_description.ros.wire.messages import transforms_message
from onebot_description.timing import NS_PER_S
from tests.benchmarks.cases import CASES, FIXED, SENSOR, STAMP, Arrays, Case, Drawn
from tests.benchmarks.measuring import WrongAnswer, in_turn, median, over
from tests.benchmarks.report import Report, Result

FLOOR, OURS = "bare send_columns", "viewer"
_START_NS = 1_700_000_000_000_000_000
_ROUNDING = 1e-5  # of numbers of 32 bits
_VARIANTS = 4  # messages that differ
_BYTES = 2_000_000  # that a round logs, about
_MARK = serialize_message(STAMP)[4:]


class Logger:
    """Logs the messages of a case, some over and over with other stamps."""

    def __init__(self, case: Case, recording: Recording) -> None:
        self.case, self.recording = case, recording
        samples = [case.sample(number) for number in range(_VARIANTS)]
        self.drawn = [drawn for _, drawn in samples]
        self.raw = [
            [bytes(serialize_message(each)) for each in messages] for messages, _ in samples
        ]
        self.logged = 0

    def stamp(self, number: int) -> int:
        """When a message is, nanoseconds."""
        return _START_NS + number * (self.case.tick_ns // self.case.per_tick)

    def log(self, ticks: int) -> float:
        """Log so many ticks' messages; return the processor time of each, of all threads, us."""
        count = ticks * self.case.per_tick
        firsts = range(self.logged, self.logged + count, self.case.per_tick)
        calls = [self.prepare(range(first, first + self.case.per_tick)) for first in firsts]
        self.logged += count
        began = time.process_time()
        for call in calls:
            call()
        self.recording.stream.flush(timeout_sec=10.0)
        return 1e6 * (time.process_time() - began) / count

    def prepare(self, numbers: range) -> Callable[[], object]:
        """Return what logs the messages of a tick."""
        raise NotImplementedError

    def finish(self) -> None:
        """Log what is kept back."""


class Viewer(Logger):
    """Receives raw messages and logs them as the viewer's node does."""

    def __init__(self, case: Case, file: Path) -> None:
        super().__init__(case, open_recording(save=file))
        self._view = RobotView(self.recording.stream, report=_refuse)
        self._view.offer(case.topics)
        urdf = bytes(serialize_message(String(data=case.urdf)))
        self._view.take("robot_description", DESCRIPTION.name, urdf, _START_NS)
        place = np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]])
        sensor = bytes(serialize_message(transforms_message(Time(), [FIXED], [SENSOR], place)))
        self._view.take("/tf_static", TF.name, sensor, _START_NS)

    def prepare(self, numbers: range) -> Callable[[], object]:
        """Return what takes and shows raw messages."""
        taken = []
        for number in numbers:
            stamp = np.array(divmod(self.stamp(number), NS_PER_S), "<u4").tobytes()
            for name, data in zip(self.case.topics, self.raw[number % _VARIANTS], strict=True):
                message = data.replace(_MARK, stamp)
                taken.append((name, self.case.topics[name], message, self.stamp(number)))
        return partial(self._show, taken)

    def _show(self, taken: list[tuple[str, str, bytes, int]]) -> None:
        for message in taken:
            self._view.take(*message)
        self._view.tick(taken[-1][-1])

    def finish(self) -> None:
        self._view.finish()


def _refuse(topic: str, error: Exception) -> None:
    raise WrongAnswer(f"the viewer takes a message of {topic} for none: {error}")


class Bare(Logger):
    """Logs the same by nothing but Rerun's own calls."""

    def __init__(self, case: Case, file: Path) -> None:
        stream = rr.RecordingStream("bare")
        stream.set_sinks(rr.FileSink(file, write_footer=False))
        super().__init__(case, Recording(stream, None))

    def prepare(self, numbers: range) -> Callable[[], object]:
        """Return what sends the arrays of messages."""
        stamps = np.array([self.stamp(number) for number in numbers], "datetime64[ns]")
        samples = [self.drawn[number % _VARIANTS] for number in numbers]
        sent = []
        for drawn, arrays in zip(self.case.drawn, zip(*samples, strict=True), strict=True):
            joined = {name: np.concatenate([each[name] for each in arrays]) for name in arrays[0]}
            sent.append((drawn, np.repeat(stamps, drawn.rows), joined))
        return partial(self._send, sent, len(stamps))

    def _send(self, sent: list[tuple[Drawn, NDArray[Any], Arrays]], count: int) -> None:
        for drawn, stamps, arrays in sent:
            times = rr.TimeColumn(TIMELINE, timestamp=stamps)
            columns = drawn.columns(arrays, count)
            self.recording.stream.send_columns(drawn.entity, indexes=[times], columns=columns)


def run(quick: bool) -> Report:
    """Measure all cases."""
    results = []
    for case in CASES:
        taken = measure(case, quick)
        what = f"{case.name}: CPU per message"
        results += [
            Result(what, median(taken[OURS]), unit="us"),
            Result(f"{what} over bare calls", over(taken[OURS], taken[FLOOR]), case.goal),
        ]
    return results


def measure(case: Case, quick: bool) -> dict[str, list[float]]:
    """Log messages in turn; return the time of each, a number a round.

    Raises:
        WrongAnswer: a file does not hold what was to be shown.
    """
    with TemporaryDirectory() as folder:
        files = {OURS: Path(folder) / "ours.rrd", FLOOR: Path(folder) / "bare.rrd"}
        viewer, bare = Viewer(case, files[OURS]), Bare(case, files[FLOOR])
        bytes_a_tick = case.per_tick * sum(map(len, viewer.raw[0]))
        ticks = 4 if quick else min(200, max(10, _BYTES // bytes_a_tick))
        for logger in (viewer, bare):
            logger.log(ticks)  # to get warm
        variants = {OURS: lambda: viewer.log(ticks), FLOOR: lambda: bare.log(ticks)}
        taken = in_turn(variants, 1 if quick else 15)
        for name, logger in ((OURS, viewer), (FLOOR, bare)):
            logger.finish()
            logger.recording.close()
            check(logger, files[name], name)
    return taken


def check(logger: Logger, file: Path, name: str) -> None:
    """Compare what is in a file with what was to be shown.

    Raises:
        WrongAnswer: it is not the same.
    """
    for index, drawn in enumerate(logger.case.drawn):
        what = f"{name}, {logger.case.name}: {drawn.entity}"
        samples = [arrays[index] for arrays in logger.drawn]
        rows = 0
        for rows, (stamp_ns, found) in enumerate(_rows(file, f"/{drawn.entity}", samples[0]), 1):
            number, part = divmod(rows - 1, drawn.rows)
            if stamp_ns != logger.stamp(number):
                raise WrongAnswer(f"{what}: message {number} is at {stamp_ns} ns")
            for column, expected in samples[number % _VARIANTS].items():
                if not _alike(found[column], expected if drawn.rows == 1 else expected[part]):
                    raise WrongAnswer(f"{what}: {column} of message {number} differs")
        if rows != logger.logged * drawn.rows:
            raise WrongAnswer(f"{what}: {rows} rows in the file, {logger.logged} messages logged")


def _rows(file: Path, entity: str, names: Arrays) -> Iterator[tuple[int, Arrays]]:
    """Yield the time of each row of an entity, and what some of its columns are from then on."""
    last: dict[str, NDArray[Any]] = {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # it is experimental
        reader = rerun.chunk.RrdReader(str(file))
    for chunk in reader.stream():
        if str(chunk.entity_path) != entity or chunk.is_static:
            continue
        batch = chunk.to_record_batch()
        columns = {name: batch.column(name) for name in names if name in batch.schema.names}
        stamps = batch.column(TIMELINE).cast("int64").to_pylist()
        for row, stamp_ns in enumerate(stamps):
            for name, column in columns.items():
                if (values := column[row].values) is not None:
                    last[name] = _numbers(values)
            yield stamp_ns, last


def _numbers(array: Any) -> NDArray[Any]:
    while hasattr(array, "flatten") and array.type.num_fields:
        array = array.flatten()
    values: NDArray[Any] = array.to_numpy(zero_copy_only=False)
    return values


def _alike(found: NDArray[Any], expected: Any) -> bool:
    """Whether numbers are the same, and the bytes of colors within a step of rounding."""
    expected = np.asarray(expected).ravel()
    if found.size != expected.size:
        return False
    if found.dtype == object:
        return found.tolist() == expected.tolist()
    if found.dtype.kind == "f":
        return bool(np.abs(found - expected).max(initial=0.0) <= _ROUNDING)
    steps = found.view(np.uint8).astype(np.int16) - expected.view(np.uint8)
    return bool(np.abs(steps).max(initial=0) <= (1 if found.dtype == np.uint32 else 0))
