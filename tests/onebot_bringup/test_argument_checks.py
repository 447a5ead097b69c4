"""Launch arguments that are not possible are refused with what would be."""

import pytest

from onebot_bringup.launch.arguments import (
    UsageError,
    check_domain,
    check_finite,
    check_namespace,
    check_number,
    check_port,
    check_whole,
)


def test_possible_values_are_returned():
    """With both bounds among them."""
    assert check_number("rate", "5", 5.0, 100.0) == 5.0
    assert check_number("rate", "1e2", 5.0, 100.0) == 100.0
    assert check_whole("rate", "100", 0, 100) == 100
    assert check_finite("x", "-1e9") == -1e9
    assert check_port("port", "0") == 0 and check_port("port", "65535") == 65535
    for domain in ("", "0", "232"):
        check_domain(domain)
    for namespace in ("", "/", "left", "/left/", "a/b_2"):
        check_namespace(namespace)


@pytest.mark.parametrize(
    "check, complaint",
    [
        (lambda: check_number("rate", "fast", 5, 100), "rate:=fast .* a number from 5 to 100"),
        (lambda: check_number("rate", "nan", 5, 100), "rate:=nan is not possible"),
        (lambda: check_number("rate", "101", 5, 100), "rate:=101 is not possible"),
        (lambda: check_whole("rate", "1.5", 0, 9), "rate:=1.5 .* a whole number from 0 to 9"),
        (lambda: check_whole("rate", "1_0", 0, 99), "rate:=1_0 is not possible"),
        (lambda: check_finite("x", "inf"), "x:=inf is not possible; write a number such as 1.5"),
        (lambda: check_port("port", ""), "port:= is not possible; write a whole number"),
        (lambda: check_port("port", "65536"), "port:=65536 is not possible"),
        (lambda: check_domain("233"), "domain_id:=233 .* from 0 to 232"),
        (lambda: check_namespace("1x"), "namespace:=1x is no ROS name"),
        (lambda: check_namespace("a//b"), "namespace:=a//b is no ROS name"),
    ],
)
def test_others_are_refused(check, complaint):
    """Nothing is rounded or guessed."""
    with pytest.raises(UsageError, match=complaint):
        check()
