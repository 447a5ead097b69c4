"""Defines parameters as checked dataclasses: each field has its default, description and rules.

A field made by ``parameter`` is one ROS parameter, or one key of a YAML file. A field that is a
dataclass is a group (``camera.eye``); a field of type ``Mapping[str, X]`` is a map with names that
the user chooses (``motions.elbow.position`` if X is a dataclass, or ``zeros.elbow``)::

    @dataclass(frozen=True)
    class PlotParameters:
        rate: float = parameter(10.0, "samples per second, Hz", above=0.0, at_most=100.0)
        joints: tuple[str, ...] = parameter((), "the joints shown; empty: all")

        def check(self) -> Iterable[Problem]: ...  # conditions on several parameters

    settings = read(PlotParameters, declare(node, PlotParameters))

``read`` checks values from any file or node; ``declare`` gives a node's parameters the same
descriptions, ranges and read-only flags.
"""

import dataclasses
import functools
import types
import typing
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import MISSING, dataclass
from typing import Any, NamedTuple, TypeVar

from onebot_description.errors import OneBotError, did_you_mean
from onebot_description.parameters.values import Rule, ValueType, shown, yaml_text

T = TypeVar("T")
Values = Mapping[str, Any]

REQUIRED = MISSING
"""The default of a parameter that must be given."""

_RULE = "onebot parameter"  # the key in a field's metadata
NO_PARAMETER: Mapping[str, Any] = {_RULE: None}
"""Metadata of a dataclass field that is not a parameter."""
OTHERS = "*"
"""The name of a map whose entries are beside the other fields of its group, as in constraints.

Such an entry is a dataclass: ``constraints.goal_time`` is a field, ``constraints.elbow.goal`` not.
"""
_MAX_LISTED = 50  # problems in one message
# Parameters that rclpy declares on every node.
_OF_EVERY_NODE = ("use_sim_time", "start_type_description_service")
_OF_EVERY_NODE_PREFIXES = ("qos_overrides.", "overrides.")


# Problems -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Problem:
    """A wrong or surprising value."""

    # Dotted name of the parameter or of its group, such as motions.elbow.frequency; empty when no
    # parameter is the cause.
    key: str
    text: str  # the fault, and what to write

    def message(self, places: Mapping[str, str] | None = None) -> str:
        """Return ``place: key: text``; ``places`` are file and line of each parameter.

        The place of a group is that of its first parameter.
        """
        inside = (place for key, place in (places or {}).items() if _is_in(key, self.key))
        place = (places or {}).get(self.key) or next(inside, "")
        return ": ".join(part for part in (place, self.key, self.text) if part)


def _is_in(name: str, group: str) -> bool:
    return bool(group) and name.startswith(f"{group}.")


class ConfigError(OneBotError):
    """Parameters that cannot be used; ``problems`` are all that were found."""

    def __init__(
        self, problems: Iterable[Problem], places: Mapping[str, str] | None = None
    ) -> None:
        self.problems = tuple(problems)
        lines = [problem.message(places) for problem in self.problems[:_MAX_LISTED]]
        surplus = len(self.problems) - len(lines)
        super().__init__("\n".join([*lines, *([f"and {surplus} more"] if surplus else [])]))

    def located(self, places: Mapping[str, str]) -> "ConfigError":
        """Return the same error, with file and line of each parameter in its message."""
        return ConfigError(self.problems, places)


# Fields of the dataclasses --------------------------------------------------------------------


def parameter(default: Any, description: str, **rules: Any) -> Any:
    """Return a dataclass field for one parameter. Its type is the field's annotation.

    A type may be float (integers are accepted), int, bool, str, a tuple of these (``tuple[str,
    ...]``, or ``tuple[float, float, float]`` for exactly three), ``X | None``, where None and an
    empty list are both "not given", or a mapping from names to one of these or to a dataclass.
    The default of a parameter that must be given is REQUIRED; ``rules`` are fields of Rule.
    """
    metadata = {_RULE: Rule(description, **rules)}
    if isinstance(default, dict):
        return dataclasses.field(default_factory=lambda: dict(default), metadata=metadata)
    return dataclasses.field(default=default, metadata=metadata)


def ignored(default: Any, reason: str, **rules: Any) -> Any:
    """Return a field for a parameter without effect, accepted so that existing files work."""
    return parameter(default, f"accepted, without effect: {reason}", **rules)


class OwnClass:
    """Placeholder for X of ``Mapping[str, X]``: values are of the enclosing dataclass."""


