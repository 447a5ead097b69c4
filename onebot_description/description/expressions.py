"""Expressions of xacro files: Python's, but nothing is in reach that xacro does not document.

An expression is parsed and refused unless every part of it is of a kind listed here: there are no
lambdas, f-strings or assignments, and a generator becomes a list. ``a.b`` becomes a call of
``attribute``, which knows the names in a namespace, the keys of YAML and the methods of plain
values. The rest is Python's own. What an expression may cost is bounded by the process that it runs
in (see ``bounded_process``).
"""

import ast
import functools
import string
from collections.abc import Mapping
from types import CodeType
from typing import Any

from xacro import NameSpace, YamlDictWrapper

from onebot_description.errors import OneBotError

_KINDS = (
    *(ast.Expression, ast.Constant, ast.Name, ast.expr_context, ast.Attribute, ast.Call),
    *(ast.keyword, ast.Starred, ast.Subscript, ast.Slice, ast.IfExp, ast.Compare, ast.cmpop),
    *(ast.BoolOp, ast.boolop, ast.BinOp, ast.operator, ast.UnaryOp, ast.unaryop),
    *(ast.List, ast.Tuple, ast.Dict, ast.Set),
    *(ast.ListComp, ast.GeneratorExp, ast.DictComp, ast.SetComp, ast.comprehension),
)
_REFUSED = {
    ast.Lambda: "a lambda",
    ast.JoinedStr: "an f-string",
    ast.NamedExpr: "an assignment",
}
_PLAIN = (str, bytes, int, float, complex, list, tuple, dict, set, frozenset, range)
_ATTRIBUTE = "attribute()"  # no expression can hold this name


class ExpressionError(OneBotError):
    """An expression holds something that xacro's expressions do not have."""


def evaluate(expression: str, names: Mapping[str, Any]) -> Any:
    """Return the value of ``expression``.

    Args:
        expression: of Python's grammar.
        names: what it can use; looked up as it is needed.

    Raises:
        ExpressionError: it holds something that is refused.
        SyntaxError: it is no expression.
        Exception: whatever its functions and operators raise.
    """
    return eval(_compiled(expression.strip()), _Scope(names))


class _Scope(dict[str, Any]):
    """The global names of an expression: a dict, as ``eval`` needs one, that asks ``names``."""

    def __init__(self, names: Mapping[str, Any]) -> None:
        super().__init__({"__builtins__": {}, _ATTRIBUTE: attribute})
        self._names = names

    def __missing__(self, name: str) -> Any:
        return self._names[name]


@functools.lru_cache(maxsize=4096)  # macros repeat theirs
def _compiled(expression: str) -> CodeType:
    tree = ast.parse(expression, "<expression>", "eval")
    for node in ast.walk(tree):
        _check(node)
    changed = ast.fix_missing_locations(_Rewritten().visit(tree))
    return compile(changed, "<expression>", "eval")


def _check(node: ast.AST) -> None:
    """Refuse what is not listed, hidden names, and assignments to parts of something."""
    if not isinstance(node, _KINDS):
        what = _REFUSED.get(type(node), type(node).__name__)
        raise ExpressionError(f"xacro's expressions cannot hold {what}")
    name = getattr(node, "id", None) or getattr(node, "attr", None) or getattr(node, "arg", None)
    if name is not None and name.startswith("__"):
        raise ExpressionError(f'xacro\'s expressions cannot use the name "{name}"')
    if isinstance(node, ast.Attribute | ast.Subscript) and not isinstance(node.ctx, ast.Load):
        raise ExpressionError("xacro's expressions cannot hold an assignment")


class _Rewritten(ast.NodeTransformer):
    """Turns each ``value.name`` into a call of ``attribute``, and generators into lists."""

    def visit_Attribute(self, node: ast.Attribute) -> ast.AST:
        self.generic_visit(node)
        function = ast.Name(_ATTRIBUTE, ast.Load())
        return ast.Call(function, [node.value, ast.Constant(node.attr)], [])

    def visit_GeneratorExp(self, node: ast.GeneratorExp) -> ast.AST:
        self.generic_visit(node)
        return ast.ListComp(node.elt, node.generators)


def attribute(value: Any, name: str) -> Any:
    """Return ``value.name`` of a namespace, of loaded YAML or of a plain value.

    Raises:
        NameError: the namespace has no such name.
        AttributeError: ``value`` has no such attribute, or it is one of Python's own workings.
    """
    if isinstance(value, NameSpace):
        return NameSpace.__getattr__(value, name)
    kind = next((kind for kind in _PLAIN if isinstance(value, kind)), None)
    if kind is str and name == "format":
        return functools.partial(_Formatter().format, value)
    if kind is not None and name in vars(kind) and name != "format_map" and name[0] != "_":
        return getattr(value, name)
    if isinstance(value, YamlDictWrapper):
        return value[name]
    raise AttributeError(f'{type(value).__name__} has no attribute "{name}" in an expression')


class _Formatter(string.Formatter):
    """``str.format`` without ``{0.attribute}`` and ``{0[key]}``, which would reach anything."""

    def get_field(self, field_name: str, args: Any, kwargs: Any) -> Any:
        if "." in field_name or "[" in field_name:
            raise ExpressionError(f"{{{field_name}}} cannot look into a value; format the part")
        return super().get_field(field_name, args, kwargs)


def plain_type(value: Any) -> type:
    """Return ``type(value)`` of a plain value.

    Raises:
        ExpressionError: it is something else, such as a function.
    """
    if value is not None and not isinstance(value, _PLAIN):
        raise ExpressionError(f"type() takes a number, text or a collection, not {value!r}")
    return type(value)
