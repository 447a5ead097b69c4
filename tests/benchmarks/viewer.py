"""What the viewer's own work costs for each robot state, against bare calls of the same data.

A robot state is a message of /tf and one of /joint_states, as raw bytes, at 100 Hz. The viewer
receives them as its node does and logs the new ones 20 times a second: 5 states a call. The floor
is two ``send_columns`` of the same rows, whose arrays lie ready, with columns as Rerun's own makers
make them; the viewer may be cheaper, since it makes its columns itself and keeps those of names.
Both write a file. Then both files are read again, and must hold the same.
"""

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import onebot_bringup.viewer  # noqa: F401  before Rerun, whose log it quiets

# isort: split
import numpy as np
import rerun as rr
from builtin_interfaces.msg import Time
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Header, String

from onebot_bringup.viewer.columns import TIMELINE
from onebot_bringup.viewer.display_server import Recording, open_recording
from onebot_bringup.viewer.displays.display import SELDOM
from onebot_bringup.viewer.displays.joint_plot import JOINT_STATE
from onebot_bringup.viewer.displays.tf_display import TF, TF_ENTITY
from onebot_bringup.viewer.inbox import DESCRIPTION
from onebot_bringup.viewer.robot_view import RobotView
from onebot_description.wire.cdr import DOUBLES_PER_TRANSFORM, NANO, Writer
from onebot_description.wire.messages import transforms_message
from tests.benchmarks.chains import Chain, Floats
from tests.benchmarks.measuring import WrongAnswer, in_turn, median
from tests.benchmarks.recorded import Frames, read_frames
from tests.benchmarks.report import Goal, Options, Report, Value, at_most

FLOOR, OURS = "bare send_columns", "viewer"
_PER_CALL = 5
_PERIOD_NS = 10_000_000
_START_NS = 1_700_000_000_000_000_000
_VARIANTS = 50  # states that differ
_GOAL = 1.5
_GOALS_FOR = (10, 100)
_POSITIONS = "joints/position/0"
# Rerun keeps numbers of 32 bits: that is the most by which one of up to 1 may be off.
_ROUNDING = 1e-7


class States(NamedTuple):
    """States of a chain, over and over the same but for their stamps."""

    chain: Chain  # that moves
    positions: Floats  # (S, N), rad
    transforms: Floats  # (S, N, 7), translation and rotation
    tf: list[np.ndarray]  # (S) serialized TFMessages, but for their stamps
    stamps_at: np.ndarray  # (N, 2) where those are in a TFMessage, as words of four bytes
    joints: list[bytearray]  # (S) serialized JointStates, but for their stamps

    @classmethod
    def of(cls, joints: int) -> "States":
        """Return states of a chain of so many joints."""
        chain = Chain(joints)
        positions = chain.positions(_VARIANTS)
        transforms = chain.transforms(positions)
        parents, children = chain.links[:-1], chain.links[1:]
        tf = [
            np.frombuffer(
                bytearray(serialize_message(transforms_message(Time(), parents, children, row))),
                "<u4",
            )
            for row in transforms
        ]
        messages = [
            bytearray(
                serialize_message(
                    JointState(header=Header(), name=list(chain.joints), position=row.tolist())
                )
            )
            for row in positions
        ]
        return cls(chain, positions, transforms, tf, _stamps_at(parents, children), messages)

    def raw(self, number: int) -> tuple[bytes, bytes]:
        """Return the TFMessage and the JointState of a state, as bytes."""
        row = number % _VARIANTS
        tf, joints = self.tf[row], self.joints[row]
        stamp = np.array(divmod(self.stamp(number), NANO), "<u4")
        tf[self.stamps_at] = stamp
        joints[4:12] = stamp.tobytes()
        return tf.tobytes(), bytes(joints)

    def stamp(self, number: int) -> int:
        """When a state is, nanoseconds."""
        return _START_NS + number * _PERIOD_NS


