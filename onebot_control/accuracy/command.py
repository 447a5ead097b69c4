"""``onebot accuracy``: measure, print the table, and write it where it is asked for."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from onebot_control.accuracy.measuring import measure
from onebot_control.accuracy.paths import PATHS
from onebot_control.accuracy.table import BEGIN, END, missed, table, write
from onebot_control.control_config import ControlConfig
from onebot_control.control_files import default_control_file, read_control_files
from onebot_description.description import load_description


def main(argv: Sequence[str]) -> int:
    """Run the command.

    Returns:
        0 if every goal is met, else 1; the goals missed are on stderr.

    Raises:
        OneBotError: a file is missing or wrong.
    """
    parser = argparse.ArgumentParser(prog="onebot accuracy", description=__doc__)
    parser.add_argument(
        "--robot",
        default="package://onebot_description/urdf/onebot.urdf.xacro",
        help="URDF or xacro file (default: OneBot)",
    )
    parser.add_argument("--control", type=Path, help="control.yaml (default: OneBot's)")
    parser.add_argument(
        "--write",
        type=Path,
        metavar="FILE",
        help=f"also put the table into FILE, between the lines {BEGIN} and {END}",
    )
    arguments = parser.parse_args(argv)
    file = arguments.control or default_control_file()
    parameters = read_control_files([file], "/", "velocity_controller")
    config = ControlConfig.from_parameters(parameters.values)
    report = measure(load_description(arguments.robot), config, PATHS)
    text = table(report)
    print(text, end="")
    if arguments.write is not None:
        write(arguments.write, text)
    failures = missed(report)
    for sentence in failures:
        print(sentence, file=sys.stderr)
    return 1 if failures else 0
