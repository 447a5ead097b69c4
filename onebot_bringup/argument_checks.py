"""What launch arguments can be, beside their choices: numbers, ports, names of ROS."""

import math
import re

from onebot_bringup.launcher.arguments import UsageError

_NAMESPACE = re.compile(r"/?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*/?")
_MAX_DOMAIN = 232  # beyond it the ports of DDS (RTPS 2.2, section 9.6.1.1) exceed 65535
_MAX_PORT = 65535


def check_number(name: str, text: str, least: float, most: float) -> float:
    """Return the number that an argument is.

    Args:
        name: of the argument.
        text: as it was written.
        least: the least that is possible.
        most: the most.

    Raises:
        UsageError: it is none, or beyond those.
    """
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not least <= number <= most:  # also refuses nan
        raise _impossible(name, text, f"a number from {least:g} to {most:g}")
    return number


def check_whole(name: str, text: str, least: int, most: int) -> int:
    """Return the whole number that an argument is, as ``check_number`` does."""
    # The nodes and ROS read it anew, and do not take all that Python takes, such as 1_000.
    if not (text.isascii() and text.isdecimal() and least <= int(text) <= most):
        raise _impossible(name, text, f"a whole number from {least} to {most}")
    return int(text)


def check_finite(name: str, text: str) -> float:
    """Return the number that an argument is, whatever its size.

    Raises:
        UsageError: it is none.
    """
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise _impossible(name, text, "a number such as 1.5")
    return number


def check_port(name: str, text: str) -> int:
    """Return the port that an argument is, 0 for any.

    Raises:
        UsageError: it is none.
    """
    return check_whole(name, text, 0, _MAX_PORT)


def check_domain(text: str) -> None:
    """Refuse a ``domain_id`` that ROS cannot have; empty is the environment's.

    Raises:
        UsageError: it is one.
    """
    if text:
        check_whole("domain_id", text, 0, _MAX_DOMAIN)


def check_namespace(namespace: str) -> None:
    """Refuse a ``namespace`` that ROS cannot have; the outer slashes may be left out.

    Raises:
        UsageError: it is one.
    """
    if namespace.strip("/") and not _NAMESPACE.fullmatch(namespace):
        raise UsageError(
            f"namespace:={namespace} is no ROS name; write words of letters, digits and _ that do"
            " not start with a digit, joined by /"
        )


def _impossible(name: str, text: str, possible: str) -> UsageError:
    return UsageError(f"{name}:={text} is not possible; write {possible}")
