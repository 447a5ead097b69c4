"""Small robots for the tests of joint positions."""

from collections.abc import Mapping, Sequence
from typing import Any

from onebot_description.arrays import Floats
from onebot_description.description import Joint, Mimic
from onebot_description.joints.config import JointsConfig
from onebot_description.joints.source import JointStateSource
from onebot_description.parameters.reader import read


def joint(name: str, kind: str = "revolute", **changes: Any) -> Joint:
    """A joint that goes from -1 to 1 at up to 0.5 a second, unless changed."""
    values: dict[str, Any] = {
        "parent": "base",
        "child": f"{name}_link",
        "lower": None if kind == "continuous" else -1.0,
        "upper": None if kind == "continuous" else 1.0,
        "velocity": 0.5,
        "effort": 1.0,
    }
    return Joint(name=name, kind=kind, **{**values, **changes})


def mimic(joint_name: str, multiplier: float = 1.0, offset: float = 0.0) -> Mimic:
    """A mimic tag."""
    return Mimic(joint=joint_name, multiplier=multiplier, offset=offset)


def constant(position: float) -> dict[str, Any]:
    """The parameters of a motion that holds a position."""
    return {"type": "constant", "position": position}


def source_from(joints: Sequence[Joint], parameters: Mapping[str, Any]) -> JointStateSource:
    """What moves these joints with these parameters."""
    return JointStateSource(joints, read(JointsConfig, parameters))


def rest_of(joints: Sequence[Joint], parameters: Mapping[str, Any]) -> Floats:
    """Where these joints are at first with these parameters."""
    return source_from(joints, parameters).sample(0.0)[0]


def configure(source: JointStateSource, parameters: Mapping[str, Any]) -> None:
    """Apply new parameters."""
    source.apply(source.prepare(read(JointsConfig, parameters)))
