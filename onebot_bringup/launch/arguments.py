"""Parses and checks ``name:=value`` arguments, like roslaunch's.

The arguments of a command are declared once, as the fields of a ``Settings`` dataclass, from which
come their values, ``--help``, ``--show-args``, completion and the arguments of ``ros2 launch``.

If an argument is given twice, the last one wins, so that a script can put ``"$@"`` after its own
defaults. The words after ``--ros-args`` are separate, for every node.
"""

import functools
import os
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn, TypeVar, cast

from onebot_description.elements.packages import PACKAGE_PATH, use_package_path
from onebot_description.errors import OneBotError, UsageError, did_you_mean, printable
from onebot_description.parameters.reader import NO_PARAMETER, leaves
from onebot_description.parameters.values import Rule, ValueType, plain
from onebot_description.ros.discovery import (
    ARGUMENT,
    LOCALHOST,
    MAX_DOMAIN,
    WANTED,
    discovery_variables,
)

if TYPE_CHECKING:
    from onebot_description.description.xacro import XacroArgument

# Arguments of other ROS launch files, with hints how to write them here.
_VIEWER = "write viewer:=web, viewer:=native or viewer:=none"
_SLIDERS = "joints:=FILE sets how joints move, without sliders; joint_states:=false: they do not"
_VIEW = "view:=FILE chooses what the viewer shows"
_FORMER = {
    "gui": f"{_VIEWER} for the view; {_SLIDERS}",
    **dict.fromkeys(("use_gui", "jsp_gui"), _SLIDERS),
    **dict.fromkeys(("rviz", "use_rviz", "launch_rviz", "headless"), _VIEWER),
    **dict.fromkeys(("rvizconfig", "rviz_config", "rviz_config_file"), _VIEW),
    "tf_prefix": "write frame_prefix:=PREFIX/",
}
_SWITCH = {"true": True, "false": False, "1": True, "0": False}
_DECLARED = "launch argument"  # the key in a field's metadata
_AS_DECLARED: Any = object()  # the default of a parameter's argument: the parameter's own
_OPTIONS = {"-h": "help", "--help": "help", "--show-args": "show", "-s": "show"}


@dataclass(frozen=True)
class Argument:
    """One launch argument."""

    name: str  # the word before :=
    default: str  # the text after :=; if it is empty, the user may leave the argument empty, too
    description: str  # one line
    type: ValueType = ValueType(str)  # the type of its value
    examples: tuple[str, ...] = ()  # other values, for tab completion
    nodes: tuple[str, ...] = ()  # the nodes whose parameter it sets
    parameter: str = ""  # the name of that parameter

    @property
    def choices(self) -> Sequence[str]:
        """The allowed values, as they are listed; empty if there are too many to list."""
        return ("true", "false") if self.type.base is bool else self.type.rule.choices

    @property
    def help(self) -> str:
        """The description with the range or the choices, except for true and false."""
        if self.choices and self.type.base is not bool:
            return f"{self.description} ({', '.join(self.choices)})"
        limits = self.type.rule.range if self.type.rule.at_most is not None else ""
        return f"{self.description}; {limits}" if limits else self.description

    @property
    def suggested(self) -> Sequence[str]:
        """The values that tab completion offers."""
        return self.choices or self.examples or ("",)

    def problem(self, text: str) -> str:
        """Return what is wrong with the value ``text``, and what would be right; "" if valid."""
        if not (text or self.default) or self.type.many or self.type.base is Path:
            return ""  # the node checks a list, and require_file a file
        try:
            self.type.checked(self.value(text))
        except ValueError:
            return f"{self.name}:={text} is not valid; write {self.type.wanted()}"
        return ""

    def value(self, text: str) -> Any:
        """Return ``text`` as a value of the argument's type, or unchanged if it is not one.

        An empty text is None, unless the argument is a string.
        """
        if not text:
            return "" if self.type.base is str and not self.type.many else None
        if self.type.many:
            return tuple(part.strip() for part in text.split(","))
        if self.type.base is bool:
            return _SWITCH.get(text.lower(), text)
        with suppress(ValueError):
            return self.type.base(text)
        return text


def argument(
    default: Any, description: str, *, examples: tuple[str, ...] = (), **rules: Any
) -> Any:
    """Return a field of ``Settings`` for an argument.

    Args:
        default: its value if it is not given; None is shown as empty.
        description: one line.
        examples: other values, for tab completion.
        **rules: fields of Rule.
    """
    kind = ValueType(str, Rule(**rules))  # the annotation has the type
    return field_of(Argument("", _text(default), description, kind, examples), default)


