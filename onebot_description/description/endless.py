"""Expressions of xacro files that would never end, such as ``10**10**10``: refused at once.

Python computes whole numbers of any length and fills lists of any size, and cannot be interrupted
while it does. What does so in one step is bounded here: powers, products and shifts of whole
numbers, repeated texts and lists, ``range``, ``factorial``, ``comb``, ``perm`` and ``round``.

Not bounded is work that is made of many small steps, such as a comprehension over several ranges,
or a method of a text that pads it (``"".ljust(10**9)``): only who writes it that way gets it.
"""

import ast
import functools
from collections.abc import Callable
from typing import Any

_MOST_BITS = 10_000  # of a whole number; a double ends at 1024
_MOST_ITEMS = 100_000  # of a text, list or range; some seconds of work at the most
_SHORT = 100  # bits
_SPACES = ("math", "python")  # where xacro has its functions, beside the expression's own names


def bounded(expression: str) -> str:
    """Return an expression whose operators that can be endless are calls.

    Raises:
        SyntaxError: it is no Python expression.
    """
    if "*" not in expression and "<<" not in expression:
        return expression
    return _bounded(expression.strip())


@functools.lru_cache(maxsize=4096)  # macros repeat theirs
def _bounded(expression: str) -> str:
    tree = ast.parse(expression, "<expression>", "eval")
    operators = _Operators()
    changed = operators.visit(tree)
    return ast.unparse(changed) if operators.found else expression


class _Operators(ast.NodeTransformer):
    """Turns operators into calls, and notes whether there were any."""

    found = False

    def visit_BinOp(self, node: ast.BinOp) -> ast.AST:
        self.generic_visit(node)
        name = _CALLS.get(type(node.op))
        if name is None:
            return node
        self.found = True
        return ast.Call(ast.Name(name, ast.Load()), [node.left, node.right], [])


def bounded_power(base: Any, exponent: Any) -> Any:
    """Return ``base ** exponent``.

    Raises:
        OverflowError: it is a whole number that nobody can mean.
    """
    if isinstance(base, int) and isinstance(exponent, int) and abs(base) > 1:
        _check_bits(base.bit_length() * exponent, f"{_short(base)} ** {_short(exponent)}")
    return base**exponent


def bounded_product(left: Any, right: Any) -> Any:
    """Return ``left * right``, where one may be a text or a list.

    Raises:
        OverflowError: it is a whole number, or a repetition, that nobody can mean.
    """
    if isinstance(left, int) and isinstance(right, int):
        _check_bits(left.bit_length() + right.bit_length(), "a product")
    for sequence, times in ((left, right), (right, left)):
        if isinstance(sequence, str | bytes | list | tuple) and isinstance(times, int):
            if len(sequence) * times > _MOST_ITEMS:
                kind = type(sequence).__name__
                raise OverflowError(f"a {kind} repeated {_short(times)} times is too long")
    return left * right


def bounded_shift(number: Any, bits: Any) -> Any:
    """Return ``number << bits``.

    Raises:
        OverflowError: it is a whole number that nobody can mean.
    """
    if isinstance(number, int) and isinstance(bits, int) and number:
        _check_bits(number.bit_length() + bits, f"{_short(number)} << {_short(bits)}")
    return number << bits


def bound_functions(symbols: Any) -> None:
    """Bound the functions of an expression's names, and add those that ``bounded`` calls.

    Args:
        symbols: xacro's names, or those of its ``$(eval ...)``; changed in place.
    """
    for space in (symbols, *(symbols[name] for name in _SPACES if name in symbols)):
        there = {name: check for name, check in _CHECKS.items() if name in space}
        space.update({name: _checked(space[name], check) for name, check in there.items()})
    symbols.update(_FUNCTIONS)


def _checked(function: Callable[..., Any], check: Callable[..., None]) -> Callable[..., Any]:
    @functools.wraps(function)
    def checked(*values: Any, **named: Any) -> Any:
        check(*values, **named)  # what the function does not take, it says itself
        return function(*values, **named)

    return checked


def _check_range(*bounds: Any, **_: Any) -> None:
    if all(isinstance(bound, int) for bound in bounds) and bounds and 0 not in bounds[2:]:
        if range(*bounds)[_MOST_ITEMS:]:
            raise OverflowError(f"a range of more than {_MOST_ITEMS} numbers is too long")


def _check_factorial(number: Any = 0, *_: Any, **__: Any) -> None:
    if isinstance(number, int):
        _check_bits(number * number.bit_length(), f"factorial({_short(number)})")


def _check_choices(number: Any = 0, chosen: Any = None, *_: Any, **__: Any) -> None:
    """Of comb and perm: at most ``chosen`` factors that are no larger than ``number``."""
    factors = number if chosen is None else chosen
    if isinstance(number, int) and isinstance(factors, int):
        bits = min(number, factors) * number.bit_length()
        _check_bits(bits, f"the number of choices of {_short(factors)} from {_short(number)}")


def _check_round(number: Any = 0, ndigits: Any = None, *_: Any, **__: Any) -> None:
    """Rounding a whole number to -n digits computes 10**n."""
    if isinstance(number, int) and isinstance(ndigits, int) and -4 * ndigits > _MOST_BITS:
        raise OverflowError(f"round to {_short(ndigits)} digits is too much")


def _check_bits(bits: int, what: str) -> None:
    if bits > _MOST_BITS:
        raise OverflowError(f"{what} is too large a number")


def _short(number: int) -> str:
    return str(number) if number.bit_length() < _SHORT else "a large number"


_FUNCTIONS = {
    function.__name__: function for function in (bounded_power, bounded_product, bounded_shift)
}
_CALLS: dict[type[ast.operator], str] = {
    ast.Pow: bounded_power.__name__,
    ast.Mult: bounded_product.__name__,
    ast.LShift: bounded_shift.__name__,
}
_CHECKS: dict[str, Callable[..., None]] = {
    "range": _check_range,
    "factorial": _check_factorial,
    "comb": _check_choices,
    "perm": _check_choices,
    "round": _check_round,
}
