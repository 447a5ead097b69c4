"""Reads untrusted YAML within bounds of size, depth and number of values.

A small text can expand to a huge tree by aliases of aliases, and nested brackets can overflow a
recursive parser. Each text is therefore first parsed to a flat series of events, in linear time,
and refused before a tree is built.
"""

import os
import re
import stat
from pathlib import Path
from typing import IO, Any

import yaml

# libyaml's, which rcl uses as well; not in every build of PyYAML.
SafeLoader: Any = type("SafeLoader", (getattr(yaml, "CSafeLoader", yaml.SafeLoader),), {})
# YAML 1.2, rcl and RViz take 1e-05 for a number, too; PyYAML, of YAML 1.1, for a string.
SafeLoader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+$"),
    [*"+-.0123456789"],
)

_MOST_BYTES = 50_000_000  # a node's parameters may hold a whole URDF
_NO_WAITING = getattr(os, "O_NONBLOCK", 0)  # Windows has no such pipes
_MOST_LEVELS = 64
_MOST_VALUES = 500_000  # 10,000 joints with a motion each are 120,000


def read_text(file: Path) -> str:
    """Return the text of a regular file; raises OSError or UnicodeDecodeError."""
    with open_regular(file) as opened:
        data = opened.read(_MOST_BYTES + 1)
    if len(data) > _MOST_BYTES:
        raise OSError(0, f"larger than {_MOST_BYTES // 1_000_000} MB")
    return data.decode()


def open_regular(file: Path) -> IO[bytes]:
    """Open a file; raises OSError if it is not a regular one, which may never end."""
    # Without waiting: to open a pipe takes until somebody writes to it.
    opened = open(file, "rb", opener=lambda path, flags: os.open(path, flags | _NO_WAITING))
    if not stat.S_ISREG(os.fstat(opened.fileno()).st_mode):
        opened.close()
        raise OSError(0, "not a regular file")
    return opened


def load(text: str, loader: Any = SafeLoader) -> Any:
    """Parse YAML, as ``yaml.load`` does.

    Raises:
        yaml.YAMLError: the text is not YAML, or exceeds a bound.
    """
    _check(text, loader)
    try:
        return yaml.load(text, Loader=loader)
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        # For a value that does not suit its tag, such as !!int "".
        raise yaml.YAMLError(" ".join(str(error).split())) from None


def compose(text: str) -> yaml.Node | None:
    """Return the tree of a text, None if it is empty; raises as ``load`` does."""
    _check(text, SafeLoader)
    return yaml.compose(text, Loader=SafeLoader)


def _check(text: str, loader: Any) -> None:
    """Refuse a text whose tree would be too large with all aliases expanded."""
    count = 0
    sizes: dict[str | None, int] = {}  # values that each anchor stands for
    begun: list[tuple[str | None, int]] = []  # maps and lists: the anchor, the values before
    for event in yaml.parse(text, Loader=loader):
        if isinstance(event, yaml.CollectionEndEvent):
            anchor, start = begun.pop()
            sizes[anchor] = count - start
        elif isinstance(event, yaml.AliasEvent):
            count += sizes.get(event.anchor, 1)
        elif isinstance(event, yaml.NodeEvent):
            sizes[event.anchor] = 1
            if isinstance(event, yaml.CollectionStartEvent):
                sizes[event.anchor] = _MOST_VALUES + 1  # within itself it has no end
                begun.append((event.anchor, count))
            count += 1
        if len(begun) > _MOST_LEVELS:
            _refuse(event, f"maps and lists are nested more than {_MOST_LEVELS} deep")
        if count > _MOST_VALUES:
            _refuse(event, f"more than {_MOST_VALUES} values, counted where aliases repeat them")


def _refuse(event: yaml.Event, text: str) -> None:
    raise yaml.MarkedYAMLError(
        None,
        None,
        text,
        event.start_mark,  # type: ignore[arg-type, unused-ignore]
    )
