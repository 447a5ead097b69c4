"""The view that belongs to a robot: the one saved in the config/ of its description."""

import re
from pathlib import Path

from onebot_description.ament import package_share
from onebot_description.errors import OneBotError

_VIEW = Path("config/view.yaml")
# What a robot's name must be for a package to be named after it (REP-144); also keeps "../" out.
_NAME = re.compile(r"[A-Za-z]\w*", re.ASCII)


def view_for(robot_name: str) -> Path | None:
    """Return the saved view of the robot, as its URDF names it; None if there is none.

    It is ``config/view.yaml`` in the share folder of the package ``<robot_name>_description``,
    found as every ROS package is, also one of the user's own workspace.
    """
    if not _NAME.fullmatch(robot_name):
        return None
    try:
        path = package_share(f"{robot_name}_description") / _VIEW
    except OneBotError:
        return None  # most robots have no package of that name
    return path if path.is_file() else None
