"""The cases of a study: the values that differ between episodes."""

from collections.abc import Iterable, Mapping, Sized
from itertools import islice, product
from math import prod
from typing import Any

from onebot_description.errors import OneBotError, shortened
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
        OneBotError: there are more than a million combinations.
    """
    counts = [
        len(level) for level in factors.values() if _is_many(level) and isinstance(level, Sized)
    ]
    _check_count(prod(counts))
    values = [_values(level) if _is_many(level) else [level] for level in factors.values()]
    _check_count(prod(map(len, values)))
    return [Case(zip(factors, row, strict=True)) for row in product(*values)]


def _is_many(values: object) -> bool:
    return isinstance(values, Iterable) and not isinstance(values, str | bytes | Mapping)


def _values(values: Iterable[Any]) -> list[Any]:
    return [plain(value) for value in islice(values, MAX_CASES + 1)]


def _check_count(count: int) -> None:
    if count > MAX_CASES:
        text = f"a study has at most {MAX_CASES:,} cases, not {count:,}"
        raise OneBotError(f"{text}; take fewer values, or several studies")


def checked_cases(cases: Iterable[Mapping[str, Any]]) -> list[Case]:
    """Return the cases of a study.

    Args:
        cases: one mapping per case; the result of ``grid``, or any other iterable.

    Raises:
        OneBotError: there are no cases or too many, or one is not a mapping with names as keys.
    """
    if not _is_many(cases):
        text = f"cases: {shortened(repr(cases))}; write a list of mappings, or grid(seed=range(9))"
        raise OneBotError(text)
    listed_cases = [*islice(cases, MAX_CASES + 1)]
    if not listed_cases:
        raise OneBotError("cases: empty; write a list of mappings, or grid(seed=range(9))")
    _check_count(len(listed_cases))
    for number, case in enumerate(listed_cases):
        if not isinstance(case, Mapping):
            text = f"case {number}: {shortened(repr(case))} is not a mapping"
            raise OneBotError(f'{text}; write a mapping, such as {{"seed": 7}}')
        if wrong := [key for key in case if not isinstance(key, str) or key in ("", ERROR)]:
            text = f"case {number}: {shortened(repr(wrong[0]))} cannot be the name of a column"
            raise OneBotError(f"{text}; write a non-empty string other than {ERROR}")
    return [*map(Case, listed_cases)]
