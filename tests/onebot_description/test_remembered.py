"""What is remembered of messages: the latest, neither too many nor too large together."""

from onebot_description.wire import remembered
from onebot_description.wire.remembered import MOST, MOST_BYTES, Remembered


def _reversing() -> tuple[list[str], Remembered[str, str]]:
    made: list[str] = []

    def reverse(text: str) -> str:
        made.append(text)
        return text[::-1]

    return made, Remembered(reverse, len)


def test_an_equal_argument_gives_the_same_object() -> None:
    made, reverse = _reversing()
    assert reverse("abc") == "cba"
    assert reverse("abc") is reverse("ab" + "c")
    assert made == ["abc"]


def test_the_oldest_of_too_many_is_forgotten() -> None:
    made, reverse = _reversing()
    for _ in range(2):
        for number in range(MOST):
            reverse(str(number))
    assert len(made) == MOST
    reverse("one more")
    reverse("1")
    assert len(made) == MOST + 1
    reverse("0")
    assert made[-1] == "0"


def test_the_oldest_of_what_is_too_large_together_is_forgotten() -> None:
    """A small one that came after it is not."""
    made, reverse = _reversing()
    texts = [letter * (MOST_BYTES // 4) for letter in "abc"]
    for text in [*texts, "small", *texts]:
        reverse(text)
    assert len(made) == 4
    reverse("d" * (MOST_BYTES // 4))
    assert len(made) == 5
    reverse(texts[1])
    reverse("small")
    assert len(made) == 5
    reverse(texts[0])
    assert len(made) == 6


def test_the_latest_is_remembered_however_large_it_is() -> None:
    made, reverse = _reversing()
    large = "x" * (2 * MOST_BYTES)
    for text in ("small", large, large, "small"):
        reverse(text)
    assert made == ["small", large, "small"]
    assert remembered.size_of_names(("ab", "", "c")) == 27
