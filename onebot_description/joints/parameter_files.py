"""The parameter files of one node, read as one."""

from collections.abc import Iterable
from pathlib import Path

from onebot_description.joints.config import unknown_parameters
from onebot_description.joints.parameter_yaml import Parameters, read_parameters, section_matches
from onebot_description.joints.problems import ConfigError, Problem
from onebot_description.text import listing


def read_files(files: Iterable[Path], node: str) -> Parameters:
    """Read what ``files`` say to ``node``; later files come first.

    Unknown parameters in a section shared by several nodes are taken to be for another one.

    Raises:
        ConfigError: a file cannot be read, or is not ROS 2 parameter YAML.
    """
    found = Parameters()
    for file in files:
        found.update(read_parameters(_text(file), str(file), node))
    for name in unknown_parameters(found.shared):
        del found.values[name], found.places[name]
    return found


def silence(parameters: Parameters, files: Iterable[Path], node: str) -> str | None:
    """Return a remark if the files have sections, but none for ``node``."""
    sections = parameters.sections
    if not sections or any(section_matches(section, node) for section in sections):
        return None
    names = ", ".join(str(file) for file in files)
    return f"{names} says nothing to {node}, only to {listing(sections)}"


def _text(file: Path) -> str:
    try:
        return file.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not UTF-8 text"
        raise ConfigError([Problem("", f"{file}: cannot be read: {reason}")]) from None
