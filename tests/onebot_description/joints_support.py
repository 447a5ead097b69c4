"""Small robots for the tests of joint positions."""

from typing import Any

from onebot_description.description import JointSpec, MimicSpec


def joint(name: str, kind: str = "revolute", **changes: Any) -> JointSpec:
    """A joint that goes from -1 to 1 at up to 0.5 a second, unless changed."""
    values: dict[str, Any] = {
        "parent": "base",
        "child": f"{name}_link",
        "xyz": (0.0, 0.0, 0.0),
        "rpy": (0.0, 0.0, 0.0),
        "axis": (1.0, 0.0, 0.0),
        "lower": None if kind == "continuous" else -1.0,
        "upper": None if kind == "continuous" else 1.0,
        "velocity": 0.5,
        "effort": 1.0,
        "mimic": None,
    }
    return JointSpec(name=name, kind=kind, **{**values, **changes})


def mimic(joint_name: str, multiplier: float = 1.0, offset: float = 0.0) -> MimicSpec:
    """A mimic tag."""
    return MimicSpec(joint=joint_name, multiplier=multiplier, offset=offset)
