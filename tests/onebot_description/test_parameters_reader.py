"""onebot_description.parameters.reader: values to checked dataclasses, with every mistake named."""

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import pytest

from onebot_description.parameters.reader import (
    REQUIRED,
    ConfigError,
    Problem,
    defaults,
    group,
    is_parameter,
    parameter,
    read,
    unknown_parameters,
    values_of,
)


@dataclass(frozen=True)
class Line:
    """One of several, by name."""

    topic: str = parameter(
        REQUIRED, "what is drawn", pattern=re.compile(r"\w+"), write="a topic, such as odom"
    )
    width: float = parameter(0.01, "m", at_least=0.0)


@dataclass(frozen=True)
class Camera:
    """A group, with a rule between two of it."""

    eye: tuple[float, float, float] | None = parameter(None, "where it is, m")
    near: float = parameter(0.1, "m", above=0.0)
    far: float = parameter(10.0, "m", above=0.0)

    def check(self) -> Iterator[Problem]:
        if self.near >= self.far:
            yield Problem("near", "must be less than far")


@dataclass(frozen=True)
class Settings:
    """One of every kind."""

    rate: float = parameter(10.0, "Hz", above=0.0, at_most=100.0)
    count: int = parameter(3, "how many", at_least=1, at_most=9)
    name: str = parameter("odom", "a frame", not_empty=True)
    mode: str = parameter("auto", "how", choices=("auto", "fast"))
    on: bool = parameter(True, "whether")
    color: tuple[int, int, int] | None = parameter(None, "sRGB bytes", at_least=0, at_most=255)
    frames: tuple[str, ...] = parameter((), "the frames", unique=True)
    limit: float = parameter(math.nan, "m/s", at_least=0.0, nan="no limit")
    camera: Camera = group(Camera, "main.camera")
    zeros: Mapping[str, float] = parameter({}, "rad")
    poses: Mapping[str, Mapping[str, float]] = parameter({}, "rad")
    lines: Mapping[str, Line] = parameter({}, "lines by name")

    REMEDIES: ClassVar[Mapping[str, str]] = {"speed": "write rate"}


def refused(values: Mapping[str, Any], kind: type = Settings) -> str:
    """The message with which ``values`` are refused."""
    with pytest.raises(ConfigError) as caught:
        read(kind, values)
    return str(caught.value)


def test_nothing_given_is_the_defaults() -> None:
    """Every field has its own."""
    config = read(Settings, {})
    assert (config.rate, config.camera, config.lines) == (10.0, Camera(), {})
    assert math.isnan(config.limit)


