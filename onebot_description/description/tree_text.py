"""Trees and tables as text for the terminal."""

from collections.abc import Callable, Iterable, Sequence

from onebot_description.errors import printable, shortened

_MAX_INDENT = 60  # characters before a name; only the end of a longer indent is drawn


def branches(roots: Iterable[str], below: Callable[[str], Sequence[str]]) -> list[tuple[str, str]]:
    """Return each name with the box drawing before it, depth first; ``below`` returns children."""
    result = []
    # Name, drawing before itself, drawing before its children.
    waiting = [(root, "", "") for root in reversed(list(roots))]
    while waiting:
        name, branch, inner = waiting.pop()
        result.append((branch, name))
        children = list(below(name))
        for index, child in reversed(list(enumerate(children))):
            last = index == len(children) - 1
            mark, indent = ("└─ ", "   ") if last else ("├─ ", "│  ")
            waiting.append((child, inner + mark, _shortened(inner + indent)))
    return result


def _shortened(indent: str) -> str:
    """Return ``indent``; if it is too wide, only its end."""
    return indent if len(indent) <= _MAX_INDENT else "…  " + indent[6:]


def cell(text: str) -> str:
    """Return ``text`` for a table cell: printable, and not too long."""
    return shortened(printable(text))


def aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    """Return the rows as lines with their columns aligned.

    Columns after the first that are empty below the heading are left out.
    """
    first, *later_columns = zip(*rows, strict=True)
    columns = [first, *(column for column in later_columns if any(column[1:]))]
    widths = [max(map(len, column)) for column in columns]
    return [
        "  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)).rstrip()
        for row in zip(*columns, strict=True)
    ]
