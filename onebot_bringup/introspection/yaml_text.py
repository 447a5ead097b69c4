"""YAML whose scalars stay text, so that each message field can read them as what it is.

A string field given ``{data: 12:30}`` gets "12:30" and one given ``{data: on}`` gets "on", where
YAML alone would make 750 and true of them; a number field understands ``1e-3``, which YAML alone
takes for a string.
"""

import re
from typing import Any, cast

import yaml

from onebot_description.errors import OneBotError


class _Loader(yaml.BaseLoader):
    """Keeps scalars as text and refuses a key that is given twice."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        """Build a dictionary from ``node``."""
        seen: set[str] = set()
        for key, _ in node.value:
            name = str(key.value)
            if name in seen:
                raise yaml.constructor.ConstructorError(
                    None, None, f'"{name}" is given twice', key.start_mark
                )
            seen.add(name)
        return super().construct_mapping(node, deep=deep)


def read_fields(text: str) -> dict[str, Any]:
    """Return the fields that YAML text names; scalars are strings, what is left empty is "".

    Args:
        text: such as ``{linear: {x: 0.2}}``; empty text has no fields.

    Raises:
        OneBotError: it is no YAML, or no dictionary.
    """
    try:
        values = yaml.load(text, Loader=_Loader)
    except yaml.YAMLError as error:
        raise OneBotError(f"the values are no YAML: {_where(error)}{_hint(text)}") from None
    if values in (None, ""):
        return {}
    if not isinstance(values, dict) or not all(isinstance(key, str) for key in values):
        raise OneBotError(
            "the passed value needs to be a dictionary in YAML format, such as "
            f'"{{linear: {{x: 0.2}}}}", not: {text.strip()}{_hint(text)}'
        )
    return cast(dict[str, Any], values)


def _where(error: yaml.YAMLError) -> str:
    mark = getattr(error, "problem_mark", None)
    problem = getattr(error, "problem", None) or str(error).partition("\n")[0]
    return f"line {mark.line + 1}, column {mark.column + 1}: {problem}" if mark else str(problem)


def _hint(text: str) -> str:
    """The commonest slip of the pen."""
    return '; write a space after each ":"' if re.search(r"\w:[\[{\d]", text) else ""
