"""Numbers in attributes: as many as needed, finite, and in the range that makes sense."""

import math
import re

from onebot_description.description.report import Element, Report
from onebot_description.description.spec import Triple

# What every URDF reader takes for a number. float() would also take "1_000", "nan" and Thai digits.
_NUMBER = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_NOT_FINITE = re.compile(r"[+-]?(?:nan|inf|infinity)", re.IGNORECASE)
ZERO: Triple = (0.0, 0.0, 0.0)


def read_numbers(
    report: Report, element: Element, attribute: str, count: int
) -> tuple[float, ...] | None:
    """Return the numbers in an attribute; None if it is absent, or wrong (then reported)."""
    text = element.get(attribute)
    if text is None:
        return None
    written = f'{attribute}="{_cut(text)}"'
    words = text.split()
    if "," in text and len(text.replace(",", " ").split()) == count:
        report.problem(element, f"{written} has commas; separate the numbers by spaces")
        return None
    for word in words:
        if fault := _fault(word):
            report.problem(element, f"{written}: {fault}")
            return None
    if len(words) != count:
        noun = "number" if count == 1 else "numbers"
        report.problem(element, f"{written} holds {len(words)}; it takes {count} {noun}")
        return None
    return tuple(float(word) for word in words)


def read_triple(report: Report, element: Element | None, attribute: str) -> Triple | None:
    """Return three numbers; None if there is no such element or attribute, or it is wrong."""
    numbers = None if element is None else read_numbers(report, element, attribute, 3)
    return None if numbers is None else (numbers[0], numbers[1], numbers[2])


def read_number(
    report: Report,
    element: Element,
    attribute: str,
    *,
    required: bool = False,
    negative: bool = True,
) -> float | None:
    """Return the one number in an attribute; None if it is absent or wrong.

    Args:
        report: takes what is wrong.
        element: has the attribute.
        attribute: its name.
        required: whether its absence is a problem.
        negative: whether it may be below zero.
    """
    if element.get(attribute) is None:
        if required:
            report.problem(element, f'has no {attribute}; write {attribute}="..."')
        return None
    numbers = read_numbers(report, element, attribute, 1)
    if numbers is None:
        return None
    if not negative and numbers[0] < 0:
        report.problem(element, f'{attribute}="{numbers[0]:g}" is negative; it must not be')
        return None
    return numbers[0]


def _fault(word: str) -> str | None:
    """Why ``word`` is no usable number; None if it is one."""
    if _NOT_FINITE.fullmatch(word):
        return f"{word} is not a finite number"
    if not _NUMBER.fullmatch(word):
        return f'"{_cut(word)}" is not a number'
    if not math.isfinite(float(word)):
        return f"{_cut(word)} is too large for a number"
    return None


def _cut(text: str) -> str:
    """A text short enough to show in one line."""
    flat = " ".join(text.split())
    return flat if len(flat) <= 60 else flat[:57] + "..."
