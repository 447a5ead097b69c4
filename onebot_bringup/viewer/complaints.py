"""What keeps something from being shown, said once and in words."""

from collections.abc import Callable, Collection, Iterable

from onebot_description.text import did_you_mean, listing

# How long a link or a frame may take before its absence is said (seconds).
COMPLAIN_AFTER = 3.0


class Complaints:
    """Says each sentence once for a description, and now and then that there is none."""

    def __init__(self, clock: Callable[[], float]) -> None:
        """Count from now, in the seconds of ``clock``."""
        self._clock = clock
        self._started = clock()
        self._said: set[str] = set()
        self._next_hint = 2.0

    def forget(self) -> None:
        """Say everything again where it is still true."""
        self._said.clear()

    def once(self, sentences: Iterable[str]) -> list[str]:
        """Return those of ``sentences`` not said so far."""
        new = [sentence for sentence in sentences if sentence not in self._said]
        self._said.update(new)
        return new

    def waiting(self) -> list[str]:
        """Return, from time to time, that the description is waited for."""
        waited = self._clock() - self._started
        if waited < self._next_hint:
            return []
        self._next_hint = max(10.0, 2 * self._next_hint)
        return [
            f"waiting for the robot's description on robot_description ({waited:.0f} s); "
            "it comes from robot_state_publisher"
        ]


def missing_fixed_frame(wanted: str, shown: str, heard: Collection[str]) -> str:
    """Say that the frame ``wanted`` is not there, and ``shown`` takes its place."""
    return (
        f'the fixed frame "{wanted}" is not on /tf or /tf_static'
        f'{did_you_mean(wanted, heard, "frames heard")}; shown in "{shown}" until it is'
    )


def missing_links(fixed_frame: str, missing: Collection[str]) -> str:
    """Say which frames no transform connects with ``fixed_frame``."""
    return (
        f'no transform yet from "{fixed_frame}" to {listing(missing, 5)}: '
        "not shown until /tf or /tf_static brings it"
    )
