"""``name:=value`` arguments, as roslaunch has them.

Given twice, the last one wins, so that a script can put ``"$@"`` behind its own defaults. What
follows ``--ros-args`` is kept apart, for every node.
"""

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from onebot_description.errors import UsageError as UsageError
from onebot_description.errors import did_you_mean

_TRUE = ("true", "1")
_FALSE = ("false", "0")
_HELP = ("-h", "--help")
_SHOW = ("--show-args", "-s")


@dataclass(frozen=True)
class Argument:
    """One launch argument.

    Attributes:
        name: as written before ``:=``.
        default: as it would be written.
        description: one line; for ``choices`` these are added to it.
        choices: the only values allowed; none means any.
    """

    name: str
    default: str
    description: str
    choices: tuple[str, ...] = ()


def switch(name: str, default: bool, description: str) -> Argument:
    """Return an argument that is true or false."""
    return Argument(name, "true" if default else "false", description, (*_TRUE, *_FALSE))


@dataclass(frozen=True)
class Arguments:
    """A command line taken apart, before it is known which names are right.

    Attributes:
        given: name to value, of all ``name:=value``.
        positional: words of any other form.
        ros_args: what follows ``--ros-args``.
        help: ``--help`` was given.
        show: ``--show-args`` was given.
    """

    given: Mapping[str, str] = field(default_factory=dict)
    positional: tuple[str, ...] = ()
    ros_args: tuple[str, ...] = ()
    help: bool = False
    show: bool = False


def split(argv: Sequence[str]) -> Arguments:
    """Take a command line apart.

    Raises:
        UsageError: an option that does not exist, or no name before ``:=``.
    """
    words, ros_args = _split_ros_args(argv)
    given: dict[str, str] = {}
    positional: list[str] = []
    options: set[str] = set()
    for word in words:
        name, separator, value = word.partition(":=")
        if separator and not name.startswith("-"):
            if not name:
                raise UsageError(f'"{word}" has no name; write name:=value')
            given[name] = value
        elif word.startswith("-") and word != "-":
            options.add(_option(word))
        else:
            positional.append(word)
    return Arguments(
        given, tuple(positional), ros_args, "--help" in options, "--show-args" in options
    )


def _split_ros_args(argv: Sequence[str]) -> tuple[list[str], tuple[str, ...]]:
    """Cut ``--ros-args ... [--]`` out."""
    words = list(argv)
    if "--ros-args" not in words:
        return words, ()
    start = words.index("--ros-args")
    end = words.index("--", start) if "--" in words[start:] else len(words)
    return words[:start] + words[end + 1 :], tuple(words[start + 1 : end])


def _option(word: str) -> str:
    if word in _HELP:
        return "--help"
    if word in _SHOW:
        return "--show-args"
    bare = word.lstrip("-").partition(":=")[0].partition("=")[0]
    raise UsageError(
        f'no option "{word}" (options: --help, --show-args, --ros-args); '
        f"launch arguments are written {bare or 'name'}:=value"
    )


def refuse_positional(words: Sequence[str]) -> None:
    """Complain about words that are no ``name:=value``, where a command takes none.

    Raises:
        UsageError: there is one.
    """
    if words:
        name, equals, value = words[0].partition("=")
        meant = f"{name}:={value}" if equals else "name:=value"
        raise UsageError(f'unexpected "{words[0]}"; arguments are written {meant}')


def complete(declared: Iterable[Argument], given: Mapping[str, str]) -> dict[str, str]:
    """Return a value for each declared argument: the given one, or its default.

    Switches come out as ``true`` or ``false``, however they were written.

    Raises:
        UsageError: with all problems: unknown names, values that are not allowed.
    """
    arguments = {argument.name: argument for argument in declared}
    problems = [unknown(name, arguments) for name in given if name not in arguments]
    values = {}
    for name, argument in arguments.items():
        value = given.get(name, argument.default)
        if argument.choices == (*_TRUE, *_FALSE):
            value = _switch_value(value)
        if argument.choices and value not in argument.choices:
            problems.append(_not_allowed(argument, value))
        values[name] = value
    if problems:
        raise UsageError("\n".join(problems))
    return values


