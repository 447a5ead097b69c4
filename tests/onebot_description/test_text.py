"""Words for error messages."""

from onebot_description.description import DescriptionError
from onebot_description.errors import OneBotError, alike, condensed, did_you_mean, listing, nearest


def test_nearest_forgives_slips_and_case() -> None:
    """A slip of the pen or of the case is recognised; something else is not."""
    assert nearest("base_lnik", ["base_link", "link1"]) == "base_link"
    assert nearest("BASE_LINK", ["base_link", "link1"]) == "base_link"
    assert nearest("zzz", ["base_link", "link1"]) is None
    assert nearest("a", []) is None


def test_alike_are_those_with_the_most_similar_last_word() -> None:
    topics = ["/drive/cmd_vel", "/drive/odom", "/r10/odom", "/r2/odom", "/r3/odom", "/odometry"]
    assert alike("/r10/odm", topics)[0] == "/r10/odom", "the one in its namespace"
    assert alike("/Odm", topics) == ["/drive/odom", "/r2/odom", "/r3/odom"]
    assert alike("/r1/odom", ["/r1/odom"]) == alike("/voltage", topics) == alike("/x", []) == []


def test_did_you_mean_lists_what_exists() -> None:
    assert did_you_mean("lnk1", ["link1", "base"]) == ' (did you mean "link1"? known: base, link1)'
    assert did_you_mean("zzz", iter(["b", "a"]), "joints") == " (joints: a, b)"
    assert did_you_mean("zzz", []) == " (known: none)"
    assert did_you_mean("a", ["a", "b"]) == " (known: b)", "not itself"


def test_long_lists_are_cut() -> None:
    hint = did_you_mean("whel", ["wheel", *(f"joint_{index}" for index in range(100))])
    assert hint.startswith(' (did you mean "wheel"? known: joint_0, joint_1, joint_2, ')
    assert hint.endswith(", and 89 more)")
    assert listing("cab", most=2) == "a, b, and 1 more"
    assert listing(["robot10", "robot2", "robot"]) == "robot, robot2, robot10"


def test_very_many_names_are_not_compared() -> None:
    """That would take minutes; how many there are is shown."""
    names = [f"joint_of_the_left_leg_{number}" for number in range(100_000)]
    assert did_you_mean("joint_of_the_left_leg", names, "joints") == " (100000 joints)"


def test_what_a_terminal_would_obey_is_escaped() -> None:
    assert str(OneBotError('link "a\x1b[2Jb\u202ec\u200f\xa0d"\nmore \udc80 \u05d0 é')) == (
        'link "a\\x1b[2Jb\\u202ec\\u200f\\xa0d"\nmore \\udc80 \u05d0 é'
    )
    assert listing(["b\x1b[2J", "a"]) == "a, b\\x1b[2J"
    assert DescriptionError(["a\nb", "c"]).problems == ("a\\nb", "c")


def test_many_messages_of_one_kind_are_one_line() -> None:
    alike = [f'r.urdf:{n}: link "l{n}": no "m{n}" (did you mean "k{n}"?)' for n in range(100_000)]
    lines = condensed(["first", *alike, "last", "x" * 1_000_000])
    assert lines[:3] == ("first", f"{alike[0]} (and 99999 more of this kind)", "last")
    assert len(lines) == 4 and len(lines[3]) < 2100
    assert condensed(alike[:20]) == tuple(alike[:20])
    assert str(DescriptionError(alike)) == lines[1]