def group(kind: type[T], name: str = "") -> T:
    """Return a dataclass field for a group of parameters, whose default is ``kind()``.

    ``name`` is its name in ROS or YAML, if it differs from the field's; it may contain dots.
    """
    return dataclasses.field(default_factory=kind, metadata={_RULE: Rule(name=name)})


# The structure of a dataclass -----------------------------------------------------------------


class _Field(NamedTuple):
    """One field of a dataclass."""

    field: str  # its name in the dataclass
    name: str  # its name in ROS or YAML; empty for OTHERS
    shape: "_Shape"
    default: Any  # REQUIRED if there is none


class _Group(NamedTuple):
    """A dataclass."""

    kind: Any
    fields: tuple[_Field, ...]

    @property
    def names(self) -> list[str]:
        """The names of its fields, except OTHERS."""
        return [field.name for field in self.fields if field.name]


class _Map(NamedTuple):
    """A map with names that the user chooses."""

    item: "_Shape"
    key: str  # a word for its names, such as joint; empty: no parameters of a node


_Shape = ValueType | _Group | _Map


@functools.cache
def _group(kind: Any) -> _Group:
    hints = typing.get_type_hints(kind)
    fields, maps = [], []
    for item in dataclasses.fields(kind):
        if (rule := item.metadata.get(_RULE, Rule())) is None:
            continue
        default = item.default if item.default_factory is MISSING else item.default_factory()
        if hints[item.name] == Mapping[str, OwnClass]:
            maps.append((item.name, default))
            continue
        shape = _shape(hints[item.name], rule)
        name = "" if rule.name == OTHERS else rule.name or item.name
        fields.append(_Field(item.name, name, shape, default))
    same = _Map(_Group(kind, tuple(fields)), "")
    fields += [_Field(name, name, same, default) for name, default in maps]
    return _Group(kind, tuple(fields))


def _shape(hint: Any, rule: Rule) -> _Shape:
    origin, args = typing.get_origin(hint), typing.get_args(hint)
    if dataclasses.is_dataclass(hint):
        return _group(typing.cast(Any, hint))
    if origin in (typing.Union, types.UnionType):  # one with None
        return dataclasses.replace(typing.cast(ValueType, _shape(args[0], rule)), optional=True)
    if origin is tuple:
        return ValueType(args[0], rule, True, None if args[-1] is Ellipsis else len(args))
    if origin is None:
        return ValueType(hint, rule)
    key, *keys = (*rule.keys, "")
    return _Map(_shape(args[1], dataclasses.replace(rule, keys=tuple(keys))), key)


class Leaf(NamedTuple):
    """A parameter, or all parameters whose names differ only in words that the user chooses."""

    name: str  # <joint>, for example, marks a name that the user chooses
    type: ValueType
    default: Any

    @property
    def default_text(self) -> str:
        """The default as YAML; "required" if there is none."""
        if self.default is REQUIRED:
            return "required"
        return yaml_text(ros_value(self.type, self.default))


def leaves(kind: Any) -> list[Leaf]:
    """Return the parameters of the dataclass ``kind``, its groups and maps included.

    A map counts if its ``keys`` say what its names are.
    """
    return [*_walk(_group(kind), "")]


def _walk(shape: "_Shape", name: str, default: Any = None) -> Iterator[Leaf]:
    if isinstance(shape, ValueType):
        yield Leaf(name, shape, default)
    elif isinstance(shape, _Group):
        for field in shape.fields:
            yield from _walk(field.shape, _join(name, field.name), field.default)
    elif shape.key:
        yield from _walk(shape.item, f"{name}.<{shape.key}>")


def ros_value(leaf: ValueType, value: Any) -> Any:
    """Return a field's value as that of a ROS parameter, with lists for tuples."""
    if value is REQUIRED or value is None:
        return [] if leaf.many else None
    return list(value) if leaf.many else value


# Names ----------------------------------------------------------------------------------------


def _locate(kind: type, name: str) -> tuple[_Shape, str]:
    """Return the innermost shape that ``name`` leads to, and the rest of ``name``."""
    shape: _Shape = _group(kind)
    while name and (step := _step(shape, name)):
        _, shape, name = step
    return shape, name


