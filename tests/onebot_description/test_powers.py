"""Powers in xacro expressions: as Python has them, unless they would never end."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onebot_description.description.powers import bounded, bounded_power


@pytest.mark.parametrize(
    "expression",
    ["2**3**2", "-2**2", "2**-1", "(1 + 2)**0.5", "2.5**3 * 2**4", "[x**2 for x in (1, 2)]", "1+1"],
)
def test_expressions_mean_what_they_did(expression: str) -> None:
    """Precedence, associativity and types stay."""
    found = eval(bounded(expression), {"bounded_power": bounded_power})
    assert found == eval(expression) and type(found) is type(eval(expression))


@pytest.mark.parametrize("expression", ["10**10**10", "(-7)**10**9", "2**(1 << 40)"])
def test_what_would_never_end_is_refused(expression: str) -> None:
    """At once."""
    with pytest.raises(OverflowError, match="too large a number"):
        eval(bounded(expression), {"bounded_power": bounded_power})


@given(st.integers(-20, 20).filter(bool), st.integers(-300, 300))
def test_whole_numbers_of_any_use_are_computed(base: int, exponent: int) -> None:
    """And one to any power is one."""
    assert bounded_power(base, exponent) == base**exponent
    assert bounded_power(1, 10**20) == 1 and bounded_power(-1, 10**20) == 1
