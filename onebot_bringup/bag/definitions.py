"""The text that defines a message type: its .msg file, and those of all types in it."""

import re
from functools import cache

from onebot_bringup.introspection.interfaces import definition_file
from onebot_description.errors import OneBotError

_TF_MESSAGE = "tf2_msgs/msg/TFMessage"
_DELIMITER = "=" * 80
_FIELD_TYPE = re.compile(r"^\s*([A-Za-z0-9_/]+)(?:<=\d+)?(?:\[[^]]*\])?\s", re.MULTILINE)
_PRIMITIVE = frozenset(
    "bool byte char float32 float64 int8 uint8 int16 uint16 int32 uint32 int64 uint64 string "
    "wstring".split()
)


@cache
def full_definition(name: str) -> str:
    """Return the definition of a message type as rosbag2 keeps it with the messages.

    The .msg file comes first; those it refers to follow, each once and under a line of its own.

    Args:
        name: such as ``geometry_msgs/msg/Twist``.

    Raises:
        OneBotError: a .msg file is not installed.
    """
    return _joined(name, set())


def _joined(name: str, seen: set[str]) -> str:
    text = _own(name)
    package = name.partition("/")[0]
    parts = [text]
    for kind in sorted({*_FIELD_TYPE.findall(text)} - _PRIMITIVE):
        full = kind if "/" in kind else f"{package}/{kind}"
        if full not in seen:
            seen.add(full)
            home, _, short = full.rpartition("/")
            nested = _joined(f"{home.partition('/')[0]}/msg/{short}", seen)
            parts.append(f"\n{_DELIMITER}\nMSG: {full}\n{nested}")
    return "".join(parts)


def _own(name: str) -> str:
    try:
        return definition_file(name).read_text()
    except OneBotError:
        if name == _TF_MESSAGE:  # ours, where tf2_msgs is not installed
            return "geometry_msgs/TransformStamped[] transforms\n"
        raise
