#!/usr/bin/env python3
"""``onebot <verb> ...``: runs the module of the verb, prints errors and returns the exit code.

Exit codes: 0 success, or stopped by the user; 1 a mistake in the user's files, or a node failed;
2 a wrong command line; 130 a plain command was interrupted; 141 the output pipe was closed.

This module imports nothing slow, since Ctrl-C prints a traceback before ``start_process`` runs.
"""

import os
import sys
from collections import namedtuple
from collections.abc import Callable, Mapping, Sequence

import onebot_description
from onebot_description.errors import DescriptionError, OneBotError, UsageError, did_you_mean

TYPE_CHECKING = False  # typing's constant; typing is slow to import
if TYPE_CHECKING:
    from onebot_bringup.cli.options import Subcommand
    from onebot_bringup.launch.bringup import Bringup

USAGE = 2
# Exit codes with which shells report SIGINT and SIGPIPE.
INTERRUPTED = 128 + 2
PIPE_CLOSED = 128 + 13


# A line for ``onebot --help``, and the exit code after Ctrl-C, 0 if that is the normal end.
Verb = namedtuple("Verb", ["summary", "interrupted"], defaults=[INTERRUPTED])  # noqa: PYI024

# Each verb is a module of this package, imported only when it is used. It has either a table
# ``COMMANDS`` of ``Subcommand``, or ``run(argv) -> int``; ``argv`` are the words after the verb.
PACKAGE = "onebot_bringup.cli"
VERBS = {
    "check": Verb("check a URDF or xacro file and show its tree"),
    "view": Verb("bring up any robot from its file and move it", 0),
    "topic": Verb("list, print, measure and publish topics", 0),
    "node": Verb("list nodes and show what they do"),
    "param": Verb("list, describe, get, set, save and load parameters"),
    "service": Verb("list and call services"),
    "interface": Verb("list types of messages and show them"),
    "tf": Verb("show the tree of frames, and transforms between frames", 0),
    "snapshot": Verb("draw a robot into a picture file"),
    "run": Verb("run a node by its package and name", 0),
    "bag": Verb("record topics, play a recording, show what it holds", 0),
    "replay": Verb("show a recording", 0),
    "doctor": Verb("check what is wrong on this computer"),
    "completion": Verb("print the tab completion of a shell"),
    "steer": Verb("drive from a page in the browser", 0),
    "teleop": Verb("drive from the keyboard", 0),
    "trajectory": Verb("move joints to positions, and list those that can be moved"),
}
# Commands of ROS 1 and ros2 with other names, and our verbs for them.
_FORMER = {
    "rostopic": "topic",
    "rosnode": "node",
    "rosparam": "param",
    "rosservice": "service",
    **dict.fromkeys(("rosmsg", "rossrv", "msg", "srv"), "interface"),
    "rosbag": "bag",
    **dict.fromkeys(("roswtf", "wtf"), "doctor"),
    "rosrun": "run",
    **dict.fromkeys(("tf_echo", "tf2_echo"), "tf echo"),
    **dict.fromkeys(("tf_monitor", "tf2_monitor", "view_frames"), "tf tree"),
    "check_urdf": "check",
    **dict.fromkeys(("rviz", "rviz2", "urdf_launch"), "view"),
    **dict.fromkeys(("teleop_twist_keyboard", "rqt_robot_steering"), "teleop"),
    "rqt_joint_trajectory_controller": "trajectory",
}
_LAUNCH = ("launch", "roslaunch")
_VERSION = ("-V", "--version")


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
    body: Callable[[], int], see: str | Callable[[], str], interrupted: int = INTERRUPTED
) -> int:
    """Run ``body`` and return its exit code; print a user's mistake without a traceback.

    Args:
        body: the command.
        see: the help command to name in usage errors, or a function that returns it.
        interrupted: the exit code after Ctrl-C.
    """
    if "_ARGCOMPLETE" in os.environ:  # the shell asks for completions
        from onebot_bringup.cli.completion import complete

        complete()
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

    def launch() -> int:
        if any(word in _VERSION for word in words):
            return print_version(program)
        from onebot_bringup.launch.bringup import bring_up

        return bring_up(command(), words)

    return run_command(launch, see=f"{program} --help", interrupted=0)


