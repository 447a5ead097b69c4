"""What other nodes report of the joints, which counts more than what we make up."""

import math
from collections.abc import Iterable, Sequence

import numpy as np

from onebot_description.joints.limits import FloatArray


class Feedback:
    """The last value heard of each of N joints.

    Attributes:
        position: (N,) rad or m; NaN for a joint never heard of.
        velocity: (N,) rad/s or m/s; NaN likewise.
        effort: (N,) N m or N; NaN likewise.
    """

    def __init__(self, names: Sequence[str]) -> None:
        """Begin with nothing heard of the joints ``names``."""
        self._index = {name: number for number, name in enumerate(names)}
        self.position = np.full(len(names), math.nan)
        self.velocity = np.full(len(names), math.nan)
        self.effort = np.full(len(names), math.nan)

    @property
    def any(self) -> bool:
        """Whether the position of any joint was heard."""
        return _any(self.position)

    @property
    def any_velocity(self) -> bool:
        """Whether the velocity of any joint was heard."""
        return _any(self.velocity)

    @property
    def any_effort(self) -> bool:
        """Whether the effort of any joint was heard."""
        return _any(self.effort)

    def hear(
        self,
        names: Sequence[str],
        position: Sequence[float],
        velocity: Sequence[float],
        effort: Sequence[float],
    ) -> str | None:
        """Take in one message.

        Each list is as long as ``names``, or empty when it says nothing. Values that are not finite
        and joints that are not ours are passed over.

        Returns:
            None, or why the whole message was ignored.
        """
        lists = {"position": position, "velocity": velocity, "effort": effort}
        for what, values in lists.items():
            if len(values) not in (0, len(names)):
                return f"{len(names)} names but {len(values)} values of {what}"
        for what, values in lists.items():
            kept: FloatArray = getattr(self, what)
            for name, value in zip(names, values, strict=False):
                number = self._index.get(name)
                if number is not None and math.isfinite(value):
                    kept[number] = value
        return None

    def take_over(self, previous: "Feedback", pairs: Iterable[tuple[int, int]]) -> None:
        """Copy what ``previous`` heard; pairs are (index here, index there)."""
        for here, there in pairs:
            self.position[here] = previous.position[there]
            self.velocity[here] = previous.velocity[there]
            self.effort[here] = previous.effort[there]


def _any(values: FloatArray) -> bool:
    return bool(np.any(~np.isnan(values)))
