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


EDGES = [
    # the largest that is computed, and the smallest that is refused
    ("2**5000", "2**5001"),
    ("(-2)**5000", "(-2)**5001"),
    ("1 << 9999", "1 << 10000"),
    ("-1 << 9999", "-1 << 10000"),
    ("(1 << 4999) * (1 << 4999)", "(1 << 5000) * (1 << 4999)"),
    ("[0] * 100000", "[0] * 100001"),
    ("50000 * 'ab'", "50001 * 'ab'"),
    ("(0, 0) * 50000", "(0, 0) * 50001"),
    ("b'ab' * 50000", "b'ab' * 50001"),
    ("list(range(100000))", "list(range(100001))"),
    ("range(5, 100005)", "range(5, 100006)"),
    ("range(0, -200000, -2)", "range(0, -200001, -2)"),
    ("factorial(1000)", "factorial(1001)"),
    ("perm(1000)", "perm(1001)"),
    ("perm(2**99, 100)", "perm(2**99, 101)"),
    ("comb(2**99, 100)", "comb(2**99, 101)"),
    ("comb(1000, 10**9)", "comb(1001, 10**9)"),
    ("round(12345, -2500)", "round(12345, -2501)"),
]


@pytest.mark.parametrize(("largest", "beyond"), EDGES)
def test_the_largest_that_is_computed(largest: str, beyond: str) -> None:
    """Right at the border: nothing that is short enough is refused."""
    assert value_of(largest) == eval(largest, {n: getattr(math, n) for n in NAMES})
    with pytest.raises(OverflowError, match="too (large|long|much)"):
        value_of(beyond)


NAMES = ("factorial", "comb", "perm")


@pytest.mark.parametrize(
    "expression",
    [
        "2.0**1000",
        "2**-100000",
        "1.5 * 10**300",
        "0 << 10**9",
        "0**10**9",
        "(-1)**(10**9 + 1)",
        "[0] * -1000000",
        "'' * 10**9",
        "range(10**12, 0)",
        "round(1.5, -10**9)",
        "round(5, 10**9)",
        "True * 3",
    ],
)
def test_large_numbers_that_cost_nothing_are_taken(expression: str) -> None:
    """Floats, negative powers, empty ranges and repetitions, and rounding to digits behind."""
    assert value_of(expression) == eval(expression)


def test_large_numbers_are_not_written_out() -> None:
    """A message holds numbers up to 99 bits."""
    with pytest.raises(OverflowError, match=rf"^2 \*\* {2**98} is too large a number$"):
        value_of("2 ** 2**98")
    with pytest.raises(OverflowError, match=r"^2 \*\* a large number is too large a number$"):
        value_of("2 ** 2**99")
    with pytest.raises(OverflowError, match=r"^a large number << 9999 is too large a number$"):
        value_of("2**99 << 9999")


def test_expressions_without_such_operators_are_left_as_they_are() -> None:
    """To the blank, even where they are no Python."""
    for expression in (" a + b ", "1 +", "-x / 2"):
        assert bounded(expression) == expression
    with pytest.raises(SyntaxError):
        bounded("2 * ")
    assert bounded("f(*values)") == "f(*values)"
    assert bounded("'*'") == "'*'"


def test_functions_that_are_not_there_are_not_added() -> None:
    """Only what operators become is; the functions keep their names."""
    symbols: dict = {"math": {"factorial": math.factorial}, "x": 1}
    bound_functions(symbols)
    assert set(symbols) == {"math", "x", "bounded_power", "bounded_product", "bounded_shift"}
    assert set(symbols["math"]) == {"factorial"}
    assert symbols["math"]["factorial"].__name__ == "factorial"
    with pytest.raises(OverflowError):
        symbols["math"]["factorial"](10**8)
