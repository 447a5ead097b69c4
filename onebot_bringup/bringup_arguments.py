"""The arguments of every command that brings up a robot's description."""

from collections.abc import Mapping

from onebot_bringup.argument_checks import (
    check_domain,
    check_finite,
    check_namespace,
    check_number,
    check_port,
    check_whole,
)
from onebot_bringup.launcher.arguments import Argument, UsageError, complete, switch

_LEVELS = ("debug", "info", "warn", "error", "fatal")
_MAX_FREQUENCY = 1000  # Hz
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
    check_number("publish_frequency", values["publish_frequency"], 0.0, _MAX_FREQUENCY)
    prefix = values["frame_prefix"]
    if values.get("sim") == "true" and prefix and not prefix.endswith("/"):
        raise UsageError(f"frame_prefix:={prefix} must end with /, as in frame_prefix:={prefix}/")
    for name in ("x", "y", "yaw"):
        check_finite(name, values.get(name, "0"))
    if "port" in values:
        check_port("port", values["port"])
    if values.get("steer") == "false":
        for name in _OF_STEERING:
            if name in given:
                raise UsageError(f"{name}:={given[name]} is the steering page's: add steer:=true")
    if values.get("rate"):
        check_whole("rate", values["rate"], 0, _MAX_FREQUENCY)
    check_domain(values["domain_id"])
    check_namespace(values["namespace"])
    return values
