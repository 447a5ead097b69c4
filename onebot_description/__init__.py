"""What OneBot is, and how any robot's description is read and published.

From Python, without ROS::

    from onebot_description import RobotModel, load_description

    description = load_description("robot.urdf.xacro", {"mesh_enabled": "false"})
    model = RobotModel.from_description(description)
    poses = model.link_poses(model.positions({"arm_joint": 0.5}))  # (links, 7)

``load_description`` reads and checks a URDF or xacro file, ``parse_description`` a text; both give
a ``Description``. A ``RobotModel`` computes where links are. A mistake in a file is a
``DescriptionError``, which is a ``OneBotError`` and has every problem with its line.

The nodes are ``python -m onebot_description.robot_state_publisher`` and ``joint_state_publisher``.
"""

import sys

if sys.argv[:1] == ["-m"]:  # python -m looks for a module of ours; first: imports take long
    from onebot_description.ros.process_start import find_silently

    find_silently()

from onebot_description.ros.missing_ros import LastFinder

TYPE_CHECKING = False  # typing's constant; typing is slow to import
__version__: str  # the installed one, of all packages

__all__ = [
    "Description",
    "DescriptionError",
    "OneBotError",
    "RobotModel",
    "__version__",
    "load_description",
    "parse_description",
]

sys.meta_path.append(LastFinder)


def lazy(modules: "Mapping[str, Sequence[str]]") -> "Callable[[str], object]":
    """Return a module's ``__getattr__``, which imports names when they are used first.

    ``modules`` are the names by module. Every name may also be "__version__".
    """
    homes = {name: module for module, names in modules.items() for name in names}

    def find(name: str) -> object:
        if name == "__version__":
            return _installed_version()
        if name not in homes:
            raise AttributeError(f'no attribute "{name}"', name=name)
        from importlib import import_module

        value: object = getattr(import_module(homes[name]), name)
        return value

    return find


if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from onebot_description.description import Description, load_description, parse_description
    from onebot_description.errors import DescriptionError, OneBotError
    from onebot_description.model import RobotModel
else:  # any name would be one of the package
    __getattr__ = lazy(
        {
            "onebot_description.description": (
                *("Description", "load_description", "parse_description"),
            ),
            "onebot_description.errors": ("DescriptionError", "OneBotError"),
            "onebot_description.model": ("RobotModel",),
        }
    )


def _installed_version() -> str:
    from importlib import metadata  # slow to import

    for distribution in ("onebot-robots", __name__):  # installed by pip, built by colcon
        try:
            return metadata.version(distribution)
        except metadata.PackageNotFoundError:
            pass
    return "0+checkout"
