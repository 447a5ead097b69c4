"""The parameters of a joint state publisher as one checked value."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from onebot_description.errors import did_you_mean
from onebot_description.joints.motions import (
    BLENDS,
    LINEAR,
    MINIMUM_JERK,
    Constant,
    Keyframes,
    Motion,
    Sine,
)
from onebot_description.parameters.reader import ConfigError, Problem, Reader, flatten

# Reading ``motions.<joint>.<key>`` parameters.

Poses = Mapping[str, Mapping[str, float]]

KEYS: dict[str, tuple[str, ...]] = {
    "constant": ("position",),
    "sine": ("amplitude", "frequency", "phase", "offset"),
    "keyframes": ("times", "positions", "poses", "blend", "loop"),
    "pose": ("pose",),
}
_ALL_KEYS = ("type", *(key for keys in KEYS.values() for key in keys))


def read_motion(
    reader: Reader, joint: str, given: set[str], poses: Poses, notes: list[Problem]
) -> Motion | None:
    """Read one joint's motion.

    Args:
        reader: of all parameters; problems go there.
        joint: name of the joint.
        given: the keys written under ``motions.<joint>``.
        poses: the named poses, for those a motion refers to.
        notes: remarks that do not stop the motion are added here.

    Returns:
        The motion, or None if a problem was noted.
    """
    base = f"motions.{joint}"
    for key in sorted(given.difference(_ALL_KEYS)):
        reader.complain(f"{base}.{key}", f"no such key{did_you_mean(key, _ALL_KEYS)}")
    kind = _kind(reader, base, given)
    if kind is None:
        return None
    for key in sorted(given.intersection(_ALL_KEYS).difference(KEYS[kind], ["type"])):
        users = next(name for name, keys in KEYS.items() if key in keys)
        notes.append(Problem(f"{base}.{key}", f"not used by type {kind}, only by type {users}"))
    if kind == "constant":
        return Constant(reader.number(f"{base}.position", 0.0))
    if kind == "sine":
        return _sine(reader, base, given, notes)
    if kind == "pose":
        return _pose_motion(reader, base, joint, poses)
    return _keyframes(reader, base, joint, given, poses)


def _kind(reader: Reader, base: str, given: set[str]) -> str | None:
    """The type as written, else the one type that has all the keys given."""
    if "type" in given:
        kind = reader.text(f"{base}.type")
        if kind in KEYS:
            return kind
        reader.complain(f"{base}.type", f'no motion "{kind}"{did_you_mean(kind, KEYS)}')
        return None
    known = given.intersection(_ALL_KEYS)
    fitting = [kind for kind, keys in KEYS.items() if known and known.issubset(keys)]
    if not fitting and not given.difference(_ALL_KEYS):
        reader.complain(base, f"write its type, one of {', '.join(KEYS)}")
    return fitting[0] if fitting else None


def _sine(reader: Reader, base: str, given: set[str], notes: list[Problem]) -> Sine:
    missing = [key for key in ("amplitude", "frequency") if key not in given]
    if missing:
        notes.append(Problem(base, f"sine without {' and '.join(missing)} does not swing"))
    frequency = reader.number(f"{base}.frequency", 0.0)
    if frequency < 0.0:
        reader.complain(f"{base}.frequency", f"{frequency:g} Hz is negative; use phase to turn it")
    return Sine(
        amplitude=reader.number(f"{base}.amplitude", 0.0),
        frequency=frequency,
        phase=reader.number(f"{base}.phase", 0.0),
        offset=reader.number(f"{base}.offset", 0.0),
    )


def _pose_motion(reader: Reader, base: str, joint: str, poses: Poses) -> Constant | None:
    name = reader.text(f"{base}.pose")
    position = _pose_position(reader, f"{base}.pose", name, joint, poses)
    return None if position is None else Constant(position, name)


def _keyframes(
    reader: Reader, base: str, joint: str, given: set[str], poses: Poses
) -> Keyframes | None:
    times = reader.numbers(f"{base}.times")
    positions = _keyframe_positions(reader, base, joint, given, poses)
    blend = reader.choice(f"{base}.blend", BLENDS, LINEAR)
    loop = reader.flag(f"{base}.loop", True)
    if positions is None:
        return None
    if not times:
        reader.complain(f"{base}.times", "keyframes need times, such as [0.0, 2.0]")
    elif len(times) != len(positions):
        reader.complain(
            base,
            f"{len(times)} times but {len(positions)} positions; give as many of each, at once",
        )
    elif times[0] < 0.0 or any(b <= a for a, b in zip(times, times[1:], strict=False)):
        reader.complain(f"{base}.times", f"{list(times)} must increase, from 0 on")
    return Keyframes(times, positions, blend, loop)


def _keyframe_positions(
    reader: Reader, base: str, joint: str, given: set[str], poses: Poses
) -> tuple[float, ...] | None:
    """The positions as written, or out of the poses named."""
    if ("positions" in given) == ("poses" in given):
        reader.complain(base, "keyframes need either positions or poses")
        return None
    if "positions" in given:
        return reader.numbers(f"{base}.positions")
    key = f"{base}.poses"
    found = [_pose_position(reader, key, name, joint, poses) for name in reader.texts(key)]
    positions = tuple(position for position in found if position is not None)
    return positions if len(positions) == len(found) else None


def _pose_position(reader: Reader, key: str, name: str, joint: str, poses: Poses) -> float | None:
    if name not in poses:
        reader.complain(key, f'no pose "{name}"{did_you_mean(name, poses, "poses")}')
        return None
    if joint not in poses[name]:
        reader.complain(key, f'pose "{name}" says nothing of this joint; add poses.{name}.{joint}')
        return None
    return poses[name][joint]


MAX_RATE = 1000.0
"""Hz; beyond it a timer only burns the processor."""

DEFAULTS: dict[str, Any] = {
    "rate": 10.0,
    "publish_default_positions": True,
    "publish_default_velocities": False,
    "publish_default_efforts": False,
    "use_mimic_tags": True,
    "use_smallest_joint_limits": True,
    "source_list": [],
    "delta": 0.0,
    "pose": "",
}
"""Every parameter that is not part of a group, with its default."""

GROUPS = ("zeros", "dependent_joints", "motions", "poses", "sequence")

EXAMPLES = {
    "zeros": "{some_joint: 0.5}",
    "dependent_joints": "{some_joint: {parent: other_joint}}",
    "motions": "{some_joint: {type: constant, position: 0.5}}",
    "poses": "{home: {some_joint: 0.5}}",
    "sequence": "{poses: [home, up], durations: [2.0, 2.0]}",
}

NODE_PARAMETERS = (
    "robot_description",
    "config_file",
    "use_sim_time",
    "start_type_description_service",
    "qos_overrides",
)
"""Parameters of the node itself, which say nothing about joints."""


@dataclass(frozen=True)
class Dependent:
    """A joint at ``parent * factor + offset``."""

    parent: str
    factor: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class Sequence:
    """Poses the whole robot goes through; ``durations[i]`` s are taken to reach ``poses[i]``."""

    poses: tuple[str, ...]
    durations: tuple[float, ...]
    blend: str = MINIMUM_JERK
    loop: bool = True


@dataclass(frozen=True)
class JointsConfig:
    """Checked parameters; names as in ROS, positions in rad or m.

    Attributes:
        notes: remarks on parameters that work but probably not as meant.
    """

    rate: float = 10.0
    publish_default_positions: bool = True
    publish_default_velocities: bool = False
    publish_default_efforts: bool = False
    use_mimic_tags: bool = True
    use_smallest_joint_limits: bool = True
    source_list: tuple[str, ...] = ()
    delta: float = 0.0
    zeros: Mapping[str, float] = field(default_factory=dict)
    dependent_joints: Mapping[str, Dependent] = field(default_factory=dict)
    motions: Mapping[str, Motion] = field(default_factory=dict)
    poses: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    pose: str = ""
    sequence: Sequence | None = None
    notes: tuple[Problem, ...] = ()

    @property
    def moves(self) -> bool:
        """Whether any motion is asked for, so that velocities are published too."""
        return bool(self.motions or self.pose or self.sequence or self.delta)

    @classmethod
    def from_parameters(cls, parameters: Mapping[str, Any]) -> "JointsConfig":
        """Check and convert parameters.

        Args:
            parameters: dotted names, or nested maps as YAML gives them, to values.

        Raises:
            ConfigError: with all problems.
        """
        values = flatten(parameters)
        reader = Reader(values)
        groups = _grouped(reader)
        poses = _poses(reader, groups["poses"])
        notes: list[Problem] = []
        config = cls(
            rate=_rate(reader),
            publish_default_positions=reader.flag("publish_default_positions", True),
            publish_default_velocities=reader.flag("publish_default_velocities", False),
            publish_default_efforts=reader.flag("publish_default_efforts", False),
            use_mimic_tags=reader.flag("use_mimic_tags", True),
            use_smallest_joint_limits=reader.flag("use_smallest_joint_limits", True),
            source_list=reader.texts("source_list"),
            delta=_delta(reader),
            zeros={rest: reader.number(f"zeros.{rest}", 0.0) for rest in groups["zeros"]},
            dependent_joints=_dependents(reader, groups["dependent_joints"]),
            motions=_motions(reader, groups["motions"], poses, notes),
            poses=poses,
            pose=_pose(reader, poses),
            sequence=_sequence(reader, groups["sequence"], poses, notes),
            notes=tuple(notes),
        )
        if reader.problems:
            raise ConfigError(reader.problems)
        return config


def unknown_parameters(names: Iterable[str]) -> list[str]:
    """Return those dotted names that no joint state publisher has."""
    groups = (*GROUPS, *NODE_PARAMETERS)
    return [name for name in names if name not in DEFAULTS and name.split(".")[0] not in groups]


def _grouped(reader: Reader) -> dict[str, list[str]]:
    """Sort names such as ``zeros.elbow`` into groups, and complain about all unknown names."""
    groups: dict[str, list[str]] = {group: [] for group in GROUPS}
    known = (*DEFAULTS, *GROUPS)
    for name in unknown_parameters(reader.values):
        top = name.split(".")[0]
        reader.complain(name, f"no such parameter{did_you_mean(top, known)}")
    for name in reader.values:
        group, _, rest = name.partition(".")
        if group in groups and rest:
            groups[group].append(rest)
        elif group in groups:
            reader.complain(name, f"write a map, such as {EXAMPLES[group]}")
    return groups


def _rate(reader: Reader) -> float:
    rate = reader.number("rate", 10.0)
    if not 0.0 < rate <= MAX_RATE:
        reader.complain("rate", f"{rate:g} Hz; write one above 0 and up to {MAX_RATE:g}")
    return rate


def _delta(reader: Reader) -> float:
    delta = reader.number("delta", 0.0)
    if delta < 0.0:
        reader.complain("delta", f"{delta:g} is negative; write a step per message, or 0.0")
    return delta


def _split_last(reader: Reader, group: str, names: list[str], example: str) -> dict[str, set[str]]:
    """Turn ``<joint>.<key>`` into joint -> keys; joint names may hold dots themselves."""
    found: dict[str, set[str]] = {}
    for name in names:
        joint, dot, key = name.rpartition(".")
        if dot:
            found.setdefault(joint, set()).add(key)
        else:
            reader.complain(f"{group}.{name}", f"write a map, such as {example}")
    return found


def _dependents(reader: Reader, names: list[str]) -> dict[str, Dependent]:
    group, keys = "dependent_joints", ("parent", "factor", "offset")
    joints: dict[str, Dependent] = {}
    for joint, given in _split_last(reader, group, names, "{parent: other_joint}").items():
        base = f"{group}.{joint}"
        for key in sorted(given.difference(keys)):
            reader.complain(f"{base}.{key}", f"no such key{did_you_mean(key, keys)}")
        if "parent" not in given:
            reader.complain(base, "write its parent, the joint it depends on")
        joints[joint] = Dependent(
            reader.text(f"{base}.parent"),
            reader.number(f"{base}.factor", 1.0),
            reader.number(f"{base}.offset", 0.0),
        )
    return joints


def _motions(
    reader: Reader, names: list[str], poses: Mapping[str, Mapping[str, float]], notes: list[Problem]
) -> dict[str, Motion]:
    motions: dict[str, Motion] = {}
    example = "{type: constant, position: 0.5}"
    for joint, given in _split_last(reader, "motions", names, example).items():
        motion = read_motion(reader, joint, given, poses, notes)
        if motion is not None:
            motions[joint] = motion
    return motions


def _poses(reader: Reader, names: list[str]) -> dict[str, dict[str, float]]:
    poses: dict[str, dict[str, float]] = {}
    for name in names:
        pose, dot, joint = name.partition(".")
        if dot:
            poses.setdefault(pose, {})[joint] = reader.number(f"poses.{name}", 0.0)
        else:
            reader.complain(f"poses.{name}", "write a map of joints, such as {some_joint: 0.5}")
    return poses


def _pose(reader: Reader, poses: Mapping[str, object]) -> str:
    pose = reader.text("pose")
    if pose and pose not in poses:
        reader.complain("pose", f'no pose "{pose}"{did_you_mean(pose, poses, "poses")}')
    return pose


def _sequence(
    reader: Reader, names: list[str], poses: Mapping[str, object], notes: list[Problem]
) -> Sequence | None:
    keys = ("poses", "durations", "blend", "loop")
    for name in names:
        if name not in keys:
            reader.complain(f"sequence.{name}", f"no such key{did_you_mean(name, keys)}")
    sequence = Sequence(
        reader.texts("sequence.poses"),
        reader.numbers("sequence.durations"),
        reader.choice("sequence.blend", BLENDS, MINIMUM_JERK),
        reader.flag("sequence.loop", True),
    )
    for pose in dict.fromkeys(sequence.poses):
        if pose not in poses:
            hint = did_you_mean(pose, poses, "poses")
            reader.complain("sequence.poses", f'no pose "{pose}"{hint}')
    if any(duration <= 0.0 for duration in sequence.durations):
        reader.complain("sequence.durations", "every duration must be above 0 s")
    # One of the two alone is a robot at rest, so that each can be set alone while it runs.
    missing = [key for key in ("poses", "durations") if not getattr(sequence, key)]
    if missing:
        if names:
            notes.append(Problem("sequence", f"without {' and '.join(missing)} nothing moves"))
        return None
    if len(sequence.poses) != len(sequence.durations):
        reader.complain(
            "sequence",
            f"{len(sequence.poses)} poses but {len(sequence.durations)} durations;"
            " give as many of each, at once",
        )
    return sequence
