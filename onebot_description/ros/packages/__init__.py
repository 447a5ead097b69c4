"""Packages that ROS 2's wheels lack, importable by their own names, and their import finder.

Each folder here is a package: Python code (``__init__.py``), or interfaces (``msg/``, ``srv/``,
``action/``), whose classes are made from their definitions. Python asks ``PackageFinder`` last, so
that a package that is installed or sourced takes precedence. ``onebot_packages.pth`` installs it in
every Python of the environment; it imports this module with the first package.

The same finder raises one clear error if ROS 2 itself is missing: its wheels exist only for Linux
on x86-64. An installed ROS works everywhere, once it is sourced; forgetting that should not end in
a traceback.
"""

import os
import sys
from collections.abc import Sequence
from types import ModuleType, TracebackType

from onebot_description.errors import OneBotError

TYPE_CHECKING = not __name__  # false; typing is slow
if TYPE_CHECKING:
    from importlib.machinery import ModuleSpec
    from typing import Any

# The imported packages of ROS that its wheels have.
ROS_PACKAGES = (
    "builtin_interfaces diagnostic_msgs geometry_msgs lifecycle_msgs nav_msgs rcl_interfaces rclpy "
    "rosgraph_msgs rosidl_adapter rosidl_parser sensor_msgs std_msgs std_srvs trajectory_msgs"
).split()
_COMPILED = "rclpy._rclpy_pybind11"
_ROS = "share/ament_index/resource_index/packages/rclpy"  # below the prefix of a ROS


class MissingRosError(OneBotError, ModuleNotFoundError):
    """A package of ROS is missing; ``str(error)`` says what to source or to install."""


class PackageFinder:
    """A finder at the end of ``sys.meta_path``, for modules that no other finder has."""

    is_onebot = True

    @staticmethod
    def find_spec(
        name: str, path: "Sequence[str] | None" = None, target: "ModuleType | None" = None
    ) -> "ModuleSpec | None":
        """Return the spec of a module of a package here; None for any other module.

        Raises:
            MissingRosError: the module is part of the ROS wheels or of an installed ROS.
        """
        if later := _later_spec(name, path, target):
            return later
        _check_ros(name)
        return _own_spec(name)


def install() -> None:
    """Make Python ask PackageFinder last, in place of the finder of onebot_packages.pth."""
    for place, finder in enumerate(sys.meta_path):
        if getattr(finder, "is_onebot", False):
            sys.meta_path[place] = PackageFinder
            return
    sys.meta_path.append(PackageFinder)


def _later_spec(*query: "Any") -> "ModuleSpec | None":
    """Return a spec from finders that were installed after this one: they take precedence."""
    for finder in sys.meta_path[sys.meta_path.index(PackageFinder) + 1 :]:
        if (find_spec := getattr(finder, "find_spec", None)) and (spec := find_spec(*query)):
            later: ModuleSpec = spec
            return later
    return None


def _own_spec(name: str) -> "ModuleSpec | None":
    """Return the spec of a package here, or of a module with its interfaces."""
    package, *inner = name.split(".")
    folder = os.path.join(os.path.dirname(__file__), package)
    added = f"{sys.prefix}/share/onebot_interfaces/{package}"
    # First, because most modules that are not found have nothing to do with ROS.
    is_here = os.path.exists(folder) or os.path.exists(added) or "ROS_PACKAGE_PATH" in os.environ
    if not is_here or _is_replaced():
        return None
    from importlib.machinery import ModuleSpec
    from importlib.util import spec_from_file_location

    code = os.path.join(folder, "__init__.py")
    if os.path.isfile(code) and not inner:  # Python finds the modules of the folder itself
        return spec_from_file_location(name, code, submodule_search_locations=[folder])
    from onebot_description.ros.wire.interface_text import KINDS, own_package

    own_folder = own_package(package)
    if own_folder is None or (inner and inner[0] not in KINDS) or len(inner) > 2:
        return None
    module = sys.modules.get(package)
    is_own = isinstance(getattr(module, "__loader__", None), _Loader)
    file = getattr(module, "__file__", None)  # None if Python found a folder without code
    # A source package may have code, too: a genuine package is elsewhere.
    if inner and not is_own and file and not _is_below(file, own_folder):
        return None
    if len(inner) == 2 and not inner[1].startswith("_"):  # a class, `from package.msg import Name`
        if not is_own:
            _fill(sys.modules[f"{package}.{inner[0]}"])
        return None
    loader: Any = _Loader()
    return ModuleSpec(name, loader, origin=str(own_folder), is_package=len(inner) < 2)


def _is_below(file: str, folder: "os.PathLike[str]") -> bool:
    """Return whether a file is in a folder or below it, once links are resolved."""
    return os.path.realpath(file).startswith(os.path.join(os.path.realpath(folder), ""))


def _fill(module: "ModuleType") -> None:
    from onebot_description.ros.packages.interface_modules import fill

    fill(module)


class _Loader:
    """Loads the modules of a package of interfaces."""

    def create_module(self, spec: "ModuleSpec") -> None:
        """Let Python create it."""

    def exec_module(self, module: "ModuleType") -> None:
        if "." in module.__name__:
            _fill(module)


def package_names() -> list[str]:
    """Return the names of the packages here, and of those that a user has added."""
    from onebot_description.ros.wire.interface_text import own_packages

    here = os.path.dirname(__file__)
    with_code = {name for name in os.listdir(here) if os.path.isfile(f"{here}/{name}/__init__.py")}
    return sorted(with_code | {*own_packages()})


def origin(name: str) -> str:
    """Return the folder that a package is imported from, without its name; "" if there is none."""
    from importlib.util import find_spec

    spec = find_spec(name)
    if spec is None:
        return ""
    places = [*(spec.submodule_search_locations or ()), spec.origin or ""]
    return str(os.path.dirname(os.path.realpath(places[0])))


def _is_replaced() -> bool:
    """Return whether a sourced ROS replaces the wheels, and the packages here."""
    from importlib.machinery import PathFinder

    prefixes = filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep))
    roots = {os.path.realpath(prefix) for prefix in prefixes if os.path.exists(f"{prefix}/{_ROS}")}
    if PathFinder.find_spec("ros_wheels_bootstrapper"):  # this environment's ROS is from wheels
        roots.discard(os.path.realpath(sys.prefix))
    return bool(roots)


def _check_ros(name: str) -> None:
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
            f"the ROS 2 of {ros.origin} is built for another Python than this one, {version}: "
            "create the environment with the Python of that ROS, or use a shell without it"
        )
    return (
        f'the ROS 2 of {ros.origin} lacks the package "{name}": install it, '
        f"for example with apt install ros-jazzy-{name.replace('_', '-')}"
    )


def _print_error(
    kind: type[BaseException], error: BaseException, traceback: TracebackType | None
) -> None:
    """Print the exception that ended the process; a MissingRosError without a traceback."""
    if isinstance(error, MissingRosError):
        print(f"error: {error}", file=sys.stderr)
    else:
        sys.__excepthook__(kind, error, traceback)


install()
