"""The arguments of every command that brings up a robot's description."""

import math
import re
from collections.abc import Mapping

from onebot_bringup.launcher.arguments import Argument, UsageError, complete, switch

_LEVELS = ("debug", "info", "warn", "error", "fatal")
_NAMESPACE = re.compile(r"/?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*/?")
_MAX_DOMAIN = 232  # beyond it the ports of DDS (RTPS 2.2, section 9.6.1.1) exceed 65535
_MAX_FREQUENCY = 1000.0  # Hz
_MAX_PORT = 65535
_LOOPBACK = "127.0.0.1"
_OF_STEERING = ("host", "port", "token")


def description_arguments(model: str, joints: str, view: str) -> list[Argument]:
    """Return the arguments; those three are the robot's own defaults."""
    return [
        Argument("model", model, "the robot, a URDF or xacro file"),
        Argument("joints", joints, "parameters of joint_state_publisher, a YAML file"),
        switch("joint_states", True, "run joint_state_publisher; false: the robot has its own"),
        Argument("viewer", "web", "where to see it", ("web", "native", "none")),
        Argument("view", view, "what is shown and from where, .yaml or .rbl; empty: the robot's"),
        Argument("fixed_frame", "", "the frame that stands still; empty: the viewer chooses"),
        Argument("save", "", "record what the viewer gets to this .rrd file"),
        Argument("record", "", "record all topics to this new folder, a rosbag2 in MCAP"),
        switch("reload", True, "take up edits of the model while running"),
        Argument("namespace", "", "the namespace of all nodes"),
        Argument("frame_prefix", "", "prepended to every frame of the robot"),
        Argument("publish_frequency", "0.0", "the most often a transform is sent, Hz; 0: always"),
        switch("ignore_timestamp", False, "send transforms whatever the joint states' stamps say"),
        switch("use_sim_time", False, "take the time from /clock"),
        Argument("log_level", "info", "the least severe log messages shown", _LEVELS),
        Argument("domain_id", "", "ROS_DOMAIN_ID, 0 to 232; empty: the environment's"),
        Argument(
            "discovery",
            "localhost",
            "who sees the nodes; ROS_AUTOMATIC_DISCOVERY_RANGE goes before this default",
            ("localhost", "subnet"),
        ),
    ]


def simulation_arguments(control: str) -> list[Argument]:
    """Return the further arguments of a robot that can be simulated; ``control`` is its default."""
    return [
        switch("sim", True, "simulate it; false: joint_state_publisher moves its joints instead"),
        switch("steer", False, "a page to steer it from, beside its view"),
        Argument("host", _LOOPBACK, "where that page is served; 0.0.0.0: to other computers, too"),
        Argument("port", "8080", "of that page; 0: any"),
        Argument("token", "", "asked for in its address, if host is not this computer"),
        Argument("params_file", control, "parameters of the controller, a YAML file"),
        Argument("x", "0.0", "where it starts, metres in odom"),
        Argument("y", "0.0", "where it starts, metres in odom"),
        Argument("yaw", "0.0", "where it faces at the start, radians"),
        Argument("rate", "", "control steps a second, Hz; empty: as params_file says"),
    ]


def checked_values(declared: list[Argument], given: Mapping[str, str]) -> dict[str, str]:
    """Return a value for each argument.

    Raises:
        UsageError: a name or a value that is not possible.
    """
    values = complete(declared, given)
    _check_number("publish_frequency", values["publish_frequency"], _MAX_FREQUENCY, whole=False)
    prefix = values["frame_prefix"]
    if values.get("sim") == "true" and prefix and not prefix.endswith("/"):
        raise UsageError(f"frame_prefix:={prefix} must end with /, as in frame_prefix:={prefix}/")
    for name in ("x", "y", "yaw"):
        _check_pose(name, values.get(name, "0"))
    if "port" in values:
        _check_number("port", values["port"], _MAX_PORT, whole=True)
    if values.get("steer") == "false":
        for name in _OF_STEERING:
            if name in given:
                raise UsageError(f"{name}:={given[name]} is the steering page's: add steer:=true")
    if values.get("rate"):
        _check_number("rate", values["rate"], _MAX_FREQUENCY, whole=True)
    if values["domain_id"]:
        _check_number("domain_id", values["domain_id"], _MAX_DOMAIN, whole=True)
    namespace = values["namespace"]
    if namespace.strip("/") and not _NAMESPACE.fullmatch(namespace):
        raise UsageError(
            f"namespace:={namespace} is no ROS name; write words of letters, digits and _ that do"
            " not start with a digit, joined by /"
        )
    return values


def _check_pose(name: str, text: str) -> None:
    try:
        finite = math.isfinite(float(text))
    except ValueError:
        finite = False
    if not finite:
        raise UsageError(f"{name}:={text} is not possible; write a number such as 1.5")


def _check_number(name: str, text: str, most: float, *, whole: bool) -> None:
    try:
        number = int(text) if whole else float(text)
    except ValueError:
        number = -1.0
    if not 0 <= number <= most:  # also refuses nan
        kind = "a whole number" if whole else "a number"
        raise UsageError(f"{name}:={text} is not possible; write {kind} from 0 to {most:g}")
