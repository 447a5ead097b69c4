"""The parameters of joint_state_publisher and their checks."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

from onebot_description.errors import did_you_mean
from onebot_description.joints.motions import (
    BLENDS,
    LINEAR,
    Keyframes,
    Motion,
    Sine,
)
from onebot_description.parameters.reader import REQUIRED, Problem, parameter

Poses = Mapping[str, Mapping[str, float]]


def _constant(given: "MotionParameters", joint: str, poses: Poses) -> Motion:
    return Keyframes.hold(given.position or 0.0)


def _sine(given: "MotionParameters", joint: str, poses: Poses) -> Motion:
    return Sine(
        given.amplitude or 0.0, given.frequency or 0.0, given.phase or 0.0, given.offset or 0.0
    )


def _keyframes(given: "MotionParameters", joint: str, poses: Poses) -> Motion:
    positions = given.positions or tuple(poses[name][joint] for name in given.poses or ())
    blend = given.blend or LINEAR
    return Keyframes(given.times or (), positions, blend, given.loop is not False)


def _check_keyframes(given: "MotionParameters") -> Iterator[Problem]:
    if (given.positions is None) == (given.poses is None):
        yield Problem("", "keyframes need either positions or poses")
        return
    times, positions = given.times or (), given.positions or given.poses or ()
    if len(times) != len(positions):
        counts = f"{len(times)} times but {len(positions)} positions"
        yield Problem("", f"{counts}; give as many of each, in one change")
    elif times[0] < 0.0 or any(b <= a for a, b in zip(times, times[1:], strict=False)):
        yield Problem("times", f"{list(times)} must increase, from 0 on")


def _pose(given: "MotionParameters", joint: str, poses: Poses) -> Motion:
    return Keyframes.hold(poses[given.pose or ""][joint])


# Functions that create a joint's motion, by its type; they ignore parameters of other types.
_KINDS: Mapping[str, Callable[["MotionParameters", str, Poses], Motion]] = {
    "constant": _constant,
    "sine": _sine,
    "keyframes": _keyframes,
    "pose": _pose,
}


@dataclass(frozen=True)
class MotionParameters:
    """The parameters ``motions.<joint>.*``; those not given are None."""

    type: str = parameter(REQUIRED, "the kind of motion", choices=(*_KINDS,))
    position: float | None = parameter(None, "constant: position to hold, rad or m")
    amplitude: float | None = parameter(None, "sine: rad or m")
    frequency: float | None = parameter(None, "sine: Hz", at_least=0.0)
    phase: float | None = parameter(None, "sine: angle at the start, rad")
    offset: float | None = parameter(None, "sine: its middle, rad or m")
    times: tuple[float, ...] | None = parameter(None, "keyframes: increasing, from 0 on, s")
    positions: tuple[float, ...] | None = parameter(None, "keyframes: one per time, rad or m")
    poses: tuple[str, ...] | None = parameter(None, "keyframes: named poses, instead of positions")
    blend: str | None = parameter(
        None, "keyframes: interpolation; linear if not given", choices=BLENDS
    )
    loop: bool | None = parameter(None, "keyframes: start over after the last, unless false")
    pose: str | None = parameter(None, "pose: name of the pose to hold")

    def check(self) -> Iterable[Problem]:
        """Return all problems except unknown poses."""
        return _check_keyframes(self) if self.type == "keyframes" else ()

    def check_poses(self, joint: str, poses: Poses) -> Iterator[Problem]:
        """Yield the problems with the poses that the motion of ``joint`` refers to."""
        named = [("pose", self.pose or "")] if self.type == "pose" else []
        if self.type == "keyframes":
            named = [("poses", name) for name in self.poses or ()]
        for key, name in named:
            if name not in poses:
                yield Problem(key, f'no pose "{name}"{did_you_mean(name, poses, "poses")}')
            elif joint not in poses[name]:
                text = f'pose "{name}" has no position of this joint; add poses.{name}.{joint}'
                yield Problem(key, text)

    def motion(self, joint: str, poses: Poses) -> Motion:
        """Return the motion of ``joint``; the parameters must have passed both checks."""
        return _KINDS[self.type](self, joint, poses)


@dataclass(frozen=True)
class Dependent:
    """The parameters ``dependent_joints.<joint>.*``: a joint at ``parent * factor + offset``."""

    parent: str = parameter(
        REQUIRED,
        "the joint it follows, in place of its mimic tag",
        not_empty=True,
    )
    factor: float = parameter(1.0, "multiplies the parent's position")
    offset: float = parameter(0.0, "added to parent * factor, rad or m")


@dataclass(frozen=True)
class JointsConfig:
    """All parameters of joint_state_publisher; README.md has a table of them.

    Positions are in rad, or m for prismatic joints.
    """

    rate: float = parameter(10.0, "messages per second, Hz", at_least=1e-3, at_most=1e3)
    publish_default_positions: bool = parameter(True, "publish joints that nothing moves")
    publish_default_velocities: bool = parameter(
        False, "publish velocities also when nothing moves"
    )
    publish_default_efforts: bool = parameter(False, "publish zeros as efforts")
    use_mimic_tags: bool = parameter(True, "joints with a mimic tag follow its joint")
    use_smallest_joint_limits: bool = parameter(
        True, "keep to the limits of safety_controller, too"
    )
    source_list: tuple[str, ...] = parameter((), "JointState topics that override all motions")
    delta: float = parameter(
        0.0, "step per message of joints that nothing else moves, rad or m", at_least=0.0
    )
    swing: float = parameter(
        0.0,
        "period in which joints that nothing else moves swing within their limits, s; 0: they rest",
        at_least=0.0,
    )
    zeros: Mapping[str, float] = parameter(
        {},
        "where the joint rests, rad or m; not given: 0, or mid-range if 0 is out of range",
        keys=("joint",),
    )
    dependent_joints: Mapping[str, Dependent] = parameter(
        {}, "joints that follow another", keys=("joint",)
    )
    motion_parameters: Mapping[str, MotionParameters] = parameter(
        {}, "by joint", name="motions", keys=("joint",)
    )
    poses: Poses = parameter(
        {}, "position of the joint in the pose, rad or m", keys=("pose", "joint")
    )
    pose: str = parameter("", "the pose to hold, which overrides all motions; empty: none")
    robot_description: str = parameter("", "the URDF, in place of the topic", read_only=True)

    @cached_property
    def motions(self) -> Mapping[str, Motion]:
        """The motions by joint."""
        motion_items = self.motion_parameters.items()
        return {
            joint: motion_parameters.motion(joint, self.poses)
            for joint, motion_parameters in motion_items
        }

    @property
    def moves(self) -> bool:
        """Whether any motion is configured, so that velocities are published too."""
        return bool(self.motions or self.pose or self.delta or self.swing)

    def check(self) -> Iterator[Problem]:
        """Yield a problem for each pose that does not exist."""
        if self.pose and self.pose not in self.poses:
            hint = did_you_mean(self.pose, self.poses, "poses")
            yield Problem("pose", f'no pose "{self.pose}"{hint}')
        for joint, motion in self.motion_parameters.items():
            for problem in motion.check_poses(joint, self.poses):
                yield Problem(f"motions.{joint}.{problem.key}", problem.text)
