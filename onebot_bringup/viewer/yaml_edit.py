"""Changing single values in YAML text, whose comments and form stay as the user wrote them."""

from collections.abc import Sequence
from typing import Any

import yaml


def set_value(text: str, path: Sequence[str], value: Any) -> str:
    """Return YAML ``text`` with another value under the keys ``path``, which are added if missing.

    Args:
        text: a mapping, or nothing.
        path: such as ("camera", "eye").
        value: a scalar, or a list or mapping of such; None for null.

    Raises:
        ValueError: a key on the way holds something other than a mapping.
    """
    node = yaml.compose(text, yaml.SafeLoader)
    if node is None:
        start = text if not text or text.endswith("\n") else text + "\n"
        return f"{start}{_entry(path, value)}\n"
    for depth, key in enumerate(path):
        if not isinstance(node, yaml.MappingNode):
            if node.tag != "tag:yaml.org,2002:null":
                raise ValueError(f'"{".".join(path[:depth])}" is no mapping')
            return _put(text, node, _flow(_nested(path[depth:], value)))
        child = _child(node, key)
        if child is None:
            return _added(text, node, path[depth:], value)
        node = child
    return _put(text, node, _flow(value))


def _child(node: yaml.MappingNode, key: str) -> yaml.Node | None:
    # The last one of a key written twice is the one that counts.
    found = [child for name, child in node.value if name.value == key]
    return found[-1] if found else None


def _put(text: str, node: yaml.Node, new: str) -> str:
    """Write ``new`` in the place of ``node``."""
    start, end = node.start_mark.index, _end(node)
    if start == end and start and not text[start - 1].isspace():
        new = f" {new}"  # a key that nothing follows
    return text[:start] + new + text[end:]


def _end(node: yaml.Node) -> int:
    """Where ``node`` ends; that of a block would include the comments after it."""
    if isinstance(node, yaml.CollectionNode) and not node.flow_style and node.value:
        last = node.value[-1]
        return _end(last[1] if isinstance(last, tuple) else last)
    return int(node.end_mark.index)


def _added(text: str, node: yaml.MappingNode, path: Sequence[str], value: Any) -> str:
    """Add a key to ``node``, as its last."""
    entry = _entry(path, value)
    if node.flow_style:
        end = node.end_mark.index - 1  # before the brace
        if not node.value:
            return text[:end] + entry + text[end:]
        at = _end(node.value[-1][1])
        return f"{text[:at]}, {entry}{text[at:]}"
    indent = " " * node.value[0][0].start_mark.column
    line_end = text.find("\n", _end(node))
    at = len(text) if line_end < 0 else line_end
    return f"{text[:at]}\n{indent}{entry}{text[at:]}"


def _entry(path: Sequence[str], value: Any) -> str:
    key = _flow(path[0])
    return f"{key}: {_flow(_nested(path[1:], value))}"


def _nested(path: Sequence[str], value: Any) -> Any:
    for key in reversed(path):
        value = {key: value}
    return value


def _flow(value: Any) -> str:
    """Return ``value`` as YAML on one line."""
    text = yaml.safe_dump(value, default_flow_style=True, sort_keys=False, width=float("inf"))
    return text.removesuffix("\n").removesuffix("\n...")
