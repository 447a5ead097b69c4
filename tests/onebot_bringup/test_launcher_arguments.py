"""How ``name:=value`` command lines are read."""

import pytest

from onebot_bringup.launch.arguments import (
    Argument,
    choice,
    complete,
    number,
    refuse_positional,
    ros_settings,
    split,
    switch,
    table,
)
from onebot_description.errors import UsageError

DECLARED = [
    choice("viewer", "web", "where to see it", ("web", "none")),
    Argument("save", "", "a file"),
    switch("reload", True, "take up edits"),
]
NUMBERS = [
    number("rate", "20.0", "Hz", 5.0, 100.0),
    number("x", "0.0", "m"),
    number("count", "", "how many", 1, 99, int),
    *ros_settings(),
]


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
    offered = [argument.suggested for argument in (*DECLARED, NUMBERS[-1])]
    assert offered == [("web", "none"), ("",), ("true", "false"), ("localhost", "subnet")]


def test_all_problems_are_told_at_once() -> None:
    with pytest.raises(UsageError) as caught:
        complete(DECLARED, {"veiwer": "x", "viewer": "x11", "reload": "yes"})
    message = str(caught.value)
    assert 'no argument "veiwer" (did you mean "viewer"?' in message
    assert "viewer:=x11 is not possible; it can be one of: web, none" in message
    assert "reload:=yes is not possible; it can be one of: true, 1, false, 0" in message


@pytest.mark.parametrize(
    ("name", "answer"),
    [
        ("use_gui", "joints move as joints:=FILE says, without sliders"),
        ("gui", "write viewer:=web, viewer:=native or viewer:=none for the view; joints move"),
        ("rvizconfig", "what the viewer shows is in view:=FILE"),
    ],
)
def test_former_arguments(name: str, answer: str) -> None:
    """What launch files of ROS call otherwise is answered with how it is written here."""
    with pytest.raises(UsageError) as error:
        complete(DECLARED, {name: "true"})
    assert str(error.value).startswith(f'no argument "{name}": {answer}')


@pytest.mark.parametrize(
    ("written", "meant"), [("true", "true"), ("1", "true"), ("False", "false"), ("0", "false")]
)
def test_switches_take_both_spellings(written: str, meant: str) -> None:
    assert complete(DECLARED, {"reload": written}) == {"viewer": "web", "save": "", "reload": meant}


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("rate", ["5", "100", "1e2", "5.5"]),
        ("x", ["-1e9", "0", ".5"]),
        ("count", ["", "1", "99"]),
        ("namespace", ["", "/", "left", "/left/", "a/b_2"]),
    ],
)
def test_possible_values_are_kept_as_written(name: str, values: list[str]) -> None:
    """With both ends of a range, and empty where the default is."""
    for value in values:
        assert complete(NUMBERS, {name: value})[name] == value


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
        complete(NUMBERS, split([word]).given)
    assert str(caught.value).startswith(f"{word} is not possible; ")
    assert words in str(caught.value)


def test_the_table_names_everything() -> None:
    """--show-args lists name, default, description, and choices or range."""
    shown = [line.split(maxsplit=1) for line in table([*DECLARED, *NUMBERS[:3]]).splitlines()]
    assert shown == [
        ["viewer:=web", "where to see it (web, none)"],
        ["save:=", "a file"],
        ["reload:=true", "take up edits"],
        ["rate:=20.0", "Hz; from 5 to 100"],
        ["x:=0.0", "m"],
        ["count:=", "how many; from 1 to 99"],
    ]
    longest = table([Argument("n" * 40, "", "text"), DECLARED[1]])
    assert longest.splitlines()[1] == f"  {'save:=':34}  a file"
    hostile = table([Argument("a\x1b[2J", "\u202e", "declared in \x07.xacro")])
    assert hostile == r"  a\x1b[2J:=\u202e  declared in \x07.xacro"
