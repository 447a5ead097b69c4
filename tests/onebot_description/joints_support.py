"""Small robots for the tests of joint positions."""

from typing import Any

from onebot_description.description import Joint, Mimic
from onebot_description.joints.config import JointsConfig
from onebot_description.joints.source import JointStateSource
from onebot_description.ros.parameters.reader import Problem


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


def configure(source: JointStateSource, config: JointsConfig) -> tuple[Problem, ...]:
    """Apply new parameters, and return the warnings on them."""
    source.apply(source.prepare(config))
    return source.reports
