"""Errors that a user can cause and fix, and the hints in their messages."""

from collections.abc import Iterable

_MAX_LISTED = 12
_MAX_SHOWN = 100  # characters


def nearest(name: str, candidates: Iterable[str]) -> str | None:
    """Return the candidate most similar to ``name``, or None if none is similar.

    Case is ignored; about six in ten letters must agree.
    """
    from difflib import get_close_matches  # slow to import, and all commands import this module

    known = sorted(set(candidates))
    # Compared without case, but returned as written.
    lowered = {candidate.lower(): candidate for candidate in reversed(known)}
    found = get_close_matches(name.lower(), lowered, n=1, cutoff=0.6)
    return lowered[found[0]] if found else None


def listing(names: Iterable[str], most: int = _MAX_LISTED) -> str:
    """Return ``names`` sorted and joined by commas; if there are many, the first ``most``."""
    known = sorted(set(names))
    if not known:
        return "none"
    rest = f", and {len(known) - most} more" if len(known) > most else ""
    return ", ".join(known[:most]) + rest


def did_you_mean(name: str, candidates: Iterable[str], what: str = "known") -> str:
    """Return a hint to append to a message about an unknown ``name``.

    For example `` (did you mean "link1"? known: base_link, link1)``, with a leading space. Of many
    candidates only the most similar are listed.

    Args:
        name: the unknown name.
        candidates: the valid names.
        what: the word before the list, such as "declared" or "joints".
    """
    known = list(candidates)
    guess = nearest(name, known)
    question = f'did you mean "{guess}"? ' if guess is not None else ""
    rest = len(set(known)) - _MAX_LISTED
    if rest > 0:
        # The most similar ones: the first of the alphabet would be no help.
        from difflib import get_close_matches

        alike = get_close_matches(name, set(known), n=_MAX_LISTED, cutoff=0.0)
        return f" ({question}{what}: {', '.join(alike)}, and {rest} more)"
    return f" ({question}{what}: {listing(known)})"


def shortened(text: str, most: int = _MAX_SHOWN) -> str:
    """Return ``text`` for a message: of a long one only the first ``most`` characters."""
    return text if len(text) <= most else f"{text[:most]}..."


class OneBotError(Exception):
    """A user's mistake; ``str(error)`` is the whole message, commands exit with code 1."""


class UsageError(OneBotError):
    """A wrong command line; commands exit with code 2."""


class DescriptionError(OneBotError):
    """A robot description that cannot be used; ``problems`` holds all that was found.

    Each problem names file, element and remedy.
    """

    def __init__(self, problems: Iterable[str]) -> None:
        """Join ``problems`` into one message, a line each."""
        self.problems = tuple(problems)
        super().__init__("\n".join(self.problems))
