"""What all commands share: how an error is shown and which exit code it has.

Exit codes: 0 success, or stopped by the user; 1 a mistake in the user's files, or a node failed;
2 a command line that is not understood; 130 and 141 a plain command was interrupted, or whoever
read its output left.

Nothing is imported here that takes long: until ``run_command`` runs, Ctrl-C is answered by Python,
with a traceback.
"""

import os
import sys
from collections.abc import Callable

from onebot_description.errors import DescriptionError, OneBotError, UsageError

USAGE = 2
INTERRUPTED = 128 + 2  # as shells report SIGINT
READER_LEFT = 128 + 13  # as shells report SIGPIPE


def run_command(
    body: Callable[[], int], see: str | Callable[[], str], interrupted: int = INTERRUPTED
) -> int:
    """Run ``body`` and return its exit code; a user's mistake is shown without a traceback.

    Args:
        body: the command.
        see: the command that shows how it is used, for errors of usage; or what finds it out.
        interrupted: the exit code after Ctrl-C.
    """
    try:
        code = body()
        if sys.stdout is not None:
            sys.stdout.flush()
        return code
    except UsageError as error:
        _complain(error)
        print(f"see: {see if isinstance(see, str) else see()}", file=sys.stderr)
        return USAGE
    except OneBotError as error:
        _complain(error)
        return 1
    except KeyboardInterrupt:
        return interrupted
    except BrokenPipeError:
        # Python would try to flush again on its way out.
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        return READER_LEFT


def _complain(error: OneBotError) -> None:
    problems = error.problems if isinstance(error, DescriptionError) else str(error).splitlines()
    for problem in problems:
        print(f"error: {problem}", file=sys.stderr)
