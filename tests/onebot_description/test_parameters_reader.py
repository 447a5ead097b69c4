"""ros.parameters.reader: values to checked dataclasses, with every mistake named."""

import math
import re
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import pytest
import rclpy
from rclpy.node import Node
from rclpy.parameter import Parameter

from onebot_description.parameters.reader import (
    REQUIRED,
    ConfigError,
    Problem,
    as_map,
    defaults,
    group,
    help_text,
    is_parameter,
    parameter,
    read,
    replaced,
    unknown_parameters,
    values_of,
)
from onebot_description.ros.node_parameters import (
    declare,
    descriptor,
    refuse_undeclared,
    ros_parameter,
)
from tests.ros_support import ros_args


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


def refused(values: Mapping[str, Any], kind: type = Settings) -> str:
    """The message with which ``values`` are refused."""
    with pytest.raises(ConfigError) as caught:
        read(kind, values)
    return str(caught.value)


def test_nothing_given_is_the_defaults() -> None:
    config = read(Settings, {})
    assert (config.rate, config.camera, config.lines) == (10.0, Camera(), {})
    assert math.isnan(config.limit)


def test_values_are_converted() -> None:
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
        ({"rate": {"a": 1}}, "rate.a: is one value, not a map"),
        ({"main.camera": 3}, "main.camera: 3 is a number; write a map with eye, near, far"),
        ({"main": {"camera": {"eye": [1.0]}}}, "main.camera.eye: 1 numbers; write 3"),
        ({"main.camera": {"near": 11.0}}, "main.camera.near: must be less than far"),
        ({"zeros": 1.0}, "zeros: 1.0 is a number; write a map"),
        ({"name": {}}, "name: is a map; write a string"),
        ({"lines.a.width": 1.0}, "lines.a: has no topic, what is drawn"),
        ({"lines.a.topic": "no good"}, '"no good" is not valid; write a topic, such as odom'),
        ({"lines.a.topc": "odom"}, 'lines.a.topc: no such parameter (did you mean "topic"?'),
        ({"rat": 1}, 'rat: no such parameter (did you mean "rate"?'),
        ({"main.camera.eyes": []}, 'main.camera.eyes: no such parameter (did you mean "eye"?'),
    ],
)
def test_mistakes_are_named_with_what_would_be_right(values: dict[str, Any], words: str) -> None:
    assert words in refused(values)
    assert len(refused(values).splitlines()) == 1


def test_all_mistakes_are_reported_at_once_with_their_places() -> None:
    places = {"rate": "a.yaml:1", "lines.a.width": "a.yaml:7"}
    with pytest.raises(ConfigError) as caught:
        read(Settings, {"rate": 0, "colour": 1, "lines.a.width": 1.0}, places)
    lines = str(caught.value).splitlines()
    assert lines[0].startswith("colour: no such parameter")
    assert lines[1].startswith("a.yaml:1: rate: ")
    assert lines[2].startswith("a.yaml:7: lines.a: ")


def test_what_holds_for_several_values_is_checked_where_each_is_right() -> None:
    assert len(refused({"main.camera": {"near": "x", "far": 0.05}}).splitlines()) == 1
    assert len(refused({"main.camera": {"near": 11.0}, "rate": "x"}).splitlines()) == 2


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
    assert refused({"mass": 1.0, "spokes": 5, "center": [0, 0, 0]}, Plain) == "camera: is missing"


def test_names_and_defaults_as_ros_has_them() -> None:
    found = defaults(Settings)
    assert found["main.camera.eye"] == found["frames"] == found["color"] == []
    assert found["main.camera.far"] == 10.0
    assert "zeros" not in found
    changed = values_of(Settings(camera=Camera(eye=(1.0, 2.0, 3.0))))
    assert changed["main.camera.eye"] == [1.0, 2.0, 3.0]
    assert is_parameter(Settings, "poses.home.elbow") and not is_parameter(Settings, "pose")
    unknown = unknown_parameters(Settings, ["rate", "zeros.a", "use_sim_time", "rates"])
    assert [problem.key for problem in unknown] == ["rates"]
    fixed = {"mass": None, "spokes": None, "center": [], "camera.eye": []}
    assert defaults(Plain) == {**fixed, "camera.near": 0.1, "camera.far": 10.0}
    names = ["lines", "lines.a", "lines.a.topic", "zeros", "main.camera", "poses.home"]
    assert all(is_parameter(Settings, name) for name in names)
    names = ["lines.a.topics", "main", "rate.a", "main.cameras", "speed"]
    assert not any(is_parameter(Settings, name) for name in names)