def unknown(name: str, known: Iterable[str], what: str = "arguments") -> str:
    """Return the complaint about an argument that does not exist."""
    return f'no argument "{name}"{did_you_mean(name, known, what)}'


def _switch_value(value: str) -> str:
    lower = value.lower()
    return "true" if lower in _TRUE else "false" if lower in _FALSE else value


def _not_allowed(argument: Argument, value: str) -> str:
    allowed = ", ".join(argument.choices)
    return f"{argument.name}:={value} is not possible; it can be one of: {allowed}"


def table(arguments: Sequence[Argument]) -> str:
    """Return the arguments as text: name, default, description, one a line."""
    rows = [(f"{a.name}:={a.default}", _explain(a)) for a in arguments]
    width = min(max((len(left) for left, _ in rows), default=0), 34)
    return "\n".join(_row(left, right, width) for left, right in rows)


def _explain(argument: Argument) -> str:
    if argument.choices and argument.choices != (*_TRUE, *_FALSE):
        return f"{argument.description} ({', '.join(argument.choices)})"
    return argument.description


def _row(left: str, right: str, width: int) -> str:
    if len(left) > width:
        return f"  {left}\n  {'':{width}}  {right}"
    return f"  {left:{width}}  {right}".rstrip()


# What launch arguments can be, beside their choices: numbers, ports, names of ROS.

_NAMESPACE = re.compile(r"/?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*/?")
_MAX_DOMAIN = 232  # beyond it the ports of DDS (RTPS 2.2, section 9.6.1.1) exceed 65535
_MAX_PORT = 65535


def check_number(name: str, text: str, least: float, most: float) -> float:
    """Return the number that an argument is.

    Args:
        name: of the argument.
        text: as it was written.
        least: the least that is possible.
        most: the most.

    Raises:
        UsageError: it is none, or beyond those.
    """
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not least <= number <= most:  # also refuses nan
        raise _impossible(name, text, f"a number from {least:g} to {most:g}")
    return number


def check_whole(name: str, text: str, least: int, most: int) -> int:
    """Return the whole number that an argument is, as ``check_number`` does."""
    # The nodes and ROS read it anew, and do not take all that Python takes, such as 1_000.
    if not (text.isascii() and text.isdecimal() and least <= int(text) <= most):
        raise _impossible(name, text, f"a whole number from {least} to {most}")
    return int(text)


def check_finite(name: str, text: str) -> float:
    """Return the number that an argument is, whatever its size.

    Raises:
        UsageError: it is none.
    """
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise _impossible(name, text, "a number such as 1.5")
    return number


def check_port(name: str, text: str) -> int:
    """Return the port that an argument is, 0 for any.

    Raises:
        UsageError: it is none.
    """
    return check_whole(name, text, 0, _MAX_PORT)


def check_domain(text: str) -> None:
    """Refuse a ``domain_id`` that ROS cannot have; empty is the environment's.

    Raises:
        UsageError: it is one.
    """
    if text:
        check_whole("domain_id", text, 0, _MAX_DOMAIN)


def check_namespace(namespace: str) -> None:
    """Refuse a ``namespace`` that ROS cannot have; the outer slashes may be left out.

    Raises:
        UsageError: it is one.
    """
    if namespace.strip("/") and not _NAMESPACE.fullmatch(namespace):
        raise UsageError(
            f"namespace:={namespace} is no ROS name; write words of letters, digits and _ that do"
            " not start with a digit, joined by /"
        )


def _impossible(name: str, text: str, possible: str) -> UsageError:
    return UsageError(f"{name}:={text} is not possible; write {possible}")


