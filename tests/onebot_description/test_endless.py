"""Expressions of xacro files: as Python has them, unless they would never end."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onebot_description.description import load_description
from onebot_description.description.xacro import bound_functions, bounded, bounded_power
from onebot_description.errors import DescriptionError


def value_of(expression: str) -> object:
    """The value that a xacro file would get."""
    names = {name: getattr(math, name) for name in ("factorial", "comb", "perm", "pi", "sqrt")}
    symbols = {**names, "range": range, "round": round, "python": {"range": range}}
    bound_functions(symbols)
    return eval(bounded(expression), symbols)


@pytest.mark.parametrize(
    "expression",
    [
        "2**3**2",
        "-2**2",
        "2**-1",
        "(1 + 2)**0.5",
        "2.5**3 * 2**4",
        "[x**2 for x in (1, 2)]",
        "1+1",
        "2 * 3 + 4 * 5 * 6",
        "'ab' * 3 + 2 * 'c'",
        "[0, 1] * 2",
        "-1 * -0.5",
        "1 << 4 << 2",
        "'a*b' + '1<<2'",
        "round(2.567, 2), round(1234, -2), round(number=15, ndigits=-1)",
        "max(*[1, 2])",
    ],
)
def test_expressions_mean_what_they_did(expression: str) -> None:
    """Precedence, associativity and types stay."""
    found = value_of(expression)
    assert found == eval(expression) and type(found) is type(eval(expression))


def test_functions_do_what_they_did() -> None:
    """For all that a robot can need, and with the errors of their own."""
    assert value_of("factorial(20)") == math.factorial(20)
    assert value_of("comb(50, 3) + perm(5, 2) + perm(4)") == math.comb(50, 3) + 20 + 24
    assert value_of("list(range(3)) + list(range(4, 0, -2))") == [0, 1, 2, 4, 2]
    assert value_of("len(range(100000))") == 100000
    assert value_of("comb(10**30, 2)") == math.comb(10**30, 2)
    for wrong in ("factorial(-1)", "range(1, 2, 0)", "comb(3, -1)"):
        with pytest.raises(ValueError):
            value_of(wrong)
    for wrong in ("factorial()", "range('a')", "perm(1.5, 2)", "round()", "'a' * 1.5"):
        with pytest.raises(TypeError):
            value_of(wrong)


ENDLESS = {
    "10**10**10": r"10 \*\* 10000000000 is too large a number",
    "(-7)**10**9": "too large a number",
    "2**(1 << 40)": "too large a number",
    "1 << 10**10": "1 << 10000000000 is too large a number",
    "(1 << 9000) * (1 << 9000)": "a product is too large a number",
    "factorial(10**8)": r"factorial\(100000000\) is too large a number",
    "comb(10**9, 5 * 10**8)": "the number of choices of 500000000 from 1000000000",
    "perm(10**8)": "the number of choices of 100000000 from 100000000",
    "sum(range(10**10))": "a range of more than 100000 numbers is too long",
    "python['range'](-10**30, 10**30)": "a range of more than",
    "[0] * 10**9": "a list repeated 1000000000 times is too long",
    "10**9 * 'ab'": "a str repeated 1000000000 times is too long",
    "round(1, -10**9)": "round to -1000000000 digits is too much",
    "round(number=1, ndigits=-10**9)": "round to -1000000000 digits is too much",
}


@pytest.mark.parametrize("expression", ENDLESS)
def test_what_would_never_end_is_refused(expression: str) -> None:
    """At once, with what it is."""
    with pytest.raises(OverflowError, match=ENDLESS[expression]):
        value_of(expression)


@pytest.mark.parametrize(
    ("written", "complaint"),
    [
        ("${math.factorial(10**8)}", "factorial(100000000) is too large a number"),
        ("${factorial(10**8)}", "factorial(100000000) is too large a number"),
        ("${len(python.range(10**12))}", "a range of more than 100000 numbers is too long"),
        ("${len([0]*10**9)}", "a list repeated 1000000000 times is too long"),
        ("$(eval 10**10**10)", "10 ** 10000000000 is too large a number"),
        ("$(eval [0]*10**9)", "a list repeated 1000000000 times is too long"),
    ],
)
def test_a_file_with_one_is_refused(tmp_path, written, complaint):
    """One problem, which names the file; the next file is read as ever."""
    robot = '<robot name="a" xmlns:xacro="http://www.ros.org/wiki/xacro"><link name="b{}"/></robot>'
    file = tmp_path / "robot.xacro"
    file.write_text(robot.format(written))
    with pytest.raises(DescriptionError) as error:
        load_description(file)
    (problem,) = error.value.problems
    assert complaint in problem and "robot.xacro" in problem
    file.write_text(robot.format("${math.factorial(3) * 2}$(eval 2**3)"))
    assert load_description(file).link_names == ("b128",)


@given(st.integers(-20, 20).filter(bool), st.integers(-300, 300))
def test_whole_numbers_of_any_use_are_computed(base: int, exponent: int) -> None:
    """And one to any power is one."""
    assert bounded_power(base, exponent) == base**exponent
    assert bounded_power(1, 10**20) == 1 and bounded_power(-1, 10**20) == 1
