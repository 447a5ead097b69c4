"""Parameters that have no effect here, but are accepted, so that files of ros2_control work."""

from typing import Any

from onebot_description.parameters.reader import parameter

IN_EACH_CYCLE = "every controller runs in each control cycle"


def ignored(default: Any, reason: str, **rules: Any) -> Any:
    """Return a dataclass field for a parameter without effect; for ``rules`` see ``parameter``."""
    return parameter(default, f"accepted, without effect: {reason}", **rules)