# The arguments of every command that brings up a robot's description.

_LEVELS = ("debug", "info", "warn", "error", "fatal")
_MAX_FREQUENCY = 1000  # Hz
_LOOPBACK = "127.0.0.1"
_OF_STEERING = ("host", "port", "token")


def description_arguments(model: str, joints: str, view: str) -> list[Argument]:
    """Return the arguments; those three are the robot's own defaults."""
    return [
        Argument("model", model, "the robot, a URDF or xacro file"),
        Argument("joints", joints, "parameters of joint_state_publisher, a YAML file"),
        switch("joint_states", True, "run joint_state_publisher; false: the robot has its own"),
        Argument("viewer", "web", "where to see it", ("web", "native", "none")),
        Argument("view", view, "what is shown and from where, .yaml or .rbl; empty: the robot's"),
        Argument("fixed_frame", "", "the frame that stands still; empty: the viewer chooses"),
        Argument("save", "", "record what the viewer gets to this .rrd file"),
        Argument("record", "", "record all topics to this new folder, a rosbag2 in MCAP"),
        switch("reload", True, "take up edits of the model while running"),
        Argument("namespace", "", "the namespace of all nodes"),
        Argument("frame_prefix", "", "prepended to every frame of the robot"),
        Argument("publish_frequency", "0.0", "the most often a transform is sent, Hz; 0: always"),
        switch("ignore_timestamp", False, "send transforms whatever the joint states' stamps say"),
        switch("use_sim_time", False, "take the time from /clock"),
        Argument("log_level", "info", "the least severe log messages shown", _LEVELS),
        Argument("domain_id", "", "ROS_DOMAIN_ID, 0 to 232; empty: the environment's"),
        Argument(
            "discovery",
            "localhost",
            "who sees the nodes; ROS_AUTOMATIC_DISCOVERY_RANGE goes before this default",
            ("localhost", "subnet"),
        ),
    ]


def simulation_arguments(control: str) -> list[Argument]:
    """Return the further arguments of a robot that can be simulated; ``control`` is its default."""
    return [
        switch("sim", True, "simulate it; false: joint_state_publisher moves its joints instead"),
        switch("steer", False, "a page to steer it from, beside its view"),
        Argument("host", _LOOPBACK, "where that page is served; 0.0.0.0: to other computers, too"),
        Argument("port", "8080", "of that page; 0: any"),
        Argument("token", "", "asked for in its address, if host is not this computer"),
        Argument("params_file", control, "parameters of the controller, a YAML file"),
        Argument("x", "0.0", "where it starts, metres in odom"),
        Argument("y", "0.0", "where it starts, metres in odom"),
        Argument("yaw", "0.0", "where it faces at the start, radians"),
        Argument("rate", "", "control steps a second, Hz; empty: as params_file says"),
    ]


def checked_values(declared: list[Argument], given: Mapping[str, str]) -> dict[str, str]:
    """Return a value for each argument.

    Raises:
        UsageError: a name or a value that is not possible.
    """
    values = complete(declared, given)
    check_number("publish_frequency", values["publish_frequency"], 0.0, _MAX_FREQUENCY)
    prefix = values["frame_prefix"]
    if values.get("sim") == "true" and prefix and not prefix.endswith("/"):
        raise UsageError(f"frame_prefix:={prefix} must end with /, as in frame_prefix:={prefix}/")
    for name in ("x", "y", "yaw"):
        check_finite(name, values.get(name, "0"))
    if "port" in values:
        check_port("port", values["port"])
    if values.get("steer") == "false":
        for name in _OF_STEERING:
            if name in given:
                raise UsageError(f"{name}:={given[name]} is the steering page's: add steer:=true")
    if values.get("rate"):
        check_whole("rate", values["rate"], 0, _MAX_FREQUENCY)
    check_domain(values["domain_id"])
    check_namespace(values["namespace"])
    return values
