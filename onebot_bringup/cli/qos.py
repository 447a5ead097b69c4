"""Quality of service on the command line: the ``--qos-*`` options, and compatible profiles."""

import argparse
from typing import TYPE_CHECKING, Any

from onebot_bringup.cli.options import Option, natural, option

if TYPE_CHECKING:
    from rclpy.qos import QoSProfile

PRESETS = (
    "default",
    "sensor_data",
    "system_default",
    "best_available",
)
_OTHERS = ("system_default", "best_available")


def options(default: str) -> tuple[Option, ...]:
    """Return the options; ``default`` describes in the help which profile is used without them."""
    policies = {
        "history": ("keep_last", "keep_all", "system_default"),
        "reliability": ("reliable", "best_effort", *_OTHERS),
        "durability": ("transient_local", "volatile", *_OTHERS),
    }
    return (
        option("--qos-profile", None, f"a preset to start from ({default})", choices=PRESETS),
        option("--qos-depth", "N", "queue size", natural),
        *(option(f"--qos-{name}", None, None, choices=policies[name]) for name in policies),
    )


def profile(args: argparse.Namespace, preset: str) -> "QoSProfile":
    """Return the profile that the options define, starting from a preset."""
    from rclpy import qos

    chosen = qos.QoSPresetProfiles.get_from_short_key(args.qos_profile or preset)
    for name in ("history", "reliability", "durability"):
        if key := getattr(args, f"qos_{name}"):
            policy = getattr(qos, f"{name.capitalize()}Policy")
            setattr(chosen, name, policy.get_from_short_key(key))
    if args.qos_depth is not None:
        chosen.depth = args.qos_depth
    return chosen


def matching(node: Any, topic: str, args: argparse.Namespace) -> "QoSProfile":
    """Return the strictest profile that is compatible with all publishers of a topic.

    The options take precedence. Without publishers it is ``sensor_data``, compatible with any.
    """
    from onebot_description.ros.topic_qos import compatible_qos, is_transient_local

    chosen = profile(args, "sensor_data")
    offered = [info.qos_profile for info in node.get_publishers_info_by_topic(topic)]
    is_given = any(value is not None for name, value in vars(args).items() if name[:4] == "qos_")
    if is_given or not offered:
        return chosen
    suited = compatible_qos(offered, chosen.depth)
    if is_transient_local(suited):  # receive everything that publishers of a latched topic keep
        suited.depth = max(suited.depth, 100)
    return suited