def test_what_every_node_has_is_neither_a_parameter_nor_a_mistake() -> None:
    """Only those names, and those that begin as rclpy's own."""
    names = ["use_sim_time", "start_type_description_service", "qos_overrides./a.b", "overrides.a"]
    assert unknown_parameters(Settings, names) == []
    assert read(Settings, dict.fromkeys(names, 1)).rate == 10.0
    names = ["use_sim_times", "qos_overrides", "overridesa"]
    assert [problem.key for problem in unknown_parameters(Settings, names)] == names


@dataclass(frozen=True)
class Mark:
    """With a dotted name, and another that is its end."""

    width: float = parameter(0.0, "m")
    edge: float = parameter(0.0, "m", name="edge.width")


@dataclass(frozen=True)
class View:
    """Groups and a map, as a saved view has them."""

    size: tuple[float, float] | None = parameter(None, "m")
    frame: str = parameter("odom", "a frame")
    camera: Camera = group(Camera, "main.camera")
    marks: Mapping[str, Mark] = parameter({}, "marks by name")


def test_names_of_the_user_s_own_may_hold_dots() -> None:
    values = {"marks.a.b.edge.width": 1.0, "marks.a.b.width": 2.0, "marks.edge.width": 3.0}
    config = read(View, values)
    assert config.marks == {"a.b": Mark(2.0, 1.0), "edge": Mark(3.0)}
    assert "marks.a.b.depth: no such parameter" in refused({"marks.a.b.depth": 1.0}, View)
    assert refused({"marks.a": 1.0}, View).startswith("marks.a: 1.0 is a number; write a map with")


def test_maps_are_what_is_not_the_default() -> None:
    assert as_map(View()) == as_map(View(marks={}, camera=Camera())) == {}
    marks = {"a": Mark(), "b": Mark(edge=0.5)}
    view = View((1.0, 2.0), "map", Camera(far=5.0), marks)
    written = {
        "size": [1.0, 2.0],
        "frame": "map",
        "main.camera": {"far": 5.0},
        "marks": {"a": {}, "b": {"edge.width": 0.5}},
    }
    assert as_map(view) == written
    assert read(View, {**written, "marks.a.width": 0.0}) == view
    assert as_map(View(camera=Camera(eye=(0.0, 0.0, 1.0)))) == {
        "main.camera": {"eye": [0.0, 0.0, 1.0]}
    }


@pytest.mark.parametrize("order", [1, -1])
def test_an_empty_map_changes_nothing(order: int) -> None:
    values = [("main.camera", {}), ("main.camera.far", 5.0), ("zeros", {}), ("frames", ["a"])]
    config = read(Settings, dict(values[::order]))
    assert (config.camera, config.zeros, config.frames) == (Camera(far=5.0), {}, ("a",))


def test_one_parameter_is_replaced() -> None:
    changed = replaced(Settings(), "main.camera.near", 1)
    assert changed.camera == Camera(near=1.0) and isinstance(changed.camera.near, float)
    assert (changed.rate, replaced(changed, "rate", 20).camera) == (10.0, changed.camera)
    assert replaced(View((1.0, 2.0)), "size", []) == View()
    for name, value, words in [
        ("rate", 0, "rate: 0 is not above 0"),
        ("rates", 1, 'rates: no such parameter (did you mean "rate"?'),
        ("main.camera", 1, "main.camera: 1 is a number; write a map"),
    ]:
        with pytest.raises(ConfigError, match=re.escape(words)):
            replaced(Settings(), name, value)


def test_the_place_of_a_problem() -> None:
    """Its parameter's own, or that of the first in its group; nobody else's."""
    places = {"lines.ab.width": "f:1", "lines.a.width": "f:2", "lines.a.topic": "f:3", "b": "f:4"}
    assert Problem("lines.a.topic", "t").message(places) == "f:3: lines.a.topic: t"
    assert Problem("lines.a", "t").message(places) == "f:2: lines.a: t"
    assert Problem("line", "t").message(places) == "line: t"
    assert Problem("", "t").message(places) == Problem("", "t").message() == "t"
    error = ConfigError([Problem("b", "t"), Problem("", "u")])
    assert (str(error), str(error.located(places))) == ("b: t\nu", "f:4: b: t\nu")


