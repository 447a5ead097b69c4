"""Errors that a user can cause and can mend: each message is complete in itself."""

from collections.abc import Iterable

_MOST_LISTED = 12


def nearest(name: str, candidates: Iterable[str]) -> str | None:
    """Return the candidate that ``name`` was probably meant to be, or None if none is alike.

    A difference in case only always counts as alike; otherwise about six letters in ten must agree.
    """
    from difflib import get_close_matches  # slow to import, and commands start with this module

    known = sorted(set(candidates))
    # Compared without case, but answered as it is written.
    lowered = {candidate.lower(): candidate for candidate in reversed(known)}
    found = get_close_matches(name.lower(), lowered, n=1, cutoff=0.6)
    return lowered[found[0]] if found else None


def listing(names: Iterable[str], most: int = _MOST_LISTED) -> str:
    """Return ``names`` sorted and joined by commas; if there are many, the first ``most``."""
    known = sorted(set(names))
    if not known:
        return "none"
    rest = f", and {len(known) - most} more" if len(known) > most else ""
    return ", ".join(known[:most]) + rest


def did_you_mean(name: str, candidates: Iterable[str], what: str = "known") -> str:
    """Return what to append to a message about an unknown ``name``.

    It reads for example `` (did you mean "link1"? known: base_link, link1)``, with a leading space.
    Of many candidates only the most alike are listed.

    Args:
        name: what was written.
        candidates: what would have been right.
        what: the word before the list, such as "declared" or "joints".
    """
    known = list(candidates)
    guess = nearest(name, known)
    question = f'did you mean "{guess}"? ' if guess is not None else ""
    rest = len(set(known)) - _MOST_LISTED
    if rest > 0:
        # The likeliest first: an alphabet's beginning would help nobody.
        from difflib import get_close_matches

        alike = get_close_matches(name, set(known), n=_MOST_LISTED, cutoff=0.0)
        return f" ({question}{what}: {', '.join(alike)}, and {rest} more)"
    return f" ({question}{what}: {listing(known)})"


class OneBotError(Exception):
    """A user's mistake; ``str(error)`` is the whole message, commands exit with code 1."""


class UsageError(OneBotError):
    """A command was called in a way it does not know; commands exit with code 2."""


class DescriptionError(OneBotError):
    """A robot description that cannot be used; ``problems`` holds all that was found.

    Each problem names file, element and remedy.
    """

    def __init__(self, problems: Iterable[str]) -> None:
        """Join ``problems`` into one message, a line each."""
        self.problems = tuple(problems)
        super().__init__("\n".join(self.problems))
