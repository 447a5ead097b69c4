"""onebot_description.parameters.values: the edges of each rule, and the words for it."""

import math
import re
from array import array
from typing import Any

import pytest

from onebot_description.parameters.values import (
    LARGEST,
    Rule,
    ValueType,
    plain,
    shown,
    yaml_text,
)

SMALL = 5e-324
BELOW_ONE, ABOVE_ONE = math.nextafter(1.0, 0.0), math.nextafter(1.0, 2.0)
LIMIT = Rule("m/s", at_least=0.0, nan="no limit")


@pytest.mark.parametrize(
    ("rule", "words", "within", "beyond"),
    [
        (Rule(), "", [-LARGEST, 0.0, LARGEST], []),
        (Rule(above=0.0), "above 0", [SMALL, LARGEST], [0.0, -0.0, -SMALL]),
        (Rule(above=0.0, at_most=1.0), "above 0 and up to 1", [SMALL, 1.0], [0.0, ABOVE_ONE]),
        (Rule(at_least=1.0), "from 1", [1.0, LARGEST], [BELOW_ONE, -1.0]),
        (Rule(at_least=0.0, at_most=1.0), "from 0 to 1", [0.0, 1.0], [-SMALL, ABOVE_ONE]),
        (Rule(at_most=1.0), "up to 1", [-LARGEST, 1.0], [ABOVE_ONE]),
    ],
)
def test_ranges_at_their_edges(
    rule: Rule, words: str, within: list[float], beyond: list[float]
) -> None:
    assert rule.range == words
    assert [rule.beyond(value) for value in within] == [""] * len(within)
    assert all(rule.beyond(value) for value in beyond)
    assert all(ValueType(float, rule).checked(value) == value for value in within)
    for value in beyond:
        with pytest.raises(ValueError, match=f"write a number {words}$"):
            ValueType(float, rule).checked(value)


def test_the_side_on_which_a_value_is_out_of_range() -> None:
    assert Rule(above=0.0).beyond(math.nan) == "is not above 0"
    assert Rule(at_least=1.5).beyond(1.0) == "is below 1.5"
    assert Rule(at_most=2.0).beyond(3.0) == "is above 2"


@pytest.mark.parametrize(
    ("kind", "value", "checked"),
    [
        (ValueType(float), 3, 3.0),
        (ValueType(float), -LARGEST, -LARGEST),
        (ValueType(int, Rule(at_least=1, at_most=9)), 1, 1),
        (ValueType(int), 2**63 - 1, 2**63 - 1),
        (ValueType(bool), False, False),
        (ValueType(str), "", ""),
        (ValueType(str, Rule(pattern=re.compile("a+"))), "aa", "aa"),
        (ValueType(float, Rule(), many=True), [], ()),
        (ValueType(float, Rule(), many=True), array("d", [1.0, 1.0]), (1.0, 1.0)),
        (ValueType(int, Rule(unique=True), many=True), (2, 1), (2, 1)),
        (ValueType(float, Rule(), many=True, length=2, optional=True), [], None),
        (ValueType(float, optional=True), None, None),
        (ValueType(float, optional=True), 0.0, 0.0),
    ],
)
def test_values_that_are_right(kind: ValueType, value: Any, checked: Any) -> None:
    found = kind.checked(value)
    assert found == checked and type(found) is type(checked)


def test_nan_where_it_means_something() -> None:
    assert math.isnan(ValueType(float, LIMIT).checked(math.nan))
    for value in (math.inf, -math.inf):
        with pytest.raises(ValueError, match="inf is not finite; write a number from 0, or .nan"):
            ValueType(float, LIMIT).checked(value)


_STRINGS = ValueType(str, Rule(not_empty=True), many=True)
_LIMIT = ValueType(float, LIMIT)
_NEAR_OR_FAR = ValueType(str, Rule(choices=("near", "far")))
_ONLY_A = ValueType(str, Rule(pattern=re.compile("a")))
_UNIQUE = ValueType(str, Rule(unique=True), many=True)
_SIZE = ValueType(float, Rule("size", write="[width, height]"), many=True, length=2)
_INTEGERS = ValueType(int, many=True)


@pytest.mark.parametrize(
    ("kind", "value", "text"),
    [
        (ValueType(float), None, "has no value; write a number"),
        (ValueType(float), [1.0], "[1.0] is a list; write a number"),
        (_LIMIT, -1.0, "-1 is below 0; write a number from 0, or .nan for no limit"),
        (ValueType(float, Rule(write="a width")), "w", '"w" is a string; write a width'),
        (ValueType(float), 1.001e60, "1.001e+60 is beyond 1e+60; write a number"),
        (ValueType(int), 1.0, "1.0 is a number; write an integer"),
        (ValueType(int), True, "true is a bool; write an integer"),
        (ValueType(int), 2**63, "needs more than 64 bits; write an integer"),
        (ValueType(bool), 0, "0 is a number; write true or false"),
        (ValueType(str), {}, "is a map; write a string"),
        (ValueType(str), 1.5, '1.5 is a number; write a string, such as "1.5"'),
        (ValueType(str, Rule(not_empty=True)), "", "is empty; write a string"),
        (_NEAR_OR_FAR, "farr", 'no "farr" (did you mean "far"? known: far, near)'),
        (_ONLY_A, "ab", '"ab" is not valid; write a string'),
        (_STRINGS, [], "is empty; write a list of strings, such as [first, second]"),
        (_STRINGS, [None], "has no value; write a list of strings, such as [first, second]"),
        (_UNIQUE, ["a", "b", "c", "c", "b"], '"b" occurs twice'),
        (_INTEGERS, [1.5], "1.5 is a number; write a list of integers, such as [0, 1]"),
        (
            ValueType(float, many=True, length=4),
            1.0,
            "1.0 is a number; write a list of 4 numbers, such as [0.0, 1.0, 2.0, 0.0]",
        ),
        (ValueType(int, Rule("x and y"), many=True, length=2), [1], "1 integers; write 2: x and y"),
        (_SIZE, [1.0], "1 numbers; write [width, height]"),
    ],
)
def test_values_that_are_wrong(kind: ValueType, value: Any, text: str) -> None:
    with pytest.raises(ValueError) as caught:
        kind.checked(value)
    assert str(caught.value) == text


@pytest.mark.parametrize(
    ("kind", "name", "meaning"),
    [
        (ValueType(float, LIMIT), "double", "m/s; .nan: no limit"),
        (ValueType(int, Rule("n", at_most=9), many=True), "int[]", "n; up to 9"),
        (_NEAR_OR_FAR, "string", "one of near, far"),
    ],
)
def test_types_in_words(kind: ValueType, name: str, meaning: str) -> None:
    assert (kind.name, kind.meaning) == (name, meaning)


def test_values_in_words() -> None:
    assert shown(None) == "has no value"
    assert shown((1, 2)) == shown(array("q", [1, 2])) == "[1, 2] is a list"
    assert shown(1j) == "1j cannot be used here"


def test_arrays_of_parameters_are_lists() -> None:
    """However rclpy gives them."""
    assert plain(array("d", [1.0])) == plain((1.0,)) == [1.0]
    assert (plain("ab"), plain(None), plain(b"a")) == ("ab", None, b"a")


def test_values_as_yaml() -> None:
    values = ["", "a b", None, True, 1.5, 2, math.nan, [1.0, math.nan]]
    assert [yaml_text(value) for value in values] == [
        *('""', "a b", "", "true", "1.5", "2", ".nan", "[1.0, .nan]")
    ]
