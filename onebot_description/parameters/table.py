"""The parameters of a node as a table: for its ``--help`` and its README."""

from typing import NamedTuple

from onebot_description.parameters.reader import leaves


class Row(NamedTuple):
    """Parameters that differ in their names only."""

    names: list[str]
    type: str
    default: str
    meaning: str


def rows(*kinds: type) -> list[Row]:
    """Return a row for each parameter of dataclasses; those of the same meaning share one.

    Where some can be changed while the node runs, "start:" marks those that cannot.
    """
    parameters = [leaf for kind in kinds for leaf in leaves(kind)]
    some_change = not all(leaf.type.rule.read_only for leaf in parameters)
    table: dict[tuple[str, str, str], Row] = {}
    for leaf in parameters:
        start = "start: " if leaf.type.rule.read_only and some_change else ""
        cells = leaf.type.name, leaf.default_text, start + leaf.type.meaning
        table.setdefault(cells, Row([], *cells)).names.append(leaf.name)
    return list(table.values())


def help_text(*kinds: type) -> str:
    """Return the parameters for ``--help``."""
    lines = ["Parameters:"]
    for row in rows(*kinds):
        default = f", default {row.default}" if row.default else ""
        lines.append(f"    {', '.join(row.names)} ({row.type}{default}): {row.meaning}")
    return "\n".join(lines)
