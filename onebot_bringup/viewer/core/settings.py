"""Rules for the values of a view's settings, shared by several displays.

A setting is a parameter (see ``onebot_description.parameters.reader``): an entry of a view file
and a ROS parameter of the viewer, such as ``axes.visible``.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from onebot_description.parameters.reader import parameter

Color = tuple[int, int, int]
Rules = Mapping[str, Any]  # keyword arguments of ``parameter``

length: Rules = {"at_least": 0.0}
fraction: Rules = {"at_least": 0.0, "at_most": 1.0}
signed: Rules = {}  # any number, also a negative one
vector: Rules = {"write": "three meters, such as [3.0, -3.0, 2.0]"}
color: Rules = {"at_least": 0, "at_most": 255, "write": "three bytes, such as [48, 48, 48]"}
name_list: Rules = {"write": "a list of names, such as [odom, base_link]"}
# A relative name, so that a namespace applies, or an absolute one.
_TOPIC = re.compile(r"/?[A-Za-z_]\w*(/[A-Za-z_]\w*)*", re.ASCII)
topic: Rules = {"pattern": _TOPIC, "write": "a topic, such as velocity_controller/odom"}
topic_list: Rules = {"pattern": _TOPIC, "write": "a list of topics, such as [plan]"}


def one_of(*choices: str) -> Rules:
    """Return the rules of a setting that is one of some words."""
    return {"choices": choices}


def setting(default: Any, description: str, rules: Rules | None = None) -> Any:
    """Return a dataclass field for a setting.

    Args:
        default: its default value; REQUIRED if the user must give one.
        description: what it does, with its unit.
        rules: what its value may be; by default numbers must be at least 0.
    """
    usual = length if type(default) in (int, float) else {}
    return parameter(default, description, **(usual if rules is None else rules))


@dataclass(frozen=True)
class FrameSettings:
    """The setting of a view that is also a launch argument."""

    fixed_frame: str = setting("", "the frame that stands still; empty: the root of the TF tree")