def _stamps_at(parents: Sequence[str], children: Sequence[str]) -> np.ndarray:
    """Return where the stamps of transforms are in a TFMessage, (N, 2) words of four bytes."""
    message = Writer()
    message.u32(len(parents))
    stamps = []
    for parent, child in zip(parents, children, strict=True):
        stamps.append(message.leave_out(8, 4))
        message.string(parent)
        message.string(child)
        message.leave_out(8 * DOUBLES_PER_TRANSFORM, 8)
    return np.array(stamps)[:, None] // 4 + np.arange(2)


class Viewer:
    """Receives raw messages and logs them as the viewer's node does."""

    def __init__(self, states: States, file: Path) -> None:
        self._states = states
        self.recording: Recording = open_recording(save=file)
        self._view = RobotView(self.recording.stream, report=refuse)
        urdf = bytes(serialize_message(String(data=states.chain.urdf())))
        self._view.take("robot_description", DESCRIPTION.name, urdf, _START_NS)
        self._now_ns = 0

    def prepare(self, first: int, count: int) -> list[list[tuple[bytes, bytes]]]:
        """Return the messages of states, by call."""
        numbers = range(first, first + count)
        messages = [self._states.raw(number) for number in numbers]
        return [messages[at : at + _PER_CALL] for at in range(0, count, _PER_CALL)]

    def log(self, calls: list[list[tuple[bytes, bytes]]]) -> None:
        """Take in messages, and log them."""
        take = self._view.take
        for messages in calls:
            for tf, joints in messages:
                take("/tf", TF.name, tf, self._now_ns)
                take("joint_states", JOINT_STATE.name, joints, self._now_ns)
            self._now_ns += SELDOM  # every display logs at every tick
            self._view.tick(self._now_ns)


def refuse(topic: str, error: Exception) -> None:
    """Do not go on after a message that was not understood.

    Raises:
        WrongAnswer: always.
    """
    raise WrongAnswer(f"the viewer takes a message of {topic} for none: {error}")


class Columns(NamedTuple):
    """The arrays of one call."""

    transform_stamps: np.ndarray  # (S * N,), nanoseconds
    translations: Floats  # (S * N, 3), m
    rotations: Floats  # (S * N, 4), x y z w
    state_stamps: np.ndarray  # (S,), nanoseconds
    positions: Floats  # (S * N,), rad


def bare_recording(file: Path) -> Recording:
    """Open a recording as Rerun has it, without what is ours."""
    stream = rr.RecordingStream("bare")
    stream.set_sinks(rr.FileSink(file, write_footer=False))
    return Recording(stream, None)


class Bare:
    """Logs the same by nothing but Rerun's own calls."""

    def __init__(self, states: States, file: Path) -> None:
        self._states = states
        self.recording = bare_recording(file)
        self._parents = list(states.chain.links[:-1]) * _PER_CALL
        self._children = list(states.chain.links[1:]) * _PER_CALL

    def prepare(self, first: int, count: int) -> list[Columns]:
        """Return the arrays of states, by call."""
        return [self._columns(at, _PER_CALL) for at in range(first, first + count, _PER_CALL)]

    def _columns(self, first: int, count: int) -> Columns:
        states, joints = self._states, len(self._states.chain.joints)
        rows = np.arange(first, first + count) % _VARIANTS
        stamps = np.array([states.stamp(first + number) for number in range(count)], np.int64)
        transforms = states.transforms[rows].reshape(-1, 7)
        return Columns(
            np.repeat(stamps, joints),
            np.ascontiguousarray(transforms[:, :3]),
            np.ascontiguousarray(transforms[:, 3:]),
            stamps,
            states.positions[rows].ravel(),
        )

    def log(self, calls: list[Columns]) -> None:
        """Log the arrays."""
        stream, joints = self.recording.stream, len(self._states.chain.joints)
        for columns in calls:
            stream.send_columns(
                TF_ENTITY,
                indexes=[_times(columns.transform_stamps)],
                columns=rr.Transform3D.columns(
                    translation=columns.translations,
                    quaternion=columns.rotations,
                    parent_frame=self._parents,
                    child_frame=self._children,
                ),
            )
            lengths = [joints] * len(columns.state_stamps)
            stream.send_columns(
                _POSITIONS,
                indexes=[_times(columns.state_stamps)],
                columns=rr.Scalars.columns(scalars=columns.positions).partition(lengths),
            )


