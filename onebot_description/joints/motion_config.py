"""Reading ``motions.<joint>.<key>`` parameters."""

from collections.abc import Mapping

from onebot_description.joints.motions import BLENDS, LINEAR, Constant, Keyframes, Motion, Sine
from onebot_description.joints.problems import Problem
from onebot_description.joints.readers import Reader
from onebot_description.text import did_you_mean

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
        return _pose(reader, base, joint, poses)
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


def _pose(reader: Reader, base: str, joint: str, poses: Poses) -> Constant | None:
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
