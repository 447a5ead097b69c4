#!/usr/bin/env python3
"""The command ``onebot <verb> ...``: prepares the process, and runs the verb.

This module imports nothing slow, since Ctrl-C prints a traceback before ``start_process`` runs.
"""

import sys
from collections.abc import Sequence

from onebot_bringup.cli.verbs import VERBS, help_command, run_verb
from onebot_bringup.launch.program import INTERRUPTED, run_command, start_process


def main(argv: Sequence[str] | None = None) -> int:
    """Run ``onebot`` with ``argv`` (default: the command line's) and return the exit code."""
    words = list(sys.argv[1:] if argv is None else argv)
    verb = VERBS.get(words[0] if words else "")
    interrupted = verb.interrupted if verb else INTERRUPTED
    if argv is None:
        start_process(interrupted)
    return run_command(lambda: run_verb(words), _complete, lambda: help_command(words), interrupted)


def _complete(words: list[str]) -> None:
    from onebot_bringup.cli.completion import complete

    complete(words)


if __name__ == "__main__":
    sys.exit(main())