def _times(stamps_ns: np.ndarray) -> rr.TimeColumn:
    return rr.TimeColumn(TIMELINE, timestamp=stamps_ns.astype("datetime64[ns]"))


class Logger:
    """Times one of the two."""

    def __init__(self, what: Any) -> None:
        self.what = what
        self.logged = 0

    def log(self, count: int) -> float:
        """Log so many; return the processor time of each, of all threads, us."""
        calls = self.what.prepare(self.logged, count)
        self.logged += count
        began = time.process_time()
        self.what.log(calls)
        self.what.recording.stream.flush(timeout_sec=10.0)
        return 1e6 * (time.process_time() - began) / count


def run(options: Options) -> Report:
    """Measure chains of several lengths."""
    counts = (10,) if options.quick else (10, 30, 100, 300, 1000)
    rows: list[dict[str, Value]] = []
    goals: list[Goal] = []
    for joints in counts:
        options.say(f"viewer: {joints} joints")
        taken = measure(joints, options)
        pairs = zip(taken[OURS], taken[FLOOR], strict=True)
        over = median([ours / floor for ours, floor in pairs])
        ours, floor = median(taken[OURS]), median(taken[FLOOR])
        names = ("Joints", "CPU us/state", "bare", "over bare")
        rows.append(dict(zip(names, (joints, ours, floor, over), strict=True)))
        if joints in _GOALS_FOR:
            goals.append(at_most(f"{joints} joints: CPU per state over bare calls", over, _GOAL))
    notes = [
        f"A state is a message of /tf and one of /joint_states; {_PER_CALL} states a call, as at "
        "100 Hz. Bare calls have their arrays ready, and columns as Rerun's own makers make them; "
        "the viewer decodes messages, and makes its columns with less. Processor time of all "
        "threads, Rerun's too, which write a file. All that was logged was read from the files "
        "again, and is the same."
    ]
    return Report("viewer", rows, goals, notes)


def measure(joints: int, options: Options) -> dict[str, list[float]]:
    """Log states in turn; return the time of each, a number a round.

    Raises:
        WrongAnswer: a file does not hold what was logged.
    """
    states = States.of(joints)
    count = _PER_CALL * max(2, options.choose(20_000, 200) // (joints * _PER_CALL))
    with TemporaryDirectory() as folder:
        files = {name: Path(folder) / f"{number}.rrd" for number, name in enumerate((OURS, FLOOR))}
        makers: dict[str, Callable[[States, Path], Viewer | Bare]] = {OURS: Viewer, FLOOR: Bare}
        whats = {name: make(states, files[name]) for name, make in makers.items()}
        loggers = {name: Logger(what) for name, what in whats.items()}
        for logger in loggers.values():
            logger.log(count)  # to get warm
        variants = {name: (lambda it=it: it.log(count)) for name, it in loggers.items()}
        taken = in_turn(variants, options.choose(9, 1))
        for name, what in whats.items():
            what.recording.close()
            check(states, loggers[name].logged, read_frames(files[name]), name)
    return taken


def check(states: States, count: int, frames: Frames, name: str) -> None:
    """Compare what is in a file with what was logged.

    Raises:
        WrongAnswer: it is not the same.
    """
    numbers = np.arange(count)
    joints = len(states.chain.joints)
    stamps = np.repeat(_START_NS + numbers * _PERIOD_NS, joints)
    if not np.array_equal(frames.stamps_ns, stamps):
        raise WrongAnswer(
            f"{name}: {len(frames.stamps_ns)} rows in the file, and {len(stamps)} logged; or at "
            "other times"
        )
    if frames.children != list(states.chain.links[1:]) * count:
        raise WrongAnswer(f"{name}: other child frames in the file than were logged")
    if frames.parents != list(states.chain.links[:-1]) * count:
        raise WrongAnswer(f"{name}: other parent frames in the file than were logged")
    expected = states.transforms[numbers % _VARIANTS].reshape(-1, 7)
    found = np.concatenate([frames.translations, frames.rotations], axis=1)
    error = float(np.abs(found - expected).max())
    if not error <= _ROUNDING:
        raise WrongAnswer(f"{name}: numbers in the file are off by {error:g}")
