"""Evaluates expressions of xacro files with simpleeval, limited to what xacro documents.

Lambdas, f-strings and names with leading underscores are rejected, a generator becomes a list, and
only attributes of namespaces, loaded YAML and plain values can be read. Its process has limited
time and memory (see ``bounded_process``).
"""

import ast
import functools
import operator
from collections.abc import Mapping
from typing import Any

import simpleeval
import xacro

_PLAIN = (str, int, float, list, tuple, dict, set)


class _AnyName(set[str]):
    """The allowed attributes of an object with its own names; simpleeval refuses underscores."""

    def __contains__(self, name: object) -> bool:
        return True


_ATTRIBUTES = {
    **simpleeval.BASIC_ALLOWED_ATTRS,
    xacro.NameSpace: _AnyName(),
    xacro.YamlDictWrapper: _AnyName(),
    xacro.YamlListWrapper: simpleeval.BASIC_ALLOWED_ATTRS[list],
}
_OPERATORS = {**simpleeval.DEFAULT_OPERATORS, ast.Pow: operator.pow}  # simpleeval refuses 1e7**2


def evaluate(expression: str, names: Mapping[str, Any]) -> Any:
    """Return the value of an expression.

    Args:
        expression: an expression in Python's syntax.
        names: variables and functions, looked up when needed.

    Raises:
        simpleeval.InvalidExpression: something is not allowed. Functions and operators may raise
            other exceptions.
    """
    return _Evaluator(names).eval(expression, _parsed(expression.strip()))


class _Evaluator(simpleeval.EvalWithCompoundTypes):
    """simpleeval's evaluator with xacro's names instead of its own."""

    def __init__(self, names: Mapping[str, Any]) -> None:
        super().__init__(_OPERATORS, {}, names, _ATTRIBUTES)
        self.functions = names
        del self.nodes[ast.JoinedStr]

    def _check_disallowed_items(self, item: Any) -> None:
        """Do not search values for disallowed functions: with YAML aliases it might never end."""


@functools.lru_cache(maxsize=4096)  # macros repeat their expressions
def _parsed(expression: str) -> ast.expr:
    return ast.parse(expression, "<expression>", "eval").body


def global_symbols() -> dict[str, Any]:
    """Return the names that every xacro file can use, except functions that would be unsafe."""
    symbols: dict[str, Any] = xacro.create_global_symbols()
    python = symbols["python"]
    del python["vars"]
    # Wrapped, because simpleeval refuses these functions themselves, and containers of them.
    python["type"] = _plain_type
    python["isinstance"] = lambda value, kinds: isinstance(value, kinds)
    python["repr"] = lambda value: repr(value)
    return symbols


def _plain_type(value: Any) -> type:
    if value is not None and not isinstance(value, _PLAIN):
        raise TypeError(f"type() takes a number, text or a collection, not {value!r}")
    return type(value)
