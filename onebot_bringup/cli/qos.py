"""Quality of service on the command line: the ``--qos-*`` options, and compatible profiles."""

import argparse
import sys
from typing import TYPE_CHECKING, Any

from onebot_bringup.cli.options import natural, not_negative

if TYPE_CHECKING:
    from rclpy.qos import QoSProfile

PRESETS = (
    "default",
    "sensor_data",
    "system_default",
    "services_default",
    "parameters",
    "parameter_events",
    "best_available",
)
_RELIABILITY = ("reliable", "best_effort", "system_default", "best_available")
_DURABILITY = ("transient_local", "volatile", "system_default", "best_available")
_HISTORY = ("keep_last", "keep_all", "system_default")
_LIVELINESS = ("automatic", "manual_by_topic", "system_default", "best_available")


def add_arguments(parser: argparse.ArgumentParser, default: str) -> None:
    """Add the options; ``default`` describes the profile without them in the help."""
    group = parser.add_argument_group("quality of service", f"Without these: {default}.")
    group.add_argument("--qos-profile", choices=PRESETS, help="a preset to start from")
    group.add_argument("--qos-depth", type=natural, metavar="N", help="queue size")
    group.add_argument("--qos-history", choices=_HISTORY)
    group.add_argument("--qos-reliability", choices=_RELIABILITY)
    group.add_argument("--qos-durability", choices=_DURABILITY)
    group.add_argument("--qos-liveliness", choices=_LIVELINESS)
    group.add_argument(
        "--qos-liveliness-lease-duration-seconds",
        dest="qos_lease",
        type=not_negative,
        metavar="SECONDS",
    )


def given(args: argparse.Namespace) -> bool:
    """Whether any of the options was given."""
    return any(value is not None for name, value in vars(args).items() if name.startswith("qos_"))


def profile(args: argparse.Namespace, preset: str) -> "QoSProfile":
    """Return the profile that the options define, starting from a preset."""
    from rclpy.duration import Duration
    from rclpy.qos import (
        DurabilityPolicy,
        HistoryPolicy,
        LivelinessPolicy,
        QoSPresetProfiles,
        ReliabilityPolicy,
    )

    found = QoSPresetProfiles.get_from_short_key(args.qos_profile or preset)
    if args.qos_history:
        found.history = HistoryPolicy.get_from_short_key(args.qos_history)
    if args.qos_depth is not None:
        found.depth = args.qos_depth
    if args.qos_reliability:
        found.reliability = ReliabilityPolicy.get_from_short_key(args.qos_reliability)
    if args.qos_durability:
        found.durability = DurabilityPolicy.get_from_short_key(args.qos_durability)
        if found.durability == DurabilityPolicy.TRANSIENT_LOCAL and found.depth == 0:
            found.depth = 1  # depth 0 would keep nothing for late subscribers
    if args.qos_liveliness:
        found.liveliness = LivelinessPolicy.get_from_short_key(args.qos_liveliness)
    if args.qos_lease is not None:
        found.liveliness_lease_duration = Duration(seconds=args.qos_lease)
    return found


def matching(node: Any, topic: str, args: argparse.Namespace) -> "QoSProfile":
    """Return the strictest profile that is compatible with all publishers of a topic.

    The options take precedence. Without publishers it is ``sensor_data``, compatible with any.
    """
    from onebot_description.topic_subscription import (
        compatible_qos,
        is_reliable,
        is_transient_local,
    )

    found = profile(args, "sensor_data")
    offered = [info.qos_profile for info in node.get_publishers_info_by_topic(topic)]
    if given(args) or not offered:
        return found
    suited = compatible_qos(offered, found.depth)
    if any(map(is_reliable, offered)) and not is_reliable(suited):
        _warn_fallback("QoSReliabilityPolicy.RELIABLE", "QoSReliabilityPolicy.BEST_EFFORT")
    if any(map(is_transient_local, offered)) and not is_transient_local(suited):
        _warn_fallback("QoSDurabilityPolicy.TRANSIENT_LOCAL", "QoSDurabilityPolicy.VOLATILE")
    if is_transient_local(suited):  # a latched topic delivers everything that its publishers keep
        suited.depth = max(suited.depth, 100)
    return suited


def _warn_fallback(best: str, fallback: str) -> None:
    print(
        f"Some, but not all, publishers are offering {best}. "
        f"Falling back to {fallback} as it will connect to all publishers",
        file=sys.stderr,
    )
