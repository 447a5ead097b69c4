"""Errors that a user can cause and fix, and the hints in their messages."""

import re
from collections import Counter
from collections.abc import Collection, Iterable, Sequence

_MAX_LISTED = 12
_MAX_COMPARED = 1000  # names; comparing one with them takes some hundredths of a second
_MAX_ALIKE = 20
_MAX_LENGTH = 2000  # characters of one message
# What messages of one kind differ in: names, numbers and hints.
_PARTICULARS = re.compile(r' ?\([^()]*\)|"[^"]*"|\d+')
_MAX_SHOWN = 100  # characters
_NUMBERS = re.compile(r"(\d{1,1000})", re.ASCII)


def nearest(name: str, candidates: Iterable[str]) -> str | None:
    """Return the candidate most similar to ``name``, or None if none is similar.

    Case is ignored; about six in ten letters must agree.
    """
    from difflib import get_close_matches  # slow to import, and all commands import this module

    names = sorted(set(candidates))
    # Compared without case, but returned as written.
    lowered = {candidate.lower(): candidate for candidate in reversed(names)}
    matches = get_close_matches(name.lower(), lowered, n=1, cutoff=0.6)
    return lowered[matches[0]] if matches else None


def natural_order(name: str) -> tuple[list[tuple[int, str]], str]:
    """Return a key that sorts robot2 before robot10."""
    words = _NUMBERS.split(name)
    return [(int(word), "") if word.isdecimal() else (0, word) for word in words], name


def listing(names: Iterable[str], most: int = _MAX_LISTED) -> str:
    """Return ``names`` sorted and joined by commas; if there are many, the first ``most``."""
    sorted_names = sorted(set(names), key=natural_order)
    if not sorted_names:
        return "none"
    ending = f", and {len(sorted_names) - most} more" if len(sorted_names) > most else ""
    return ", ".join(map(printable, sorted_names[:most])) + ending


def did_you_mean(name: str, candidates: Iterable[str], what: str = "known") -> str:
    """Return a hint to append to a message about an unknown ``name``.

    For example `` (did you mean "link1"? known: base_link, link1)``, with a leading space. Of many
    candidates only the most similar are listed.

    Args:
        name: the unknown name.
        candidates: the valid names.
        what: the word before the list, such as "declared" or "joints".
    """
    if isinstance(candidates, Collection) and len(candidates) > _MAX_COMPARED:
        return f" ({len(candidates)} {what})"
    names = [candidate for candidate in candidates if candidate != name]
    guess = nearest(name, names)
    question = f'did you mean "{guess}"? ' if guess is not None else ""
    surplus = len(set(names)) - _MAX_LISTED
    if surplus > 0:
        # The most similar ones: the first of the alphabet would be no help.
        from difflib import get_close_matches

        alike = get_close_matches(name, set(names), n=_MAX_LISTED, cutoff=0.0)
        return f" ({question}{what}: {', '.join(alike)}, and {surplus} more)"
    return f" ({question}{what}: {listing(names)})"


def printable(text: str) -> str:
    r"""Return ``text`` in one line, with what would move the cursor or turn the text escaped.

    That is all that has no shape of its own: ``\x1b`` and ``\n``, but also marks for writing from
    right to left and spaces that are not the common one.
    """
    if text.isprintable():
        return text
    return "".join(
        char if char.isprintable() else char.encode("unicode_escape").decode() for char in text
    )


def condensed(messages: Sequence[str]) -> tuple[str, ...]:
    """Return ``messages``; of many of one kind the first, with their number, and none too long."""
    kinds = [_PARTICULARS.sub("", message[:_MAX_LENGTH]) for message in messages]
    counts = Counter(kinds)
    lines = []
    for message, kind in zip(messages, kinds, strict=True):
        count = counts[kind]
        message = clipped(message)
        if count > _MAX_ALIKE:
            message += f" (and {count - 1} more of this kind)"
            counts[kind] = 0
        if count:
            lines.append(message)
    return tuple(lines)


def clipped(message: str) -> str:
    """Return ``message``; of a very long one, such as one with very long names, only its ends."""
    half = _MAX_LENGTH // 2
    return message if len(message) <= _MAX_LENGTH else f"{message[:half]} ... {message[-half:]}"


def shortened(text: str, most: int = _MAX_SHOWN) -> str:
    """Return ``text`` for a message: of a long one only the first ``most`` characters."""
    return text if len(text) <= most else f"{text[:most]}..."


class OneBotError(Exception):
    """A user's mistake; ``str(error)`` is the whole message, commands exit with code 1."""

    def __init__(self, message: str = "") -> None:
        super().__init__("\n".join(map(printable, message.split("\n"))))


class UsageError(OneBotError):
    """A wrong command line; commands exit with code 2."""


class DescriptionError(OneBotError):
    """A robot description that cannot be used.

    ``problems`` and ``warnings`` hold all that was found, each with file, element and remedy.
    """

    def __init__(self, problems: Iterable[str], warnings: Iterable[str] = ()) -> None:
        self.problems = condensed(list(map(printable, problems)))
        self.warnings = condensed(list(map(printable, warnings)))
        super().__init__("\n".join((*self.problems, *map("warning: {}".format, self.warnings))))
