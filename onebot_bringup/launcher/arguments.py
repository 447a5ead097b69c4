"""``name:=value`` arguments, as roslaunch has them.

Given twice, the last one wins, so that a script can put ``"$@"`` behind its own defaults. What
follows ``--ros-args`` is kept apart, for every node.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from onebot_description.errors import UsageError as UsageError
from onebot_description.text import did_you_mean

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
