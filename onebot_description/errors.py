"""Errors that a user can cause and fix, and the hints in their messages."""

import re
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Sequence

_MAX_LISTED = 12
_MAX_COMPARED = 1000  # names; comparing with all of them takes some hundredths of a second
_MAX_ALIKE = 20  # messages of one kind; if there are more, only the first is shown
_MAX_SUGGESTED = 3
_MAX_LENGTH = 2000  # characters of one message
# Messages of one kind differ in names, numbers and hints.
_PARTICULARS = re.compile(r' ?\([^()]*\)|"[^"]*"|\d+')
_MAX_SHOWN = 100  # characters
_NUMBERS = re.compile(r"(\d{1,1000})", re.ASCII)


def nearest(name: str, candidates: Iterable[str]) -> str | None:
    """Return the candidate most similar to ``name``, ignoring case; None if none is similar."""
    from difflib import get_close_matches  # slow to import, and all commands import this module

    as_written = {candidate.lower(): candidate for candidate in sorted(candidates, reverse=True)}
    matches = get_close_matches(name.lower(), as_written, n=1)
    return as_written[matches[0]] if matches else None


def alike(name: str, candidates: Iterable[str]) -> list[str]:
    """Return up to three candidates with the last word that is most similar to that of ``name``.

    For example, ``/odm`` finds ``/robot1/odom``. Those in the namespace of ``name`` come first.
    """
    ends = {name: name.rpartition("/")[2] for name in {name, *candidates}}
    other_names = sorted(ends.keys() - {name}, key=natural_order)
    end = nearest(ends[name], {ends[candidate] for candidate in other_names})
    matches = [candidate for candidate in other_names if ends[candidate] == end]
    space = name.rpartition("/")[0]
    return sorted(matches, key=lambda full: full.rpartition("/")[0] != space)[:_MAX_SUGGESTED]


def natural_order(name: str) -> tuple[list[tuple[int, str]], str]:
    """Return a key that sorts robot2 before robot10."""
    words = _NUMBERS.split(name)
    return [(int(word), "") if word.isdecimal() else (0, word) for word in words], name


def listing(names: Iterable[str], most: int = _MAX_LISTED) -> str:
    """Return ``names`` sorted and joined by commas; if there are many, the first ``most``."""
    ordered = sorted(set(names), key=natural_order)
    more = f", and {len(ordered) - most} more" if len(ordered) > most else ""
    return ", ".join(map(printable, ordered[:most])) + more if ordered else "none"


def did_you_mean(name: str, candidates: Iterable[str], what: str = "known") -> str:
    """Return a hint to append to a message about an unknown ``name``.

    For example `` (did you mean "link1"? known: base_link, link1)``, with a leading space.
    ``what`` is the word before the list.
    """
    if isinstance(candidates, Collection) and len(candidates) > _MAX_COMPARED:
        return f" ({len(candidates)} {what})"
    names = {candidate for candidate in candidates if candidate != name}
    guess = nearest(name, names)
    question = f'did you mean "{guess}"? ' if guess is not None else ""
    return f" ({question}{what}: {listing(names)})"


def unknown_names(
    names: Iterable[str], candidates: Collection[str], what: str = "known"
) -> Iterator[tuple[str, str]]:
    """Yield the ``names`` that are not among ``candidates``, with the hint of ``did_you_mean``.

    Only the first few have a hint: comparing all the names of a large message takes too long.
    """
    known_names = {*candidates}
    unknown = [name for name in names if name not in known_names]
    for number, name in enumerate(unknown):
        yield name, did_you_mean(name, known_names, what) if number < _MAX_ALIKE else ""


def printable(text: str) -> str:
    r"""Return ``text`` with unprintable characters escaped, such as ``\x1b`` and ``\n``."""
    if text.isprintable():
        return text
    return "".join(
        char if char.isprintable() else char.encode("unicode_escape").decode() for char in text
    )


def condensed(messages: Sequence[str]) -> tuple[str, ...]:
    """Clip long messages, and replace many of one kind by the first one and their count."""
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


def first_of(messages: Sequence[str], most: int = 5) -> str:
    """Return the first few messages, one per line, and the number of further ones."""
    more = [f"and {len(messages) - most} more"] if len(messages) > most else []
    return "\n".join([*map(clipped, messages[:most]), *more])


def clipped(message: str) -> str:
    """Return ``message``; if it is very long, only its beginning and end."""
    half = _MAX_LENGTH // 2
    return message if len(message) <= _MAX_LENGTH else f"{message[:half]} ... {message[-half:]}"


def shortened(text: str, most: int = _MAX_SHOWN) -> str:
    """Return the first ``most`` characters of ``text``."""
    return text if len(text) <= most else f"{text[:most]}..."


class OneBotError(Exception):
    """A mistake that a user can fix; ``str(error)`` is the message. Commands exit with code 1."""

    def __init__(self, message: str = "") -> None:
        super().__init__("\n".join(map(printable, message.split("\n"))))


class UsageError(OneBotError):
    """A mistake in the command line; commands exit with code 2."""


class DescriptionError(OneBotError):
    """A robot description that cannot be used.

    Attributes:
        problems: everything that is wrong, each with file, line, element and how to fix it.
        warnings: further findings that alone would not prevent its use.
    """

    def __init__(self, problems: Iterable[str], warnings: Iterable[str] = ()) -> None:
        self.problems = condensed(list(map(printable, problems)))
        self.warnings = condensed(list(map(printable, warnings)))
        super().__init__("\n".join((*self.problems, *map("warning: {}".format, self.warnings))))