@dataclass(frozen=True)
class Ranges:
    """Of every form."""

    most: float = parameter(0.0, "m", at_most=5.0, read_only=True)
    least: int = parameter(0, "steps", at_least=-2)
    up_to: int = parameter(0, "steps", at_most=2)
    beyond: int = parameter(2, "steps", above=1)
    free: float = parameter(0.0, "m")


_MOST, _INTEGERS = sys.float_info.max, (-(2**63), 2**63 - 1)


@pytest.mark.parametrize(
    ("kind", "name", "floats", "integers"),
    [
        (Settings, "rate", (0.0, 100.0), None),
        (Settings, "count", None, (1, 9)),
        (Settings, "lines.a.width", (0.0, _MOST), None),
        (Ranges, "most", (-_MOST, 5.0), None),
        (Ranges, "least", None, (-2, _INTEGERS[1])),
        (Ranges, "up_to", None, (_INTEGERS[0], 2)),
        (Ranges, "beyond", None, (1, _INTEGERS[1])),
        (Ranges, "free", None, None),
    ],
)
def test_ranges_as_ros_has_them(
    kind: type,
    name: str,
    floats: tuple[float, float] | None,
    integers: tuple[int, int] | None,
) -> None:
    found = descriptor(kind, name)
    given = [(one.from_value, one.to_value) for one in found.floating_point_range]
    assert given == ([floats] if floats else [])
    given = [(one.from_value, one.to_value, one.step) for one in found.integer_range]
    assert given == ([(*integers, 1)] if integers else [])
    assert found.dynamic_typing and found.description
    assert found.read_only == (name == "most")


def test_descriptions_as_ros_has_them() -> None:
    assert "\n    count (int, default 3): how many; from 1" in help_text(Settings)
    found = descriptor(Settings, "main.camera.eye")
    assert found.description == "where it is, m"
    assert found.additional_constraints == "a list of 3 numbers, such as [0.0, 1.0, 2.0]"
    for name in ("main.camera", "lines", "lines.a", "nothing", "lines.a.b", "rate.a"):
        found = descriptor(Settings, name)
        assert found.dynamic_typing and not (found.description or found.additional_constraints)


def test_a_list_without_items_is_one_of_strings() -> None:
    made = ros_parameter("a", [])
    assert (made.name, made.type_, made.value) == ("a", Parameter.Type.STRING_ARRAY, [])
    assert ros_parameter("a", [1.0]).type_ == Parameter.Type.DOUBLE_ARRAY


def test_a_node_declares_them(ros_domain: int) -> None:
    line = {"rate": 20, "count": 5, "name": "line", "frames": "[a]", "main.camera.near": -1.0}
    rclpy.init(args=ros_args(**line, **{"zeros.elbow": 1}))
    node = Node("settings")
    try:
        given = {"count": 7, "mode": "fast", "zeros.elbow": None, "colour": "red"}
        given |= {"zeros.wrist": None, "main.camera.far": 2000}
        found = declare(node, Settings, given, {"name": "fixed"})
        changed = {"rate": 20, "count": 5, "name": "fixed", "frames": ["a"], "mode": "fast"}
        changed |= {"main.camera.near": -1.0, "main.camera.far": 2000, "zeros.elbow": 1}
        assert math.isnan(found.pop("limit"))
        wanted = {**defaults(Settings), **changed}
        del wanted["limit"]
        assert found == wanted
        assert node.get_parameter("colour").value == "red"  # declared, though nobody's
        again = declare(node, Settings, {"rate": 1.0})
        assert again["rate"] == 20
        described = {name: node.describe_parameter(name) for name in ("rate", "color", "name")}
        assert described["rate"].floating_point_range[0].to_value == 100.0
        assert described["color"].description == "sRGB bytes"
        # Out of its range: without the range, for ``read`` to report it.
        assert not node.describe_parameter("main.camera.near").floating_point_range
        assert refused(found) == ("main.camera.near: -1 is not above 0; write a number above 0")
        refusal = node.set_parameters([ros_parameter("rate", 1000.0)])[0]
        assert not refusal.successful
        # An integer is a double where the parameter is one, whoever sets it.
        refuse_undeclared(node, Settings)
        node.set_parameters([ros_parameter("main.camera.far", 30)])
        for name in ("rate", "zeros.elbow", "main.camera.far"):
            assert node.get_parameter(name).type_ == Parameter.Type.DOUBLE, name
        assert node.get_parameter("count").type_ == Parameter.Type.INTEGER
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
