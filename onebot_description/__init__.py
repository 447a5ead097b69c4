"""The description of OneBot, and tools that read, check and publish any robot's description.

From Python, without ROS::

    from onebot_description import RobotModel, load_description

    description = load_description("robot.urdf.xacro", {"mesh_enabled": "false"})
    model = RobotModel.from_description(description)
    poses = model.link_poses(model.positions({"arm_joint": 0.5}))  # (links, 7)

What the package exports:

- ``load_description``: Read a robot description, expand it if it is xacro, and check it.
- ``parse_description``: Read and check URDF text; xacro is not expanded.
- ``Description``: A robot, or a world, as read from URDF.
- ``RobotModel``: Forward kinematics of a robot with M moving joints, independent of ROS.
- ``DescriptionError``: An unusable robot description; lists every problem with its line.
- ``OneBotError``: A mistake that a user can fix.

To run the nodes: ``python -m onebot_description.robot_state_publisher`` and
``python -m onebot_description.joint_state_publisher``.
"""

import sys

if sys.argv[:1] == ["-m"]:  # python -m looks for one of our modules; first, as imports are slow
    from onebot_description.ros.process_start import find_silently

    find_silently()

import onebot_description.ros.packages  # noqa: F401  (installs the finder of packages)

TYPE_CHECKING = not __name__  # false; jedi skips blocks under a literal False; typing is slow
__version__: str  # the distribution's version

__docformat__ = "google"

__all__ = [
    "Description",
    "DescriptionError",
    "OneBotError",
    "RobotModel",
    "__version__",
    "load_description",
    "parse_description",
]


def _installed_version() -> str:
    from importlib import metadata  # slow to import

    for distribution in ("onebot-robots", __name__):  # installed by pip, built by colcon
        try:
            return metadata.version(distribution)
        except metadata.PackageNotFoundError:
            pass
    return "0+checkout"


def lazy(
    package: "MutableMapping[str, Any]", modules: "Mapping[str, Sequence[str]]"
) -> "Callable[[str], object]":
    """Return a ``__getattr__`` for a package that imports its names when they are first used.

    The package's ``__dir__`` lists the names, so that ``help`` shows them.

    Args:
        package: the package's ``globals()``; each name is added on its first use.
        modules: for each module to import from, the names in it. "__version__" is always added.
    """
    homes = {name: module for module, names in modules.items() for name in names}

    def find(name: str) -> object:
        if name == "__version__":
            return _installed_version()
        if name not in homes:
            raise AttributeError(f'no attribute "{name}"', name=name)
        from importlib import import_module

        value: object = getattr(import_module(homes[name]), name)
        package[name] = value
        return value

    package["__dir__"] = lambda: sorted({*package, *package["__all__"]})
    if "pdoc" in sys.modules:  # it documents the names in ``__all__`` that are in ``globals()``
        for name in homes:
            try:
                package[name] = find(name)
            except ImportError:  # an extra, or ROS, is not installed
                continue
        package["__all__"] = sorted(homes.keys() & package.keys())
    return find


if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, MutableMapping, Sequence
    from typing import Any

    from onebot_description.description import Description, load_description, parse_description
    from onebot_description.errors import DescriptionError, OneBotError
    from onebot_description.model import RobotModel
else:  # type checkers would accept any name
    __getattr__ = lazy(
        globals(),
        {
            "onebot_description.description": (
                *("Description", "load_description", "parse_description"),
            ),
            "onebot_description.errors": ("DescriptionError", "OneBotError"),
            "onebot_description.model": ("RobotModel",),
        },
    )
