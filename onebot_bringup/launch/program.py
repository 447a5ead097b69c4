"""Runs a command as a process: Ctrl-C, errors without a traceback, and the exit code.

Exit codes: 0 success, or stopped by the user; 1 a mistake in the user's files, or a node failed;
2 a wrong command line; 130 a plain command was interrupted; 141 the output pipe was closed.

This module imports nothing slow, since Ctrl-C prints a traceback before ``start_process`` runs.
"""

import os
import sys
from collections.abc import Callable, Sequence

import onebot_description
from onebot_description.errors import DescriptionError, OneBotError, UsageError

TYPE_CHECKING = False  # typing's constant; typing is slow to import
if TYPE_CHECKING:
    from onebot_bringup.launch.bringup import Bringup

USAGE = 2
# Exit codes with which shells report SIGINT and SIGPIPE.
INTERRUPTED = 128 + 2
PIPE_CLOSED = 128 + 13
VERSION = ("-V", "--version")


def start_process(interrupted: int) -> None:
    """Prepare the process of a command, before anything slow is imported.

    Ctrl-C ends the process at once, until code that needs an orderly end installs its own handler:
    a KeyboardInterrupt would become a traceback during imports of compiled libraries and at the
    interpreter's end. Characters that the terminal's encoding lacks are printed, and read, as
    escape sequences.

    Args:
        interrupted: the exit code after Ctrl-C.
    """
    import signal

    # Background jobs of a shell ignore SIGINT, and should go on doing so.
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
        signal.signal(signal.SIGINT, lambda *_: os._exit(interrupted))
    for stream in (sys.stdin, sys.stdout):
        if stream is not None:
            stream.reconfigure(errors="backslashreplace")  # type: ignore[union-attr]


def run_command(
    body: Callable[[], int],
    complete: Callable[[list[str]], object],
    see: str | Callable[[], str],
    interrupted: int = INTERRUPTED,
) -> int:
    """Run ``body`` and return its exit code; print a user's mistake without a traceback.

    Args:
        body: the command.
        complete: completes the words that follow the program's name on the shell's line.
        see: the help command to name in usage errors, or a function that returns it.
        interrupted: the exit code after Ctrl-C.
    """
    if "_ARGCOMPLETE" in os.environ:  # the shell asks for completions
        from onebot_bringup.launch.completion import complete_line

        complete_line(complete)
    try:
        code = body()
        if sys.stdout is not None:
            sys.stdout.flush()
        return code
    except UsageError as error:
        _print_problems(error)
        print(f"see: {see if isinstance(see, str) else see()}", file=sys.stderr)
        return USAGE
    except OneBotError as error:
        _print_problems(error)
        return 1
    except KeyboardInterrupt:
        return interrupted
    except BrokenPipeError:
        # Otherwise Python would flush the closed stdout again at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        return PIPE_CLOSED


def _print_problems(error: OneBotError) -> None:
    problems: Sequence[str] = str(error).splitlines()
    warnings: Sequence[str] = ()
    if isinstance(error, DescriptionError):
        problems, warnings = error.problems, error.warnings
    for line in (*map("error: {}".format, problems), *map("warning: {}".format, warnings)):
        print(line, file=sys.stderr)


def print_version(program: str) -> int:
    """Print the installed version of a program; return the exit code."""
    print(program, onebot_description.__version__)
    return 0


def run_bringup(command: "Callable[[], Bringup]", program: str, argv: Sequence[str] | None) -> int:
    """Run a bringup command until Ctrl-C and return its exit code.

    Args:
        command: called once Ctrl-C is handled, since its imports take a moment.
        program: the command's name.
        argv: its arguments; None for this process's own, which is then prepared first.
    """
    words = sys.argv[1:] if argv is None else argv
    if argv is None:
        start_process(interrupted=0)

    def launch(words: Sequence[str]) -> int:
        if any(word in VERSION for word in words):
            return print_version(program)
        from onebot_bringup.launch.bringup import bring_up

        return bring_up(command(), words)

    def complete(words: list[str]) -> None:
        from onebot_bringup.launch.completion import complete_command

        complete_command(launch, words, 1)

    return run_command(lambda: launch(words), complete, f"{program} --help", interrupted=0)
