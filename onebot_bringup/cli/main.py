"""``onebot <verb> ...``, and hardly an import: Ctrl-C is answered as early as can be."""

import sys
from collections.abc import Sequence

from onebot_bringup.cli.run import INTERRUPTED, run_command

# What runs until Ctrl-C has done all it was asked to when that comes.
_UNTIL_CTRL_C = ("view", "topic", "replay", "steer", "teleop")


def main(argv: Sequence[str] | None = None) -> int:
    """Run ``onebot`` with ``argv`` (default: the command line's) and return the exit code."""
    words = list(sys.argv[1:] if argv is None else argv)

    def run() -> int:
        from onebot_bringup.cli import verbs

        return verbs.run(words)

    def see() -> str:
        from onebot_bringup.cli import verbs

        return verbs.where_it_is_explained(words)

    return run_command(run, see, 0 if words and words[0] in _UNTIL_CTRL_C else INTERRUPTED)


if __name__ == "__main__":
    sys.exit(main())
