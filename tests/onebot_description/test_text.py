"""Words for error messages."""

from onebot_description.errors import did_you_mean, listing, nearest


def test_nearest_forgives_slips_and_case() -> None:
    """A slip of the pen or of the case is recognised; something else is not."""
    assert nearest("base_lnik", ["base_link", "link1"]) == "base_link"
    assert nearest("BASE_LINK", ["base_link", "link1"]) == "base_link"
    assert nearest("zzz", ["base_link", "link1"]) is None
    assert nearest("a", []) is None


def test_did_you_mean_lists_what_exists() -> None:
    """The hint has a guess if there is one, and always the list."""
    assert did_you_mean("lnk1", ["link1", "base"]) == ' (did you mean "link1"? known: base, link1)'
    assert did_you_mean("zzz", iter(["b", "a"]), "joints") == " (joints: a, b)"
    assert did_you_mean("zzz", []) == " (known: none)"


def test_long_lists_are_cut_to_the_most_alike() -> None:
    """Of many candidates the most alike are shown, and how many there are besides."""
    names = [f"joint_{index}" for index in range(100)] + ["wheel"]
    hint = did_you_mean("whel", names)
    assert hint.startswith(' (did you mean "wheel"? known: wheel, ')
    assert hint.endswith(", and 89 more)")
    assert listing("cab", most=2) == "a, b, and 1 more"
