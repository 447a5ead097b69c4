"""``main`` of the nodes that take a description as FILE and check their parameter files first."""

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from rclpy.node import Node

from onebot_description.errors import OneBotError
from onebot_description.ros import complain, run_node
from onebot_description.ros_arguments import RosArguments, ros_arguments


def run_described_node(
    name: str,
    explanation: str | None,
    make_node: Callable[[str | None, RosArguments], Node],
    check_files: Callable[[Sequence[Path]], object],
    args: Sequence[str] | None,
    *,
    default_file: Callable[[], Path] | None = None,
    events: bool = False,
) -> int:
    """Run a node whose command line is ``[FILE] [--ros-args ...]``.

    Args:
        name: of the program, for its help.
        explanation: its help; the module's docstring.
        make_node: called with FILE, or None, and the command line's parameter files and names.
        check_files: called with the parameter files before rcl sees them. rcl would refuse a
            broken one too, but say neither where nor what to write.
        args: arguments as in sys.argv; None for sys.argv itself.
        default_file: gives the parameter file to use where the command line names none.
        events: as ``run_node``'s.

    Returns:
        The exit code.
    """
    arguments = list(sys.argv if args is None else args)
    chosen = _parser(name, explanation).parse_args(ros_arguments(arguments).others)
    try:
        if default_file is not None and not ros_arguments(arguments).files:
            # First, for whatever is on the command line to come first.
            file = ["--ros-args", "--params-file", str(default_file()), "--"]
            arguments = [*arguments[:1], *file, *arguments[1:]]
        ros = ros_arguments(arguments)
        check_files(ros.files)
    except OneBotError as error:
        return complain(str(error))
    return run_node(lambda: make_node(chosen.description, ros), arguments, events=events)


def _parser(name: str, explanation: str | None) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog=name,
        description=explanation,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("description", nargs="?", metavar="FILE", help="URDF or xacro file")
    return parser
