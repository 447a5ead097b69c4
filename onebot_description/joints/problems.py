"""Mistakes and remarks about joint parameters, each tied to the parameter it is about."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from onebot_description.errors import OneBotError


@dataclass(frozen=True)
class Problem:
    """One thing that is wrong or surprising.

    Attributes:
        key: dotted name of the parameter (or of the group), such as ``motions.elbow.frequency``;
            empty when no parameter is to blame.
        text: what is wrong and what would be right.
    """

    key: str
    text: str

    def message(self, places: Mapping[str, str] | None = None) -> str:
        """Return ``place: key: text``.

        Args:
            places: where each parameter was written, such as ``joints.yaml:7``.
        """
        parts = (self._place(places or {}), self.key, self.text)
        return ": ".join(part for part in parts if part)

    def _place(self, places: Mapping[str, str]) -> str:
        """The place of the parameter itself, else of the first one inside the group it names."""
        if self.key in places:
            return places[self.key]
        if not self.key:
            return ""
        inside = self.key + "."
        return next((place for key, place in places.items() if key.startswith(inside)), "")


class ConfigError(OneBotError):
    """Joint parameters that cannot be used.

    Attributes:
        problems: every problem found.
    """

    def __init__(
        self, problems: Iterable[Problem], places: Mapping[str, str] | None = None
    ) -> None:
        """Join ``problems`` into one message, a line each; ``places`` as in Problem.message."""
        self.problems = tuple(problems)
        super().__init__("\n".join(problem.message(places) for problem in self.problems))

    def located(self, places: Mapping[str, str]) -> "ConfigError":
        """Return the same error, its message naming where each parameter was written."""
        return ConfigError(self.problems, places)
