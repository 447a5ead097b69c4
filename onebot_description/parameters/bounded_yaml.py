"""Reads untrusted YAML within bounds of size, depth and number of values.

A small text can expand to a huge tree by aliases of aliases, and nested brackets can overflow a
recursive parser. Each text is therefore first parsed to a flat series of events, in linear time,
and rejected before a tree is built.
"""

import os
import re
import stat
from pathlib import Path
from typing import IO, Any

import yaml

# The loader of libyaml, which rcl uses as well, if this build of PyYAML has it.
SafeLoader: Any = type("SafeLoader", (getattr(yaml, "CSafeLoader", yaml.SafeLoader),), {})
# YAML 1.2, rcl and RViz read 1e-05 and -.5 as numbers; PyYAML, which follows YAML 1.1, as strings.
SafeLoader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"[-+]?(\d+\.?\d*[eE][-+]?\d+|\.\d+([eE][-+]?\d+)?)$"),
    [*"+-.0123456789"],
)

_MAX_BYTES = 50_000_000  # a node's parameters may hold a whole URDF
_NO_WAITING = getattr(os, "O_NONBLOCK", 0)  # Windows has no such pipes
_MAX_LEVELS = 64
_MAX_VALUES = 500_000  # 10,000 joints with a motion each are 120,000


def read_text(file: Path) -> str:
    """Return the text of a regular file; raises OSError or UnicodeDecodeError."""
    with open_regular(file) as opened:
        data = opened.read(_MAX_BYTES + 1)
    if len(data) > _MAX_BYTES:
        raise OSError(0, f"larger than {_MAX_BYTES // 1_000_000} MB")
    return data.decode()


def open_regular(file: Path) -> IO[bytes]:
    """Open a file; raise OSError if it is not a regular file, and so may never end."""
    # Without waiting, because opening a pipe blocks until something writes to it.
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
        # A value does not match its tag, such as !!int "".
        raise yaml.YAMLError(" ".join(str(error).split())) from None


def compose(text: str) -> yaml.Node | None:
    """Return the tree of a text, None if it is empty; raises as ``load`` does."""
    _check(text, SafeLoader)
    return yaml.compose(text, Loader=SafeLoader)


def _check(text: str, loader: Any) -> None:
    """Reject a text whose tree would be too large with all aliases expanded."""
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
                sizes[event.anchor] = _MAX_VALUES + 1  # an alias inside itself would be endless
                begun.append((event.anchor, count))
            count += 1
        if len(begun) > _MAX_LEVELS:
            _refuse(event, f"maps and lists are nested more than {_MAX_LEVELS} deep")
        if count > _MAX_VALUES:
            _refuse(event, f"more than {_MAX_VALUES} values, with all aliases expanded")


def _refuse(event: yaml.Event, text: str) -> None:
    raise yaml.MarkedYAMLError(
        None,
        None,
        text,
        event.start_mark,  # type: ignore[arg-type, unused-ignore]
    )