def _print_problems(error: OneBotError) -> None:
    problems: Sequence[str] = str(error).splitlines()
    warnings: Sequence[str] = ()
    if isinstance(error, DescriptionError):
        problems, warnings = error.problems, error.warnings
    for line in (*map("error: {}".format, problems), *map("warning: {}".format, warnings)):
        print(line, file=sys.stderr)


def help_command(words: list[str]) -> str:
    """Return the command that prints the help of the command in ``words``."""
    if not words or words[0] not in VERBS:
        return "onebot --help"
    count = 2 if len(words) > 1 and words[1] in subcommands(words[0]) else 1
    return f"onebot {' '.join(words[:count])} --help"


def subcommands(verb: str) -> "Mapping[str, Subcommand]":
    """Return the subcommands of a verb; empty for most verbs."""
    from importlib import import_module

    return getattr(import_module(f"{PACKAGE}.{verb}"), "COMMANDS", {})


def run_verb(words: list[str]) -> int:
    """Run ``onebot`` with these words and return its exit code."""
    words = take_settings(words)
    if not words:
        print(usage(), file=sys.stderr)
        return 2
    first, *arguments = words
    if first == "help" and arguments:
        first, *arguments = [*arguments, "--help"]
    if first in ("-h", "--help", "help"):
        print(usage())
        return 0
    if first in _VERSION:
        return print_version("onebot")
    if first not in VERBS:
        raise UsageError(f'onebot has no command "{first}"{_instead(first, arguments)}')
    from importlib import import_module

    if table := subcommands(first):
        from onebot_bringup.cli.options import dispatch

        return dispatch(first, table, arguments)
    return int(import_module(f"{PACKAGE}.{first}").run(arguments))


def take_settings(words: list[str]) -> list[str]:
    """Apply ``discovery:=`` and ``domain_id:=`` before the verb; return the other words."""
    count = next((n for n, word in enumerate(words) if ":=" not in word), len(words))
    if count:
        from onebot_bringup.launch.arguments import complete, discovery_settings, split
        from onebot_description.ros.discovery import discovery_variables

        settings = split(words[:count]).given
        values = complete(discovery_settings(), settings)
        os.environ.update(discovery_variables(values, forced="discovery" in settings))
    return words[count:]


def print_version(program: str) -> int:
    """Print the installed version of a program; return the exit code."""
    print(program, onebot_description.__version__)
    return 0


def _instead(verb: str, rest: Sequence[str]) -> str:
    """Return what to write in place of a verb that does not exist."""
    if verb in _LAUNCH:
        return ": write onebot_bringup, mrm_bringup or onebot view FILE, and name:=value after it"
    if verb in _FORMER:
        import shlex

        return f": write onebot {shlex.join([*_FORMER[verb].split(), *rest])}"
    return did_you_mean(verb, VERBS, "commands")


def usage() -> str:
    """Return the text of ``onebot --help``."""
    from onebot_bringup.cli.options import commands_text

    text = commands_text("onebot", VERBS, "[discovery:=WHERE] [domain_id:=N] ")
    return f"{text}; onebot --version shows the version."


def main(argv: Sequence[str] | None = None) -> int:
    """Run ``onebot`` with ``argv`` (default: the command line's) and return the exit code."""
    words = list(sys.argv[1:] if argv is None else argv)
    verb = VERBS.get(words[0] if words else "")
    interrupted = verb.interrupted if verb else INTERRUPTED
    if argv is None:
        start_process(interrupted)
    return run_command(lambda: run_verb(words), lambda: help_command(words), interrupted)


if __name__ == "__main__":
    sys.exit(main())
