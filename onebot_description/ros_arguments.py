"""What the command line says that rcl does not tell: the parameter files, the names set with -p."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple


class RosArguments(NamedTuple):
    """The parts of a command line that are about parameters.

    Attributes:
        files: of ``--params-file``, in order.
        names: of the parameters set by ``-p``, as (node or "", parameter).
        others: the arguments that are not for ROS, without the program's name.
    """

    files: tuple[Path, ...] = ()
    names: tuple[tuple[str, str], ...] = ()
    others: tuple[str, ...] = ()


def ros_arguments(arguments: Sequence[str]) -> RosArguments:
    """Find the parameter files and names in ``arguments``, which are as in sys.argv."""
    files: list[Path] = []
    names: list[tuple[str, str]] = []
    others: list[str] = []
    inside, words = False, iter(arguments[1:])
    for word in words:
        if word == "--ros-args":
            inside = True
        elif inside and word == "--":
            inside = False
        elif inside and word == "--params-file":
            files.extend(Path(name) for name in [next(words, "")] if name)
        elif inside and word in ("-p", "--param"):
            left, assigned, _ = next(words, "").partition(":=")
            node, _, name = left.rpartition(":")
            if assigned:
                names.append((node, name))
        elif not inside:
            others.append(word)
    return RosArguments(tuple(files), tuple(names), tuple(others))
