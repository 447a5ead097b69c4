"""ROS parameter files for nodes: what is too long, or too delicate, for a command line.

On a command line the value of ``-p name:=value`` is read as YAML, so a path called ``1.0`` would
become a number, and a robot description is longer than the system allows an argument to be. Here
every value is written with its type.
"""

from collections.abc import Mapping
from pathlib import Path


def write_parameters(
    folder: Path, node: str, parameters: Mapping[str, object], namespace: str = ""
) -> Path:
    """Write ``<folder>/<node>.yaml`` and return its path.

    Args:
        folder: an existing folder.
        node: name of the node.
        parameters: names to values (bool, int, float, str), or to nested maps of such.
        namespace: of the node, without outer slashes.
    """
    full_name = f"/{namespace}/{node}" if namespace else f"/{node}"
    path = folder / f"{node}.yaml"
    lines = [f"{_text(full_name)}:", "  ros__parameters:", *_lines(parameters, "    ")]
    path.write_text("\n".join(lines) + "\n", encoding="ascii")
    return path


def _lines(parameters: Mapping[str, object], indent: str) -> list[str]:
    lines = []
    for name, value in parameters.items():
        if isinstance(value, Mapping):
            lines += [f"{indent}{_text(name)}:", *_lines(value, indent + "  ")]
        else:
            lines.append(f"{indent}{_text(name)}: {_scalar(value)}")
    return lines


def _scalar(value: object) -> str:
    """Write a value so that ROS reads the same type: doubles always with a decimal point."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int):
        return str(value)
    if isinstance(value, float):
        return f"{value:.9f}"
    return _text(str(value))


def _text(value: str) -> str:
    """Return ``value`` as a double-quoted YAML scalar in ASCII (YAML 1.1, section 5.7)."""
    return '"' + "".join(_character(character) for character in value) + '"'


def _character(character: str) -> str:
    if character in '"\\':
        return "\\" + character
    if character == "\n":
        return "\\n"
    code = ord(character)
    if 0x20 <= code < 0x7F:
        return character
    return f"\\u{code:04x}" if code <= 0xFFFF else f"\\U{code:08x}"
