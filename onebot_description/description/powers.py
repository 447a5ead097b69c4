"""Expressions of xacro files whose powers would never end, such as ``10**10**10``.

Python computes whole numbers of any length, and cannot be interrupted while it does.
"""

import ast
from typing import Any

NAME = "bounded_power"  # what a file's ``**`` is turned into
_MOST_BITS = 10_000  # a double ends at 1024


def bounded(expression: str) -> str:
    """Return an expression with its powers as calls of ``bounded_power``.

    Raises:
        SyntaxError: it is no Python expression.
    """
    if "**" not in expression:
        return expression
    tree = ast.parse(expression.strip(), "<expression>", "eval")
    return ast.unparse(_Powers().visit(tree))


def bounded_power(base: Any, exponent: Any) -> Any:
    """Return ``base ** exponent``.

    Raises:
        OverflowError: it is a whole number that nobody can mean.
    """
    if isinstance(base, int) and isinstance(exponent, int):
        if abs(base) > 1 and base.bit_length() * exponent > _MOST_BITS:
            raise OverflowError(f"{_short(base)} ** {_short(exponent)} is too large a number")
    return base**exponent


def _short(number: int) -> str:
    return str(number) if number.bit_length() < 100 else "a large number"


class _Powers(ast.NodeTransformer):
    def visit_BinOp(self, node: ast.BinOp) -> ast.AST:
        self.generic_visit(node)
        if not isinstance(node.op, ast.Pow):
            return node
        return ast.Call(ast.Name(NAME, ast.Load()), [node.left, node.right], [])