def _step(shape: _Shape, name: str) -> tuple[str, _Shape, str] | None:
    """Return the part of ``shape`` that ``name`` begins with, its shape, and what follows."""
    if isinstance(shape, _Map):
        first, subname = _split(shape.item, name)
        return first, shape.item, subname
    for field in shape.fields if isinstance(shape, _Group) else ():
        if f"{name}.".startswith(f"{field.name}."):
            return field.name, field.shape, name[len(field.name) + 1 :]
        if not field.name and "." in name:
            return _step(field.shape, name)
    return None


def _split(item: _Shape, name: str) -> tuple[str, str]:
    """Split a name that the user chose, which may contain dots, from the rest."""
    if isinstance(item, ValueType):
        return name, ""
    if isinstance(item, _Map):
        first, _, subname = name.partition(".")
        return first, subname
    ends = [field.name for field in item.fields if name.endswith(f".{field.name}")]
    end = max(ends, key=len, default=name.rpartition(".")[2])
    return (name.removesuffix(f".{end}"), end) if "." in name else (name, "")


def is_parameter(kind: type, name: str) -> bool:
    """Whether the dataclass ``kind`` has a parameter, group or map of this name."""
    return bool(name) and not _locate(kind, name)[1]


def value_type(kind: type, name: str) -> ValueType | None:
    """Return the type of the parameter ``name``; None if it is not a single parameter."""
    shape, unknown = _locate(kind, name)
    return shape if isinstance(shape, ValueType) and not unknown else None


def unknown_parameters(kind: type, names: Iterable[str]) -> list[Problem]:
    """Return a problem for each of ``names`` that is not a parameter of the dataclass ``kind``.

    Parameters that every node has are accepted.
    """
    problems: list[Problem] = []
    for name in names:
        shape, unknown = _locate(kind, name)
        if unknown and not is_of_every_node(name):
            problems.append(Problem(name, _no_such(shape, unknown, len(problems))))
    return problems


def _no_such(shape: _Shape, name: str, number: int = 0) -> str:
    """Return the message about a ``name`` that ``shape`` lacks; it is problem ``number``."""
    if not isinstance(shape, _Group):
        return "is one value, not a map"
    # Finding similar names takes time, and only the first problems are listed.
    return f"no such parameter{did_you_mean(name, shape.names) if number < _MAX_LISTED else ''}"


def is_of_every_node(name: str) -> bool:
    """Whether rclpy declares the parameter ``name`` on every node."""
    return name in _OF_EVERY_NODE or name.startswith(_OF_EVERY_NODE_PREFIXES)


# Values of a dataclass ------------------------------------------------------------------------


def defaults(kind: type) -> dict[str, Any]:
    """Return every parameter of the dataclass ``kind`` whose name is fixed, with its default.

    Values are as in ROS: lists for tuples, and an empty list for a list that is not given.
    """
    fixed = (leaf for leaf in leaves(kind) if "<" not in leaf.name)
    return {leaf.name: ros_value(leaf.type, leaf.default) for leaf in fixed}


def values_of(config: Any) -> dict[str, Any]:
    """Return the same as ``defaults``, but with the values of ``config``, a dataclass."""
    changed, usual = dict(_flat(as_map(config))), defaults(type(config))
    return {name: changed.get(name, value) for name, value in usual.items()}


def as_map(config: Any) -> dict[str, Any]:
    """Return ``config``, a dataclass, as nested maps for ``read``, without default values."""
    changes: dict[str, Any] = {}
    kind: Any = type(config)
    for field in _group(kind).fields:
        value = getattr(config, field.field)
        if value == field.default:
            continue
        if isinstance(field.shape, ValueType):
            changes[field.name] = ros_value(field.shape, value)
        elif isinstance(field.shape, _Map):
            items = {name: as_map(item) for name, item in value.items()}
            changes |= {field.name: items} if field.name else items
        else:
            changes[field.name] = as_map(value)
    return changes


def replaced(config: T, name: str, value: Any) -> T:
    """Return ``config``, a dataclass, with another value of the parameter ``name``."""
    return read(type(config), {**dict(_flat(as_map(config))), name: value})


# Reading --------------------------------------------------------------------------------------


def read(kind: type[T], values: Values, places: Mapping[str, str] | None = None) -> T:
    """Return ``values`` as the dataclass ``kind``.

    Args:
        kind: a dataclass of parameters.
        values: values by dotted names, or in nested maps as in YAML; missing values have their
            defaults.
        places: file and line of each, such as ``joints.yaml:7``, for the error.

    Raises:
        ConfigError: values are wrong; it names each of them, and what to write.
    """
    node_values = {name: value for name, value in _flat(values) if not is_of_every_node(name)}
    problems: list[Problem] = []
    config = _build(_group(typing.cast(Any, kind)), node_values, "", problems)
    if problems:
        raise ConfigError(problems, places)
    return typing.cast(T, config)


