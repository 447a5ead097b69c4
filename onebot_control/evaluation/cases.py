"""The cases of a study: the values that differ between episodes."""

from collections.abc import Iterable, Mapping
from itertools import islice, product
from math import prod
from typing import Any

from onebot_description.errors import OneBotError, shortened
from onebot_description.parameters.arguments import checked
from onebot_description.parameters.values import plain

MAX_CASES = 1_000_000
ERROR = "error"
"""The column with the error of an episode."""


class Case(dict[str, Any]):
    """One case of a study: the values of the factors, by name."""


def grid(**factors: Any) -> list[Case]:
    """Return the cases with all combinations of values; the last factor varies fastest.

    Args:
        factors: the values of each factor, such as ``seed=range(100)``; a single string, number or
            mapping is one value.

    Raises:
        OneBotError: there is no combination, or there are more than a million.
    """
    levels = [_levels(values) for values in factors.values()]
    _check_count(prod(map(len, levels)))
    return [Case(zip(factors, row, strict=True)) for row in product(*levels)]


def _levels(values: object) -> list[Any]:
    if not isinstance(values, Iterable) or isinstance(values, str | bytes | Mapping):
        return [values]
    return [plain(value) for value in islice(values, MAX_CASES + 1)]


def _check_count(count: int) -> None:
    if not 0 < count <= MAX_CASES:
        text = f"a study has 1 to {MAX_CASES:,} cases, such as grid(seed=range(9))"
        raise OneBotError(f"{text}; these are {'more' if count else 'none'}")


@checked
def checked_cases(cases: Iterable[Mapping[str, Any]]) -> list[Case]:
    """Return the cases of a study.

    Args:
        cases: one mapping per case; the result of ``grid``, or any other iterable.

    Raises:
        OneBotError: there are no cases or too many, or one is not a mapping with names as keys.
    """
    listed_cases = [*islice(cases, MAX_CASES + 1)]
    _check_count(len(listed_cases))
    return [Case(checked_row(case, f"case {n}")) for n, case in enumerate(listed_cases)]


def checked_row(row: object, what: str) -> Mapping[str, Any]:
    """Return a mapping from names of columns to values; ``what`` is its name in errors.

    Raises:
        OneBotError: it is not such a mapping.
    """
    if not isinstance(row, Mapping):
        text = f"{what}: {shortened(repr(row))} is not a mapping"
        raise OneBotError(f'{text}; write a mapping, such as {{"seed": 7}}')
    for name in row:
        if not isinstance(name, str) or name in ("", ERROR):
            text = f"{what}: {shortened(repr(name))} cannot be the name of a column"
            raise OneBotError(f"{text}; write a non-empty string other than {ERROR}")
    return row
