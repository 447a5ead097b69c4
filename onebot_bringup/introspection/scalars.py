"""The text of one value as what a message's field is: boolean, number, byte or string."""

import math
from collections.abc import Callable
from typing import Any

_TRUE = ("true", "yes", "on", "1")
_FALSE = ("false", "no", "off", "0")
_LARGEST_FLOAT32 = 3.4028235677973366e38  # what rounds to the largest finite one


def read_scalar(kind: str, text: str, finite: bool = True) -> Any:
    """Return the value that ``text`` stands for.

    Args:
        kind: rosidl's name of a basic type: ``boolean``, ``double``, ``int32``, ``octet``, ...
        text: as written in YAML.
        finite: refuse infinities and NaN.

    Raises:
        ValueError: it is no such value; the message is the end of a sentence that begins with
            the field's name.
    """
    if kind == "octet" and len(text) == 1 and not text.isdigit() and ord(text) < 256:
        return bytes([ord(text)])  # as it is printed
    return _reader(kind)(kind, text.strip(), finite)


def _reader(kind: str) -> Callable[[str, str, bool], Any]:
    if kind == "boolean":
        return _boolean
    if kind in ("float", "double", "long double"):
        return _floating
    if kind == "octet":
        return _octet
    if kind in ("char", "wchar"):
        return _character
    return _integer


def _boolean(_: str, text: str, __: bool) -> bool:
    if text.lower() in _TRUE:
        return True
    if text.lower() in _FALSE:
        return False
    raise ValueError(f'is true or false, not "{text}"')


def _floating(kind: str, text: str, finite: bool) -> float:
    lower = text.lower().replace(".inf", "inf").replace(".nan", "nan")
    try:
        value = float(lower)
    except ValueError:
        raise ValueError(f'is a number, not "{text}"') from None
    if not math.isfinite(value):
        spelled = any(word in lower for word in ("inf", "nan"))
        if finite or not spelled:
            advice = "; --allow-non-finite lets it through" if spelled else ""
            raise ValueError(f'is a finite number, not "{text}"{advice}')
    elif kind == "float" and abs(value) >= _LARGEST_FLOAT32:
        raise ValueError(f"is a float32, too small for {text}")
    return value


def _integer(kind: str, text: str, _: bool) -> int:
    try:
        value = int(text, 0) if not text.lstrip("+-").isdigit() else int(text)
    except ValueError:
        value = _whole(kind, text)
    bits = int(kind.lstrip("uint"))
    low, high = (0, 2**bits - 1) if kind.startswith("u") else (-(2 ** (bits - 1)), 2 ** (bits - 1))
    high = high if kind.startswith("u") else high - 1
    if not low <= value <= high:
        raise ValueError(f"is an {kind} from {low} to {high}, not {text}")
    return value


def _whole(kind: str, text: str) -> int:
    """2.0 and 1e3 are whole numbers; 2.5 is not, and is never cut off silently."""
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not math.isfinite(number) or number != int(number):
        raise ValueError(f'is a whole number ({kind}), not "{text}"')
    return int(number)


def _octet(_: str, text: str, __: bool) -> bytes:
    return bytes([_integer("uint8", text, True)])


def _character(kind: str, text: str, _: bool) -> str:
    if len(text) != 1:
        raise ValueError(f'is one character, not "{text}"')
    return text
