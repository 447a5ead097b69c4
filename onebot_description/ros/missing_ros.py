"""Raises one clear error if ROS 2 is missing, at the first import of one of its packages.

ROS's wheels exist only for Linux on x86-64. An installed ROS works everywhere, once it is sourced;
forgetting that should not end in a traceback.
"""

import sys
from collections.abc import Sequence
from types import ModuleType, TracebackType

from onebot_description.errors import OneBotError

# The imported packages of ROS, except tf2_msgs, which is not required (see wire/interfaces.py).
ROS_PACKAGES = (
    "builtin_interfaces",
    "diagnostic_msgs",
    "geometry_msgs",
    "nav_msgs",
    "rcl_interfaces",
    "rclpy",
    "rosgraph_msgs",
    "rosidl_adapter",
    "rosidl_parser",
    "sensor_msgs",
    "std_msgs",
    "std_srvs",
    "trajectory_msgs",
)
_COMPILED = "rclpy._rclpy_pybind11"


class MissingRosError(OneBotError, ModuleNotFoundError):
    """A package of ROS is missing; ``str(error)`` says what to source or to install."""


class LastFinder:
    """A finder for the end of ``sys.meta_path``, which is asked for modules that were not found."""

    @staticmethod
    def find_spec(
        name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> None:
        """Raise MissingRosError for a package of ROS; do nothing for any other module."""
        if name in ROS_PACKAGES or name == _COMPILED:
            sys.excepthook = _print_error
            raise MissingRosError(_explain(name))


def _explain(name: str) -> str:
    from importlib.machinery import PathFinder  # every command imports this module

    ros = PathFinder.find_spec("rclpy")
    if ros is None:
        return (
            f'no ROS 2 here (there is no Python package "{name}"): source an installed ROS 2 Jazzy '
            "(source /opt/ros/jazzy/setup.bash), activate its RoboStack environment, or, on Linux "
            'on x86-64, pip install "ros-jazzy-rclpy[fastrtps]" ros-jazzy-common-interfaces'
        )
    if name == _COMPILED:
        version = ".".join(map(str, sys.version_info[:2]))
        return (
            f"the ROS 2 of {ros.origin} is made for another Python than this one, {version}: "
            "make the environment with the Python of that ROS, or use a shell without it"
        )
    return (
        f'the ROS 2 of {ros.origin} lacks the package "{name}": install it, '
        f"as in apt install ros-jazzy-{name.replace('_', '-')}"
    )


def _print_error(
    kind: type[BaseException], error: BaseException, traceback: TracebackType | None
) -> None:
    """Print the exception that ended the process; this error without a traceback."""
    if isinstance(error, MissingRosError):
        print(f"error: {error}", file=sys.stderr)
    else:
        sys.__excepthook__(kind, error, traceback)
