"""How ``name:=value`` command lines are read."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from onebot_bringup.launch.arguments import (
    NAMESPACE,
    Argument,
    DiscoverySettings,
    Settings,
    argument,
    field_of,
    refuse_positional,
    split,
    table,
)
from onebot_description.errors import UsageError


@dataclass(frozen=True)
class Viewing(Settings):
    """A command with a choice, a switch and files."""

    viewer: str = argument("web", "where to see it", choices=("web", "none"))
    save: str = argument("", "a file")
    reload: bool = argument(True, "take up edits")
    file: Path | None = argument(None, "another file")


@dataclass(frozen=True)
class Numbers(DiscoverySettings):
    """A command with numbers and names."""

    rate: float = argument(20.0, "Hz", at_least=5.0, at_most=100.0)
    x: float = argument(0.0, "m")
    count: int | None = argument(None, "how many", at_least=1, at_most=99)
    namespace: str = field_of(NAMESPACE)
    on: bool = argument(True, "a switch")


def test_words_are_split(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first := separates, the last of two counts, and --ros-args has its own words.

    The shell leaves the ~ of ``name:=~/x`` as it is.
    """
    monkeypatch.setenv("HOME", "/home/someone")
    words = ["a:=1", "a:=b:=c", "empty:=", "t:=-1 m = x", "home:=~/x", "f"]
    parts = split([*words, "--ros-args", "-r", "x:=y", "--", "-h"])
    given = {"a": "b:=c", "empty": "", "t": "-1 m = x", "home": "/home/someone/x"}
    assert parts.given == given
    assert parts.positional == ("f",) and parts.ros_args == ("-r", "x:=y")
    assert parts.help and not parts.show and split(["--help"]).help
    with pytest.raises(UsageError, match="written viewer:=none"):
        refuse_positional(split(["viewer=none"]).positional)


@pytest.mark.parametrize(
    ("word", "words"), [("--viewer=none", "viewer:=value"), ("-x", "no option")]
)
def test_wrong_forms_are_explained(word: str, words: str) -> None:
    with pytest.raises(UsageError, match=words):
        split([word])


def test_the_values_that_completion_offers() -> None:
    declared = (*Viewing.arguments()[:3], Numbers.arguments()[1])
    offered = [argument.suggested for argument in declared]
    assert offered == [("web", "none"), ("",), ("true", "false"), ("localhost", "subnet")]


def test_all_problems_are_told_at_once() -> None:
    with pytest.raises(UsageError) as caught:
        Viewing.read({"veiwer": "x", "viewer": "x11", "reload": "yes"})
    message = str(caught.value)
    assert 'no argument "veiwer" (did you mean "viewer"?' in message
    assert "viewer:=x11 is not valid; write one of web, none" in message
    assert "reload:=yes is not valid; write true or false" in message


@pytest.mark.parametrize(
    ("name", "answer"),
    [
        ("use_gui", "joints:=FILE sets how joints move, without sliders"),
        ("gui", "write viewer:=web, viewer:=native or viewer:=none for the view; joints:=FILE"),
        ("rvizconfig", "view:=FILE chooses what the viewer shows"),
    ],
)
def test_former_arguments(name: str, answer: str) -> None:
    """What launch files of ROS call otherwise is answered with how it is written here."""
    with pytest.raises(UsageError) as error:
        Viewing.read({name: "true"})
    assert str(error.value).startswith(f'no argument "{name}": {answer}')


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("rate", {"5": 5.0, "100": 100.0, "1e2": 100.0, "5.5": 5.5}),
        ("x", {"-1e9": -1e9, "0": 0.0, ".5": 0.5}),
        ("count", {"": None, "1": 1, "99": 99}),
        ("namespace", {text: text for text in ("", "/", "left", "/left/", "a/b_2")}),
        ("on", {"true": True, "1": True, "False": False, "0": False}),
    ],
)
def test_possible_values_have_the_type_of_the_argument(name: str, values: dict[str, Any]) -> None:
    """With both ends of a range, and empty where the default is."""
    for text, value in values.items():
        read = getattr(Numbers.read({name: text}), name)
        assert read == value and type(read) is type(value)


def test_what_is_not_given_has_the_default() -> None:
    """Also one that differs for a command; the file is a path, and what is written is known."""
    settings = Viewing.read({"save": "x"}, file="a/b.yaml", viewer="none")
    assert settings == Viewing(frozenset({"save"}), "none", "x", True, Path("a/b.yaml"))
    assert Viewing.read({"file": ""}, file="a/b.yaml").file is None


@pytest.mark.parametrize(
    ("word", "words"),
    [
        ("rate:=nan", "write a number from 5 to 100"),
        ("rate:=", "write a number from 5 to 100"),
        ("x:=inf", "write a number"),
        ("count:=1.5", "write an integer from 1 to 99"),
        ("domain_id:=233", "write an integer from 0 to 232"),
        ("namespace:=1x", "write a ROS name: words of letters"),
    ],
)
def test_impossible_values_are_refused(word: str, words: str) -> None:
    """Nothing is rounded or guessed."""
    with pytest.raises(UsageError) as caught:
        Numbers.read(split([word]).given)
    assert str(caught.value).startswith(f"{word} is not valid; ")
    assert words in str(caught.value)


def test_the_table_names_everything() -> None:
    """--show-args lists name, default, description, and choices or range."""
    shown = [
        line.split(maxsplit=1)
        for line in table([*Viewing.arguments()[:3], *Numbers.arguments()[2:5]]).splitlines()
    ]
    assert shown == [
        ["viewer:=web", "where to see it (web, none)"],
        ["save:=", "a file"],
        ["reload:=true", "take up edits"],
        ["rate:=20.0", "Hz; from 5 to 100"],
        ["x:=0.0", "m"],
        ["count:=", "how many; from 1 to 99"],
    ]
    longest = table([Argument("n" * 40, "", "text"), Viewing.arguments()[1]])
    assert longest.splitlines()[1] == f"  {'save:=':34}  a file"
    hostile = table([Argument("a\x1b[2J", "\u202e", "declared in \x07.xacro")])
    assert hostile == r"  a\x1b[2J:=\u202e  declared in \x07.xacro"
