"""Arguments of functions, checked by their annotations."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pytest

from onebot_description.errors import OneBotError
from onebot_description.parameters.arguments import ArgumentError, checked, checked_methods
from onebot_description.parameters.values import Rule, ValueType


@checked
def everything(
    number: Annotated[float, Rule(above=0.0)] = 1.0,
    count: Annotated[int, Rule(at_least=0, at_most=2**64 - 1)] = 1,
    flag: bool = True,
    file: "str | Path | None" = None,
    point: Annotated[Sequence[float], ValueType(float, Rule(), True, 3)] = (0.0, 0.0, 0.0),
    names: Mapping[Annotated[str, Rule(not_empty=True)], float] | None = None,
    call: Callable[[], object] = dict,
    anything: Any = None,
) -> "NeverDefined":  # type: ignore[name-defined] # noqa: F821
    return locals()


@pytest.mark.parametrize(
    ("given", "value"),
    [
        ({"number": 2}, 2.0),
        ({"number": np.float32(0.5)}, 0.5),
        ({"number": np.array(0.25)}, 0.25),
        ({"count": np.uint64(2**64 - 1)}, 2**64 - 1),
        ({"flag": np.False_}, False),
        ({"file": Path("a")}, Path("a")),
        ({"file": None}, None),
        ({"names": {"a": np.float64(1.5), "b": 2}}, {"a": 1.5, "b": 2.0}),
        ({"anything": [1, "x"]}, [1, "x"]),
    ],
)
def test_right_arguments(given: dict[str, Any], value: Any) -> None:
    """Numbers of any library become Python's."""
    (name,) = given
    used = everything(**given)[name]
    assert used == value and type(used) is type(value)


def test_sequences_stay_as_they_are() -> None:
    for point in (np.zeros(3, np.float32), [1, 2, 3], (1.0, np.float32(2.0), 3)):
        assert everything(point=point)["point"] is point


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"number": "1"}, 'number: "1" is a string; write a number above 0'),
        ({"number": None}, "number: has no value; write a number above 0"),
        ({"number": 0}, "number: 0 is not above 0"),
        ({"number": np.array([1.0, 2.0])}, "number: [1.0, 2.0] is a list"),
        ({"count": 1.0}, "count: 1.0 is a number; write an integer"),
        ({"count": 10**400}, "count: needs more than 64 bits"),
        ({"flag": "no"}, 'flag: "no" is a string; write True or False'),
        ({"file": 3}, "file: 3 is a number; write a string or a path"),
        ({"file": b"x"}, "file: b'x' cannot be used here"),
        ({"point": (0.0, 0.0)}, "point: 2 numbers; write 3"),
        ({"point": np.zeros((3, 1))}, "point: [0.0] is a list"),
        ({"names": ["a"]}, "names: ['a'] is a list; write a dict"),
        ({"names": {"a": "1"}}, 'names.a: "1" is a string; write a number'),
        ({"names": {"": 1.0}}, "names: is empty"),
        ({"call": True}, "call: true is a bool; write a function"),
    ],
)
def test_wrong_arguments(given: dict[str, Any], words: str) -> None:
    with pytest.raises(OneBotError) as caught:
        everything(**given)
    assert words in str(caught.value)
    assert isinstance(caught.value, ValueError)


def test_all_wrong_arguments_are_named_at_once() -> None:
    with pytest.raises(ArgumentError) as caught:
        everything("1", -1, names={"a": "x", 2: None})
    keys = [problem.key for problem in caught.value.problems]
    assert keys == ["number", "count", "names.a", "names", "names.2"]


def test_classes_check_what_is_public() -> None:
    ready: list[object] = []

    @checked_methods(before=ready.append)
    @dataclass(frozen=True)
    class Door:
        width: float = 1.0

        def open(self, angle: float) -> float:
            return angle

        def close(self) -> None: ...

        def _force(self, how: float) -> float:
            return how

    door = Door(np.float32(2.0))
    assert type(door.width) is float and not ready
    assert door.open(1) == 1.0 and ready == [door]
    door.close()
    assert len(ready) == 1
    assert door._force("hard") == "hard"  # type: ignore[arg-type]
    for wrong in (lambda: Door("wide"), lambda: door.open("a bit")):  # type: ignore[arg-type]
        with pytest.raises(ArgumentError, match="write a number"):
            wrong()
    assert door.open.__doc__ == Door.open.__doc__ and Door.open.__name__ == "open"