def parameter_of(
    nodes: tuple[str, ...],
    kind: type,
    parameter: str,
    *,
    default: Any = _AS_DECLARED,
    note: str = "",
    examples: tuple[str, ...] = (),
) -> Any:
    """Return a field for an argument that sets a parameter; it has its range and description.

    Args:
        nodes: the names of the nodes with the parameter.
        kind: the dataclass that declares the parameter.
        parameter: the name of the parameter.
        default: the default of the argument, if it differs.
        note: added to the description.
        examples: other values, for tab completion.
    """
    [leaf] = [leaf for leaf in leaves(kind) if leaf.name == parameter]
    joined = "joined by commas" if leaf.type.many else ""
    description = "; ".join(filter(None, (leaf.type.rule.description, joined, note)))
    value = leaf.default if default is _AS_DECLARED else default
    declared = Argument("", _text(value), description, leaf.type, examples)
    return field_of(replace(declared, nodes=nodes, parameter=parameter), value)


def field_of(declared: Argument, default: Any = "") -> Any:
    """Return a field for an argument; ``default`` is its default as a value."""
    return field(default=default, metadata={_DECLARED: declared})


def _text(value: object) -> str:
    return "" if value is None else str(value).lower() if isinstance(value, bool) else str(value)


S = TypeVar("S", bound="Settings")


@dataclass(frozen=True)
class Settings:
    """The checked values of a command's arguments, which are the fields of a subclass.

    The type of an argument is that of its annotation. Only fields made by ``argument``,
    ``parameter_of`` and ``field_of`` are arguments.
    """

    # Names of the arguments that were given; the others have their defaults.
    given: frozenset[str] = field(default=frozenset(), metadata=NO_PARAMETER)

    @classmethod
    def arguments(cls, **defaults: str) -> list[Argument]:
        """Return the arguments in order; ``defaults`` are texts by name, where they differ."""
        return [
            replace(declared, default=defaults.get(declared.name, declared.default))
            for declared in _declared(cast(Any, cls))
        ]

    @classmethod
    def read(cls: type[S], given: Mapping[str, str], **defaults: str) -> S:
        """Return checked values: those ``given``, else the defaults.

        Raises:
            UsageError: names or values are wrong; it has a line for each.
        """
        arguments = {argument.name: argument for argument in cls.arguments(**defaults)}
        texts = {name: given.get(name, argument.default) for name, argument in arguments.items()}
        problems = [unknown(name, arguments) for name in given if name not in arguments]
        problems += [argument.problem(texts[name]) for name, argument in arguments.items()]
        if any(problems):
            raise UsageError("\n".join(filter(None, problems)))
        values = {name: argument.value(texts[name]) for name, argument in arguments.items()}
        return cls(given=frozenset(given), **values)

    def parameters(self, node: str) -> dict[str, object]:
        """Return the values that are parameters of a node, except empty ones."""
        values = {
            argument.parameter: plain(getattr(self, argument.name))
            for argument in self.arguments()
            if node in argument.nodes
        }
        return {name: value for name, value in values.items() if value not in (None, "")}


@functools.cache
def _declared(kind: Any) -> tuple[Argument, ...]:
    types = {leaf.name: leaf.type for leaf in leaves(kind)}
    declared = {item.name: item.metadata.get(_DECLARED) for item in fields(kind)}
    return tuple(
        replace(argument, name=name, type=replace(types[name], rule=argument.type.rule))
        for name, argument in declared.items()
        if argument
    )


@dataclass(frozen=True)
class Arguments:
    """A command line split into its parts, before the names are checked."""

    given: Mapping[str, str]  # values of all name:=value, by name
    positional: tuple[str, ...]  # words of any other form
    ros_args: tuple[str, ...]  # the words after --ros-args
    help: bool  # --help was given
    show: bool  # --show-args was given


def split(argv: Sequence[str]) -> Arguments:
    """Split a command line into its parts."""
    words, ros_args = split_ros_args(argv)
    assignments: dict[str, str] = {}
    positional: list[str] = []
    options: set[str] = set()
    for word in words:
        name, separator, value = word.partition(":=")
        if separator and not name.startswith("-"):
            assignments[name] = os.path.expanduser(value)  # shells do not expand ``name:=~/x``
        elif word.startswith("-") and word != "-":
            options.add(_OPTIONS.get(word) or _refuse_option(word))
        else:
            positional.append(word)
    return Arguments(assignments, tuple(positional), ros_args, "help" in options, "show" in options)


def split_ros_args(argv: Sequence[str]) -> tuple[list[str], tuple[str, ...]]:
    """Split off ``--ros-args ... [--]``; return the other words, and those within."""
    words = list(argv)
    if "--ros-args" not in words:
        return words, ()
    start = words.index("--ros-args")
    end = words.index("--", start) if "--" in words[start:] else len(words)
    return words[:start] + words[end + 1 :], tuple(words[start + 1 : end])


