"""``onebot run PACKAGE EXECUTABLE ...``: runs a node or bringup, like ``ros2 run``."""

import importlib
import sys
from collections.abc import Sequence

from onebot_description.discovery import use_local_discovery
from onebot_description.errors import UsageError, did_you_mean

# The executables that each package's CMakeLists.txt installs, and the modules that they are.
EXECUTABLES = {
    "onebot_description": {
        "robot_state_publisher": "onebot_description.robot_state_publisher",
        "joint_state_publisher": "onebot_description.joint_state_publisher",
    },
    "onebot_control": {"velocity_controller": "onebot_control.velocity_controller"},
    "onebot_bringup": {
        "rerun_viewer": "onebot_bringup.viewer.rerun_viewer",
        "steering_page": "onebot_bringup.steering.steering_page",
        "bag_recorder": "onebot_bringup.bags.bag_recorder",
        "onebot_bringup": "onebot_bringup.launch.onebot_bringup",
    },
    "mrm_description": {"mrm_bringup": "mrm_description.launch.mrm_bringup"},
}


def run(argv: Sequence[str]) -> int:
    """Run the executable and return its exit code."""
    if argv and argv[0] in ("-h", "--help"):
        print(_usage())
        return 0
    if len(argv) < 2:
        raise UsageError("onebot run takes a package, an executable and its arguments")
    package, executable, *arguments = argv
    if package not in EXECUTABLES:
        hint = did_you_mean(package, EXECUTABLES, "packages")
        raise UsageError(f'onebot run has no package "{package}"{hint}')
    modules = EXECUTABLES[package]
    if executable not in modules:
        hint = did_you_mean(executable, modules, "executables")
        raise UsageError(f'{package} has no executable "{executable}"{hint}')
    use_local_discovery()
    sys.argv[:] = [executable, *arguments]
    return int(importlib.import_module(modules[executable]).main())


def _usage() -> str:
    rows = (
        f"  {package} {executable}"
        for package, executables in EXECUTABLES.items()
        for executable in executables
    )
    return "\n".join(
        (
            "usage: onebot run PACKAGE EXECUTABLE [ARGUMENT ...] [--ros-args ...]",
            "",
            "Runs a node or a bringup:",
            *rows,
        )
    )
