"""What OneBot is, and how any robot's description is read and published."""

import sys

if sys.argv[:1] == ["-m"]:  # python -m looks for a module of ours; first: imports take long
    from onebot_description.ros.process_start import find_silently

    find_silently()

from onebot_description.ros.missing_ros import LastFinder

TYPE_CHECKING = False  # typing's constant; typing is slow to import
__version__: str  # the installed one, of all packages

sys.meta_path.append(LastFinder)


if not TYPE_CHECKING:  # else any name would be one of the package

    def __getattr__(name: str) -> str:
        if name == "__version__":
            return _installed_version()
        raise AttributeError(f'no attribute "{name}"', name=name)


def _installed_version() -> str:
    from importlib import metadata  # slow to import

    for distribution in ("onebot-robots", __name__):  # installed by pip, built by colcon
        try:
            return metadata.version(distribution)
        except metadata.PackageNotFoundError:
            pass
    return "0+checkout"
