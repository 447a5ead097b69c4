"""The variables that all nodes of a launch get."""

import os
from collections.abc import Mapping

from onebot_bringup.launcher.console import wants_colour


def environment(values: Mapping[str, str], *, forced: bool) -> dict[str, str]:
    """Return the variables that all nodes get, in addition to this process's own.

    Args:
        values: of the launch arguments.
        forced: ``discovery`` was given, and so goes before the environment's setting.
    """
    variables = {}
    if forced or not os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE"):
        variables["ROS_AUTOMATIC_DISCOVERY_RANGE"] = values["discovery"].upper()
    if values["domain_id"]:
        variables["ROS_DOMAIN_ID"] = values["domain_id"]
    if "RCUTILS_CONSOLE_OUTPUT_FORMAT" not in os.environ:
        # The launcher puts the node's name in front of each line.
        variables["RCUTILS_CONSOLE_OUTPUT_FORMAT"] = "[{severity}] {message}"
    if "RCUTILS_COLORIZED_OUTPUT" not in os.environ and wants_colour(2):
        variables["RCUTILS_COLORIZED_OUTPUT"] = "1"  # to the nodes, the pipe is no terminal
    return variables
