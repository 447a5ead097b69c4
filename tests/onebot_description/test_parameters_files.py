"""ros.parameters.files: as rcl reads, with line numbers, and what a save changes."""

from collections.abc import Callable
from pathlib import Path

import pytest
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.node import Node

from onebot_description.joints.config import JointsConfig
from onebot_description.parameters.files import (
    LiveParameters,
    plain_value,
    read_files,
    read_map,
    read_parameters,
    section_matches,
)
from onebot_description.parameters.reader import ConfigError, defaults
from onebot_description.parameters.values import plain

NODE, LIVE_NODE = "/ns/jsp", "/jsp"
FILE = """\
/**:
  ros__parameters: {everywhere: 1, twice: first}
/*/jsp:
  ros__parameters: {star: 1}
/**/jsp:
  ros__parameters: {stars: 1}
jsp:
  ros__parameters: {elsewhere: 1}
/ns/jsp:
  ros__parameters:
    empty: []
    double: 1e3
    words: [yes, no]
    nested: {deep: {er: -0x10}, "with.dot": 010}
    quoted: "5"
    not_finite: [.nan, -.inf, inf]
    under: 1_000
    big: 99999999999999999999
    plus: +3
    point: .5
    y: n
    void: ''
ns:
  jsp:
    ros__parameters: {twice: second}
  other:
    ros__parameters: {elsewhere: 2}
/*/*:
  ros__parameters: {late: 1}
"""


def test_a_file_reads_as_rcl_reads_it(tmp_path: Path, start_node: Callable[..., Node]) -> None:
    (tmp_path / "file.yaml").write_text(FILE)
    ros = ["--ros-args", "-r", "__ns:=/ns", "--params-file", str(tmp_path / "file.yaml")]
    node = start_node(lambda: Node("jsp", cli_args=ros))
    ours = read_parameters(FILE, "file.yaml", NODE).values
    theirs = {}
    for name in (*ours, "empty", "elsewhere"):
        node.declare_parameter(name, None, ParameterDescriptor(dynamic_typing=True))
        theirs[name] = plain(node.get_parameter(name).value)
    assert repr(theirs) == repr({**ours, "empty": None, "elsewhere": None})
    assert ours["twice"] == "second"


def test_places_are_the_lines() -> None:
    places = read_parameters(FILE, "file.yaml", NODE).places
    assert places["nested.deep.er"] == "file.yaml:14"
    assert places["twice"] == "file.yaml:25"


def test_words_are_what_rcl_takes_them_for() -> None:
    words = ("on", "No", "YeS", "09", "1:30", "2020-01-01", "null", "0b1", "1e400x")
    expected = [True, False, "YeS", 9.0, "1:30", "2020-01-01", "null", "0b1", "1e400x"]
    assert [plain_value(word) for word in words] == expected


@pytest.mark.parametrize(
    ("section", "node", "matches"),
    [
        ("jsp", "/jsp", True),
        ("/jsp", "/ns/jsp", False),
        ("/**", "/a/b/c", True),
        ("/*", "/a/b", False),
        ("/**/jsp", "/jsp", True),
        ("/*/jsp", "/jsp", False),
        ("/a/*/jsp", "/a/b/jsp", True),
    ],
)
def test_sections(section: str, node: str, matches: bool) -> None:
    assert section_matches(section, node) is matches


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("jsp:\n  ros__parameters:\n    rate: [1, 2\n", "file.yaml:4: invalid YAML"),
        (
            "a:\n  ros__parameters: {}\n  ros__parameters: {}\n",
            ':3: "ros__parameters" occurs twice',
        ),
        ("jsp:\n  ros__parameters:\n    a: [1, 2.0]\n", ":3: a: a list holds values of one kind"),
        ("jsp:\n  ros__parameters:\n    a: [1, b]\n", "quote all its strings"),
        ("jsp:\n  ros__parameters:\n    a: [[1]]\n", ":3: a: a list holds plain values"),
        ("jsp:\n  ros__parameters:\n    rate:\n", ":3: rate: has no value"),
        ("jsp:\n  rate: 1\n", ':2: "rate" must hold a map with "ros__parameters:"'),
        ("just words", 'file.yaml:1: "just words" is in place of a map'),
    ],
)
def test_mistakes_name_file_and_line(text: str, words: str) -> None:
    with pytest.raises(ConfigError) as caught:
        read_parameters(text, "file.yaml", "/jsp")
    assert words in str(caught.value)