def _flat(values: Values, prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield values by dotted names; an empty map is a value."""
    for key, value in values.items():
        if isinstance(value, Mapping) and value:
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def _build(shape: _Shape, given: Values, key: str, problems: list[Problem]) -> Any:
    """Return the checked value of ``key``, a dotted name; REQUIRED if it is wrong.

    ``given`` has values by the rest of their names, "" for the value of ``key`` itself; problems
    are added to ``problems``.
    """
    earlier = len(problems)
    parts: dict[str, dict[str, Any]] = {}
    shapes: dict[str, _Shape] = {}
    for name, value in given.items():
        if name and (step := _step(shape, name)):
            first, shapes[first], subname = step
            parts.setdefault(first, {})[subname] = value
        elif name:
            problems.append(Problem(_join(key, name), _no_such(shape, name, len(problems))))
        elif isinstance(shape, ValueType):
            try:
                return shape.checked(value)
            except ValueError as error:
                problems.append(Problem(key, str(error)))
                return REQUIRED
        elif value != {}:
            hint = f" with {', '.join(shape.names)}" if isinstance(shape, _Group) else ""
            problems.append(Problem(key, f"{shown(value)}; write a map{hint}"))
            return REQUIRED
    if key and any(given) and not parts:  # only unknown names, which count as not given
        return REQUIRED
    built = {n: _build(shapes[n], part, _join(key, n), problems) for n, part in parts.items()}
    built = {name: value for name, value in built.items() if value is not REQUIRED}
    if not isinstance(shape, _Group):
        return built
    config = _make(shape, parts, built, key, problems)
    # Wrong values now have their defaults, so conditions on several values are not checked.
    if hasattr(config, "check") and len(problems) == earlier:
        problems += [Problem(_join(key, problem.key), problem.text) for problem in config.check()]
    return config


def _make(shape: _Group, given: Values, values: Values, key: str, problems: list[Problem]) -> Any:
    """Return the dataclass of checked ``values``; REQUIRED if one is missing."""
    required = [field for field in shape.fields if field.default is REQUIRED]
    problems += [_missing(field, key) for field in required if field.name not in given]
    if any(field.name not in values for field in required):
        return REQUIRED
    named = {field.field: values[field.name] for field in shape.fields if field.name in values}
    others = {name: value for name, value in values.items() if name not in shape.names}
    named |= {field.field: others for field in shape.fields if others and not field.name}
    return shape.kind(**named)


def _missing(field: _Field, key: str) -> Problem:
    rule = field.shape.rule if isinstance(field.shape, ValueType) else Rule()
    choices = f"one of {', '.join(rule.choices)}" if rule.choices else ""
    what = "".join(f", {text}" for text in (rule.description, choices) if text)
    if key:  # the key of the group, because a missing value has no line
        return Problem(key, f"has no {field.name}{what}")
    return Problem(field.name, f"is missing{what}")


def _join(prefix: str, name: str) -> str:
    return ".".join(part for part in (prefix, name) if part)


# Parameters as a table, for a node's --help and its README -------------------------------------


class Row(NamedTuple):
    """Parameters that differ in their names only."""

    names: list[str]
    type: str
    default: str
    meaning: str


def rows(*kinds: type) -> list[Row]:
    """Return a row for each parameter of dataclasses; equal ones share a row.

    If some can be changed while the node runs, "start:" marks those that cannot.
    """
    parameters = [leaf for kind in kinds for leaf in leaves(kind)]
    some_change = not all(leaf.type.rule.read_only for leaf in parameters)
    table: dict[tuple[str, str, str], Row] = {}
    for leaf in parameters:
        start = "start: " if leaf.type.rule.read_only and some_change else ""
        cells = leaf.type.name, leaf.default_text, start + leaf.type.meaning
        table.setdefault(cells, Row([], *cells)).names.append(leaf.name)
    return list(table.values())


def help_text(*kinds: type) -> str:
    """Return the parameters for ``--help``."""
    lines = ["Parameters:"]
    for row in rows(*kinds):
        default = f", default {row.default}" if row.default else ""
        lines.append(f"    {', '.join(row.names)} ({row.type}{default}): {row.meaning}")
    return "\n".join(lines)
