"""``onebot accuracy``: OneBot's odometry and motion accuracy, as a table."""

from collections.abc import Sequence

from onebot_control.accuracy import main


def run(argv: Sequence[str]) -> int:
    """Run the command and return its exit code; see onebot_control/accuracy."""
    return main(list(argv))