def test_names_may_be_repeated() -> None:
    """Maps of one name are one map, as to rcl; of two values the later one counts."""
    text = """\
/**:
  jsp:
    ros__parameters: {gains: {p: 1.0}, rate: 1, gains: {d: 2.0}}
/**:
  jsp:
    ros__parameters: {"$(var prefix)rate": 2, frames: [$(var prefix)a, b$(var side)]}
"""
    found = read_parameters(text, "f.yaml", "/jsp")
    assert found.values == {"gains.p": 1.0, "rate": 2, "gains.d": 2.0, "frames": ["a", "b"]}
    assert found.warnings == [
        "f.yaml:6: only ros2 launch can replace $(var prefix); it is left out",
        "f.yaml:6: only ros2 launch can replace $(var side); it is left out",
    ]
    twice = "jsp:\n  ros__parameters:\n    rate: 1\n    rate: 2\n"
    assert read_parameters(twice, "f.yaml", "/jsp").warnings == [
        "f.yaml:4: rate: is also at f.yaml:3; this later one counts"
    ]


def test_other_yaml_files_are_maps_with_lines_too() -> None:
    text = "a: &b\n  c: [1, 2.5, x]\n  d:\ne: *b\nf: {}\n"
    found = read_map(text, "view.yaml")
    assert found.values == {
        "a.c": [1, 2.5, "x"],
        "a.d": None,
        "e.c": [1, 2.5, "x"],
        "e.d": None,
        "f": {},
    }
    assert (found.places["a.c"], found.places["f"]) == ("view.yaml:2", "view.yaml:5")
    assert read_map("# nothing\n", "view.yaml").values == {}


def test_later_files_come_first_and_shared_sections_may_be_for_others(tmp_path: Path) -> None:
    one, two = tmp_path / "one.yaml", tmp_path / "two.yaml"
    one.write_text("/**:\n  ros__parameters: {rate: 5, publish_frequency: 1.0}\n")
    two.write_text("/jsp:\n  ros__parameters: {rate: 6, rates: 7}\n")
    found = read_files([one, two], "/jsp", JointsConfig)
    assert found.values == {"rate": 6, "rates": 7}
    assert found.places["rate"] == f"{two}:2"
    one.write_text("/**/jsp:\n  ros__parameters: {rates: 5}\n")
    assert "rates" in read_files([one], "/jsp", JointsConfig).values, "it names this node"


def write(file: Path, parameters: str) -> Path:
    """Write parameters for the node."""
    file.write_text(f"jsp:\n  ros__parameters: {{{parameters}}}\n")
    return file


def test_a_save_makes_everything_as_the_file_says(tmp_path: Path) -> None:
    file = write(tmp_path / "a.yaml", "rate: 5, zeros: {a: 1.0}")
    live = LiveParameters([file], LIVE_NODE, JointsConfig)
    current = {**defaults(JointsConfig), **live.file.values, "pose": "up"}
    assert live.changes(live.file, {**current, "pose": "", "rate": 5.0}) == {}
    write(file, "rate: 6, zeros: {b: 1.0}")
    changes = live.changes(live.read(), current)
    assert changes == {"rate": 6, "zeros.b": 1.0, "pose": "", "zeros.a": None}


def test_files_without_a_section_for_the_node_are_a_warning(tmp_path: Path) -> None:
    file = tmp_path / "one.yaml"
    file.write_text("joint_state_publishr:\n  ros__parameters: {rate: 5}\n")
    warning = LiveParameters([file], "/joint_state_publisher", JointsConfig).warning
    assert warning == (
        f"{file} has no section for /joint_state_publisher, only for /joint_state_publishr"
    )
    assert LiveParameters([write(file, "rate: 5")], LIVE_NODE, JointsConfig).warning is None