def _refuse_option(word: str) -> NoReturn:
    bare = word.lstrip("-").partition(":=")[0].partition("=")[0]
    raise UsageError(
        f'no option "{word}" (options: --help, --show-args, --ros-args); '
        f"launch arguments are written {bare or 'name'}:=value"
    )


def refuse_positional(words: Sequence[str]) -> None:
    """Reject words other than ``name:=value``, for a command that takes none."""
    if words:
        name, equals, value = words[0].partition("=")
        meant = f"{name}:={value}" if equals else "name:=value"
        raise UsageError(f'unexpected "{words[0]}"; arguments are written {meant}')


def with_positional(arguments: Arguments, name: str, what: str, program: str) -> dict[str, str]:
    """Return the given arguments, with the one word without ``:=`` as the argument ``name``.

    Args:
        arguments: the command line.
        name: the argument that the word stands for.
        what: what the word is, such as "file", for errors.
        program: the program, for errors.

    Raises:
        UsageError: there are several words, or both a word and the argument.
    """
    refuse_positional(arguments.positional[1:])
    if arguments.positional and name in arguments.given:
        raise UsageError(f"write the {what} or {name}:=, not both, for {program}")
    return {**dict(zip([name], arguments.positional, strict=False)), **arguments.given}


def require_file(name: str, path: Path, instead: str = "") -> None:
    """Raise a OneBotError if the file that an argument names does not exist.

    Args:
        name: the argument.
        path: the file.
        instead: what to write, for the message.
    """
    if not path.is_file():
        raise OneBotError(f"{name}:={path}: no such file{instead}")


def unknown(name: str, names: Iterable[str]) -> str:
    """Return the message about an argument that does not exist."""
    if name in _FORMER:
        return f'no argument "{name}": {_FORMER[name]}'
    return f'no argument "{name}"{did_you_mean(name, names, "arguments")}'


listed: list[Argument] = []  # printed by this process, for tab completion


def table(arguments: Sequence[Argument]) -> str:
    """Return the arguments as a table of names, defaults and descriptions."""
    listed.extend(arguments)
    rows = [(printable(f"{a.name}:={a.default}"), printable(a.help)) for a in arguments]
    width = min(max((len(left) for left, _ in rows), default=0), 34)
    return "\n".join(f"  {left:{width}}  {right}".rstrip() for left, right in rows)


# Arguments of several commands ------------------------------------------------------------------

OF_MODEL = "model."  # prefix of a model's argument if the command has one of the same name
PACKAGES = Argument(PACKAGE_PATH, "", "folders with ROS packages, joined by :, searched first")

_WORDS = "words of letters, digits and _ that do not start with a digit, joined by /"
_NAMESPACE = Rule(
    pattern=re.compile(r"/?|/?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*/?"),
    write=f"a ROS name: {_WORDS}",
)
NAMESPACE = Argument("namespace", "", "the namespace of all nodes", ValueType(str, _NAMESPACE))


@dataclass(frozen=True)
class DiscoverySettings(Settings):
    """Which nodes are discovered."""

    domain_id: int | None = argument(
        None, "ROS_DOMAIN_ID; empty: the environment's", at_least=0, at_most=MAX_DOMAIN
    )
    discovery: str = argument(
        LOCALHOST,
        "which nodes are discovered: localhost, subnet, or HOST:PORT of a discovery server; "
        "not given: the environment's",
        pattern=ARGUMENT,
        write=WANTED,
        examples=(LOCALHOST, "subnet"),
    )

    def variables(self) -> dict[str, str]:
        """Return the environment variables of nodes."""
        return discovery_variables(self.discovery, self.domain_id, forced="discovery" in self.given)


def take_package_path(given: Mapping[str, str]) -> dict[str, str]:
    """Add ``package_path:=`` to the package search path; return the model's arguments."""
    use_package_path(given.get(PACKAGE_PATH, ""))
    return model_values(given, {PACKAGE_PATH})


def model_values(given: Mapping[str, str], own_names: Collection[str]) -> dict[str, str]:
    """Return the model's xacro arguments: ``model.NAME``, and NAME if the command has none."""
    return {
        name.removeprefix(OF_MODEL): value for name, value in given.items() if name not in own_names
    }


def model_arguments(
    declared: Iterable["XacroArgument"], own_names: Collection[str]
) -> list[Argument]:
    """Return the xacro arguments of the model as they are written on the command line."""
    return [
        Argument(f"{OF_MODEL}{name}" if name in own_names else name, default, description)
        for name, default, description in declared
    ]
