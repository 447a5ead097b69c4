"""``onebot check``: checks a robot description and prints its tree."""

from collections.abc import Sequence
from dataclasses import replace

from onebot_bringup.cli.options import warn
from onebot_bringup.launch.arguments import (
    PACKAGES,
    model_arguments,
    split,
    table,
    take_package_path,
)
from onebot_description.description.xacro import xacro_arguments
from onebot_description.errors import UsageError

HELP = """\
usage: onebot check FILE [name:=value ...] [package_path:=FOLDER]

Checks a URDF or xacro file. Prints all problems (exit code 1), or the tree of links and joints,
and the sensors (exit code 0); warnings either way. name:=value are arguments that the xacro file
declares; --show-args lists them. Nodes are less strict: they only warn about many problems. ROS
packages are looked for in package_path (folders joined by :), ROS_PACKAGE_PATH, AMENT_PREFIX_PATH,
this environment, and the source tree around FILE."""


def run(argv: Sequence[str]) -> int:
    """Run the command and return its exit code."""
    arguments = split(argv)
    if arguments.help:
        print(HELP)
        return 0
    files = arguments.positional
    if len(files) != 1 and not (arguments.show and not files):
        raise UsageError(f"onebot check takes one file, not {len(files)}")
    xacro_values = take_package_path(arguments.given)
    if arguments.show:
        declared = [entry for file in files for entry in xacro_arguments(file).arguments]
        print(table([PACKAGES, *model_arguments(declared, {PACKAGES.name})]))
        return 0
    file = files[0]

    # This is slower to import.
    from onebot_control.drive.wheels.finding import RunningGear
    from onebot_description.description import describe, load_description
    from onebot_description.description.unit_check import shape_sizes, size_warnings
    from onebot_description.model.rigid_bodies import inertia_warnings

    description = load_description(file, xacro_values)
    sizes, faults, lacking = shape_sizes(description)
    replace(description, problems=(*description.problems, *faults)).raise_problems()
    print(describe(description, sizes))
    stands = bool(description.interfaces) and not RunningGear.of(description).drives
    warnings = [
        *description.warnings,
        *lacking,
        *inertia_warnings(description),
        *size_warnings(description, sizes),
        description.interface_fault(stands=stands),
    ]
    for warning in filter(None, warnings):
        warn(warning)
    return 0
