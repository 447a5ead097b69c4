"""The ROS arguments of a command line, which may be for the nodes of several robots."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple


class RosArguments(NamedTuple):
    """Parts of a command line that rcl does not report: parameter files, and names set by -p."""

    files: tuple[Path, ...] = ()  # given by --params-file, in order
    names: tuple[tuple[str, str], ...] = ()  # of the parameters set by -p: (node or "", parameter)
    others: tuple[str, ...] = ()  # arguments that are not for ROS, without the program's name

    def names_for(self, node: str) -> list[str]:
        """Return the names of the parameters that -p sets for a ``node``."""
        return [name for target, name in self.names if target in ("", node)]

    def joined(self, own: Sequence[str]) -> "RosArguments":
        """Return these arguments with a node's ``own`` ROS arguments, which override them."""
        more = ros_arguments(["", *(ros_args(own) or ())])
        return self._replace(files=self.files + more.files, names=self.names + more.names)


def ros_arguments(arguments: Sequence[str]) -> RosArguments:
    """Find the parameter files and names in ``arguments``, which are as in sys.argv."""
    files: list[Path] = []
    names: list[tuple[str, str]] = []
    other_words: list[str] = []
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
            other_words.append(word)
    return RosArguments(tuple(files), tuple(names), tuple(other_words))


def split_robots(arguments: Sequence[str]) -> tuple[list[str], list[list[str]]]:
    """Split the command line of nodes of several robots, which is as in sys.argv.

    Returns:
        The arguments of the process, and the ROS arguments of each robot's node: the words after
        each --robot, until --ros-args or the end.
    """
    common: list[str] = []
    robots: list[list[str]] = []
    target, inside = common, False
    for word in arguments:
        if word == "--ros-args":
            target, inside = common, True
        elif word == "--robot" and not inside:
            target = []
            robots.append(target)
            continue
        target.append(word)
    return common, robots


def ros_args(own: Sequence[str] | None) -> list[str] | None:
    """Return a node's ``own`` ROS arguments in the form for rclpy."""
    return None if own is None else ["--ros-args", *own]