def test_values_are_converted() -> None:
    """Whole numbers are numbers, lists tuples, an empty list is not given; names nest or not."""
    values = {
        "rate": 20,
        "color": [1, 2, 3],
        "main": {"camera": {"eye": [], "far": 5}},
        "main.camera.near": 1,
        "zeros": {"arm.elbow": 1},
        "poses.home.arm.elbow": 0.5,
        "lines": {"a.b": {"topic": "odom"}},
        "limit": math.nan,
    }
    config = read(Settings, values)
    assert isinstance(config.rate, float) and config.rate == 20.0
    assert config.color == (1, 2, 3)
    assert config.camera == Camera(None, 1.0, 5.0)
    assert config.zeros == {"arm.elbow": 1.0}
    assert config.poses == {"home": {"arm.elbow": 0.5}}
    assert config.lines == {"a.b": Line("odom", 0.01)}


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"rate": 0}, "rate: 0 is not above 0; write a number above 0 and up to 100"),
        ({"rate": 101.0}, "rate: 101 is above 100"),
        ({"rate": True}, "rate: true is a bool; write a number above 0"),
        ({"rate": math.nan}, "rate: nan is not finite"),
        ({"rate": 10**400}, "rate: inf is not finite"),
        ({"rate": None}, "rate: has no value; write a number"),
        ({"rate": {"a": 1}}, "rate.a: is one value, not a map"),
        ({"count": 2.0}, "count: 2.0 is a number; write an integer from 1 to 9"),
        ({"count": 0}, "count: 0 is below 1"),
        ({"name": ""}, "name: is empty; write a string"),
        ({"name": 5}, 'name: 5 is a number; write a string, such as "5"'),
        ({"mode": "fst"}, 'mode: no "fst" (did you mean "fast"?'),
        ({"on": 1}, "on: 1 is a number; write true or false"),
        ({"color": [1, 2]}, "color: 2 integers; write 3: sRGB bytes"),
        ({"color": [1, 2, 256]}, "color: 256 is above 255; write a number from 0 to 255"),
        ({"frames": "odom"}, 'frames: "odom" is a string; write a list of strings, such as [first'),
        ({"frames": ["a", "b", "a"]}, 'frames: "a" is there twice'),
        ({"frames": [1]}, "frames: 1 is a number; write a list of strings"),
        ({"limit": -1}, "limit: -1 is below 0; write a number from 0, or .nan for no limit"),
        ({"limit": math.inf}, "limit: inf is not finite"),
        ({"main.camera": 3}, "main.camera: 3 is a number; write a map with eye, near, far"),
        ({"main": {"camera": {"eye": [1.0]}}}, "main.camera.eye: 1 numbers; write 3"),
        ({"main.camera": {"near": 11.0}}, "main.camera.near: must be less than far"),
        ({"zeros": 1.0}, "zeros: 1.0 is a number; write a map, such as {some_name: 0.5}"),
        ({"zeros.a": "x"}, 'zeros.a: "x" is a string; write a number'),
        ({"lines.a.width": 1.0}, "lines.a: has no topic, what is drawn"),
        ({"lines": {"a": {}}}, "lines.a: has no topic"),
        ({"lines.a.topic": "no good"}, '"no good" is not possible; write a topic, such as odom'),
        ({"lines.a.topc": "odom"}, 'lines.a.topc: no such parameter (did you mean "topic"?'),
        ({"rat": 1}, 'rat: no such parameter (did you mean "rate"?'),
        ({"main.camera.eyes": []}, 'main.camera.eyes: no such parameter (did you mean "eye"?'),
        ({"speed": 1}, "speed: no longer a parameter; write rate"),
    ],
)
def test_mistakes_are_named_with_what_would_be_right(values: dict[str, Any], words: str) -> None:
    """One line each."""
    assert words in refused(values)
    assert len(refused(values).splitlines()) == 1


def test_all_mistakes_are_reported_at_once_with_their_places() -> None:
    """Also those in groups, whose place is that of the first parameter in it."""
    places = {"rate": "a.yaml:1", "lines.a.width": "a.yaml:7"}
    with pytest.raises(ConfigError) as caught:
        read(Settings, {"rate": 0, "colour": 1, "lines.a.width": 1.0}, places)
    lines = str(caught.value).splitlines()
    assert lines[0].startswith("colour: no such parameter")
    assert lines[1].startswith("a.yaml:1: rate: ")
    assert lines[2].startswith("a.yaml:7: lines.a: ")


def test_a_check_reports_nothing_that_follows_from_another_mistake() -> None:
    """A far that is wrong has its default, which near is not compared with in the message."""
    assert refused({"main.camera": {"near": "x"}}).count("main.camera") == 1


@dataclass(frozen=True)
class Plain:
    """Without any rules."""

    mass: float
    spokes: int
    center: tuple[float, float, float]
    camera: Camera


def test_plain_dataclasses_require_every_field() -> None:
    """A field without a default must be given; nothing else need be said of it."""
    values = {"mass": 1, "spokes": 5, "center": [0, 0.5, 1], "camera": {"far": 2.0}}
    assert read(Plain, values) == Plain(1.0, 5, (0.0, 0.5, 1.0), Camera(far=2.0))
    text = refused({"mass": 1.0, "spokes": 5.5, "camera": {}}, Plain)
    assert text.splitlines() == [
        "spokes: 5.5 is a number; write an integer",
        "center: is missing",
    ]


def test_names_and_defaults_as_ros_has_them() -> None:
    """Dotted, lists for tuples, an empty list for what is not given."""
    found = defaults(Settings)
    assert found["main.camera.eye"] == found["frames"] == found["color"] == []
    assert found["main.camera.far"] == 10.0
    assert "zeros" not in found
    changed = values_of(Settings(camera=Camera(eye=(1.0, 2.0, 3.0))))
    assert changed["main.camera.eye"] == [1.0, 2.0, 3.0]
    assert is_parameter(Settings, "poses.home.elbow") and not is_parameter(Settings, "pose")
    unknown = unknown_parameters(Settings, ["rate", "zeros.a", "use_sim_time", "rates"])
    assert [problem.key for problem in unknown] == ["rates"]
