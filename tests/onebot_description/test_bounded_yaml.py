"""ros.parameters.bounded_yaml: whatever a file holds is read, or refused, soon."""

import contextlib
import os
from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from onebot_bringup.bags.bag_reader import Bag
from onebot_bringup.introspection.parameter_values import parse_value
from onebot_bringup.viewer.view_config import load_view, parse_view
from onebot_control.control_files import ControlFiles
from onebot_control.drive_kinds import ControlConfig
from onebot_description.errors import OneBotError
from onebot_description.joints.config import JointsConfig
from onebot_description.parameters import bounded_yaml
from onebot_description.parameters.files import read_files, read_map, read_parameters
from onebot_description.parameters.reader import ConfigError, read
from tests.readme import CHECKOUT

NESTED = "".join(f"{' ' * level}a:\n" for level in range(3000))
BOMB = "a: &a [x, x]\n" + "".join(
    f"{name}: &{name} [{', '.join([f'*{before}'] * 10)}]\n"
    for before, name in zip("abcdefghij", "bcdefghijk", strict=True)
)
MANY = "a: [" + "1, " * 600_000 + "1]\n"
HOSTILE = {
    "nested": (NESTED, "nested more than 64 deep"),
    "alias bomb": (BOMB, "more than 500000 values"),
    "many": (MANY, "more than 500000 values"),
    "within itself": ("a: &a {b: *a}\n", "more than 500000 values"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_too_much_is_refused_with_its_line(name: str) -> None:
    """As a map, by an error of the parameters; elsewhere by PyYAML's own."""
    text, words = HOSTILE[name]
    with pytest.raises(ConfigError, match=f"view.yaml:.*{words}"):
        read_map(text, "view.yaml")
    with pytest.raises(yaml.YAMLError, match=words):
        bounded_yaml.load(text)


def test_every_file_of_users_is_read_within_the_bounds(tmp_path: Path) -> None:
    file = tmp_path / "metadata.yaml"
    file.write_text(NESTED)
    for read_it in (
        lambda: read_files([file], "/jsp", JointsConfig),
        lambda: ControlFiles([file], "/", "velocity_controller").parameters(),
        lambda: load_view(file),
        lambda: Bag(tmp_path),  # without a file that holds messages
    ):
        with pytest.raises(OneBotError):
            read_it()
    assert parse_value(NESTED)[2] == NESTED, "a string, as all that is not YAML"


_SEEDS = [
    (CHECKOUT / file).read_text()
    for file in (
        "onebot_control/config/control.yaml",
        "onebot_description/config/dimensions.yaml",
        "onebot_description/config/view.yaml",
        "mrm_description/config/joints.yaml",
    )
]
_BITS = (
    "[ ] { } : - &a *a !!int !!set !!omap << \0 ' \" \n | > % @ 1e999 .nan 0x 1:1 ~ null ? \t = "
    "!!binary !!timestamp !!python/object:a.b 2020-01-01 \ufeff \\0"
).split(" ")
_damages = st.lists(
    st.tuples(st.floats(0.0, 1.0), st.integers(0, 8), st.sampled_from(_BITS) | st.text(max_size=3)),
    min_size=1,
    max_size=6,
)


@given(st.sampled_from(_SEEDS), _damages)
def test_a_damaged_file_is_read_or_refused(
    text: str, damages: list[tuple[float, int, str]]
) -> None:
    for where, length, bit in damages:
        at = int(where * len(text))
        text = f"{text[:at]}{bit} {text[at + length :]}"
    for read_damaged in (
        lambda: read_map(text, "file.yaml"),
        lambda: parse_view(text),
        lambda: read(JointsConfig, read_parameters(text, "f.yaml", "/jsp").values),
        lambda: read(ControlConfig, read_parameters(text, "f.yaml", "/controller").values),
    ):
        with contextlib.suppress(OneBotError):
            read_damaged()


def test_aliases_that_repeat_little_are_fine() -> None:
    assert bounded_yaml.load("a: &a {b: 1}\nc: [*a, *a]\n") == {"a": {"b": 1}, "c": [{"b": 1}] * 2}


def test_only_regular_files_are_read(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.yaml")
    for file in (tmp_path / "pipe.yaml", Path("/dev/zero"), tmp_path):
        with pytest.raises(
            ConfigError, match="cannot be read: (not a regular file|Is a directory)"
        ):
            read_files([file], "/jsp", JointsConfig)


def test_a_huge_file_is_refused(tmp_path: Path) -> None:
    with (tmp_path / "huge.yaml").open("wb") as file:
        file.truncate(10**11)
    with pytest.raises(ConfigError, match="larger than 50 MB"):
        read_files([tmp_path / "huge.yaml"], "/jsp", JointsConfig)


@pytest.mark.parametrize("text", ['!!int ""', "!!bool x", "!!timestamp x"])
def test_a_tag_that_does_not_suit_its_value_is_invalid(text: str) -> None:
    """PyYAML raises errors of several kinds."""
    with pytest.raises(ConfigError, match=r"view.yaml:1: "):
        read_map(f"a: {text}\n", "view.yaml")
    with pytest.raises(yaml.YAMLError):
        bounded_yaml.load(f"a: {text}\n")


def test_exponents_need_no_point() -> None:
    assert bounded_yaml.load("[1e5, -1E-05, .5e3, '1e5', e5]") == [1e5, -1e-05, 500.0, "1e5", "e5"]
