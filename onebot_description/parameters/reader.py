"""Parameters as checked dataclasses: what each may be is written once, beside its default.

A field made by ``parameter`` is one ROS parameter or one key of a YAML file. A field that is itself
a dataclass is a group (``camera.eye``), one of type ``Mapping[str, X]`` a group with names of the
user's own (``motions.elbow.position``, where X is a dataclass, or ``zeros.elbow``)::

    @dataclass(frozen=True)
    class PlotParameters:
        rate: float = parameter(10.0, "samples a second, Hz", above=0.0, at_most=100.0)
        joints: tuple[str, ...] = parameter((), "the joints shown; empty: all")

        def check(self) -> Iterable[Problem]: ...  # what must hold between several parameters

    settings = read(PlotParameters, declare(node, PlotParameters))

``read`` checks values, whichever file or node they are from; ``declare`` gives a node's parameters
the same descriptions, ranges and read-only flags. A class may have ``REMEDIES``, names that are no
longer parameters and what to write now.
"""

import contextlib
import dataclasses
import functools
import re
import sys
import types
import typing
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import MISSING, dataclass
from typing import TYPE_CHECKING, Any, TypeVar

from onebot_description.errors import OneBotError, did_you_mean
from onebot_description.parameters.values import Rule, ValueType, plain, shown

if TYPE_CHECKING:
    from rcl_interfaces.msg import ParameterDescriptor
    from rclpy.node import Node
    from rclpy.parameter import Parameter

T = TypeVar("T")
Values = Mapping[str, Any]

REQUIRED = MISSING
"""The default of a parameter that must be given."""

_RULE = "onebot parameter"  # of a field's metadata
_MOST_LISTED = 50  # problems in one message
_MOST_FOUND = 1000  # problems, then the rest is not read
# Parameters that rclpy declares on every node.
_OF_EVERY_NODE = ("use_sim_time", "start_type_description_service")
_OF_EVERY_NODE_PREFIXES = ("qos_overrides.", "overrides.")


# Problems -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Problem:
    """One thing that is wrong or surprising."""

    # Dotted name of the parameter or of its group, such as motions.elbow.frequency; empty when no
    # parameter is the cause.
    key: str
    text: str  # what is wrong and what would be right

    def message(self, places: Mapping[str, str] | None = None) -> str:
        """Return ``place: key: text``.

        Args:
            places: where each parameter was written, such as ``joints.yaml:7``.
        """
        parts = (self._place(places or {}), self.key, self.text)
        return ": ".join(part for part in parts if part)

    def _place(self, places: Mapping[str, str]) -> str:
        """The place of the parameter itself, else of the first one inside the group it names."""
        if self.key in places:
            return places[self.key]
        if not self.key:
            return ""
        inside = self.key + "."
        return next((place for key, place in places.items() if key.startswith(inside)), "")

    def overlaps(self, other: "Problem") -> bool:
        """Whether one of the two is about the same parameter as the other, or about its group."""
        one, two = f"{self.key}.", f"{other.key}."
        return one.startswith(two) or two.startswith(one)


class ConfigError(OneBotError):
    """Parameters that cannot be used; ``problems`` are all that were found."""

    def __init__(
        self, problems: Iterable[Problem], places: Mapping[str, str] | None = None
    ) -> None:
        """Join ``problems`` into one message, a line each; ``places`` as in Problem.message."""
        self.problems = tuple(problems)
        lines = [problem.message(places) for problem in self.problems[:_MOST_LISTED]]
        rest = len(self.problems) - len(lines)
        super().__init__("\n".join([*lines, *([f"and {rest} more"] if rest else [])]))

    def located(self, places: Mapping[str, str]) -> "ConfigError":
        """Return the same error, its message naming where each parameter was written."""
        return ConfigError(self.problems, places)


# Fields of the dataclasses --------------------------------------------------------------------


def parameter(
    default: Any,
    description: str,
    *,
    name: str = "",
    above: float | None = None,
    at_least: float | None = None,
    at_most: float | None = None,
    choices: Sequence[str] = (),
    not_empty: bool = False,
    unique: bool = False,
    pattern: re.Pattern[str] | None = None,
    write: str = "",
    nan: str = "",
    read_only: bool = False,
) -> Any:
    """Return a dataclass field for one parameter. Its type is the field's annotation.

    A type may be float (an integer is one, too), int, bool, str, a tuple of these (``tuple[str,
    ...]``, or ``tuple[float, float, float]`` for exactly three), ``X | None``, where None and an
    empty list are both "not given", or a mapping from names to one of these or to a dataclass.
    Rules on numbers and strings apply to each in a list or mapping.

    Args:
        default: the value when it is not given; REQUIRED if it must be.
        description: one line, with the unit.
        name: in ROS or YAML, if it is not the field's; may hold dots.
        above: numbers must be greater.
        at_least: numbers must be as great.
        at_most: numbers must not be greater.
        choices: the only strings allowed.
        not_empty: neither a string nor a list may be empty.
        unique: a list must not hold anything twice.
        pattern: what a string must match.
        write: what would be right, for errors, such as ``a topic, such as /odom``.
        nan: what NaN means, such as ``no limit``; empty if the number must be finite.
        read_only: it is read once, when the node starts.
    """
    rule = Rule(
        description, name, above, at_least, at_most, tuple(choices), not_empty, unique, pattern,
        write, nan, read_only,
    )  # fmt: skip
    metadata = {_RULE: rule}
    if isinstance(default, dict):
        return dataclasses.field(default_factory=lambda: dict(default), metadata=metadata)
    return dataclasses.field(default=default, metadata=metadata)


def group(kind: type[T], name: str = "") -> T:
    """Return a dataclass field for a group of parameters, the dataclass ``kind`` by default.

    Args:
        kind: the dataclass.
        name: in ROS or YAML, if it is not the field's; may hold dots.
    """
    return dataclasses.field(default_factory=kind, metadata={_RULE: Rule(name=name)})


# The schema of a dataclass: values, groups of them, and maps with user-chosen keys ------------


@dataclass(frozen=True)
class _Field:
    """One field of a group."""

    field: str  # its name in the dataclass
    name: str  # in ROS or YAML
    shape: "_Shape"
    default: Any  # REQUIRED if there is none


@dataclass(frozen=True)
class _Group:
    """A dataclass."""

    kind: type
    fields: tuple[_Field, ...]

    @property
    def names(self) -> list[str]:
        """Parameter names of this group; a nested group or map counts as one."""
        return [field.name for field in self.fields]


@dataclass(frozen=True)
class _UserKeyed:
    """A map with user-chosen keys."""

    item: "_Shape"


_Shape = ValueType | _Group | _UserKeyed


def _group(kind: Any) -> _Group:
    """What a dataclass asks for."""
    return _cached_group(kind)


@functools.cache
def _cached_group(kind: Any) -> _Group:
    hints = typing.get_type_hints(kind)
    fields = []
    for one in dataclasses.fields(kind):
        rule = one.metadata.get(_RULE, Rule())
        default = one.default
        if one.default_factory is not MISSING:
            default = one.default_factory()
        shape = _shape(hints[one.name], rule)
        fields.append(_Field(one.name, rule.name or one.name, shape, default))
    return _Group(kind, tuple(fields))


def _shape(hint: Any, rule: Rule) -> _Shape:
    origin, args = typing.get_origin(hint), typing.get_args(hint)
    if dataclasses.is_dataclass(hint):
        return _group(typing.cast(type, hint))
    if origin in (typing.Union, types.UnionType):
        (inner,) = (arg for arg in args if arg is not type(None))
        leaf = _shape(inner, rule)
        assert isinstance(leaf, ValueType)
        return dataclasses.replace(leaf, optional=True)
    if origin is not None and issubclass(origin, Mapping):
        return _UserKeyed(_shape(args[1], rule))
    if origin is tuple:
        return ValueType(args[0], rule, True, None if args[-1] is Ellipsis else len(args))
    return ValueType(hint, rule)


# Names ----------------------------------------------------------------------------------------


class _Unknown(Exception):
    """A name that is no parameter; its text is what would be right, which takes time to find."""

    def __init__(self, text: str, name: str = "", known: Sequence[str] = ()) -> None:
        super().__init__(text)
        self._name, self._known = name, known

    def __str__(self) -> str:
        return super().__str__() + (did_you_mean(self._name, self._known) if self._known else "")


def _locate(shape: _Shape, name: str) -> tuple[tuple[str, ...], _Shape]:
    """Find the parameter or group called ``name``: the fields and items to it, and its shape."""
    if not name:
        return (), shape
    if isinstance(shape, _Group):
        return _locate_field(shape, name)
    if isinstance(shape, _UserKeyed):
        item, rest = _split(shape.item, name)
        path, found = _locate(shape.item, rest)
        return (item, *path), found
    raise _Unknown("is one value, not a map")


def _locate_field(shape: _Group, name: str) -> tuple[tuple[str, ...], _Shape]:
    for field in shape.fields:
        if name == field.name or name.startswith(f"{field.name}."):
            path, found = _locate(field.shape, name[len(field.name) + 1 :])
            return (field.field, *path), found
    remedies: Mapping[str, str] = getattr(shape.kind, "REMEDIES", {})
    if name in remedies:
        raise _Unknown(f"no longer a parameter; {remedies[name]}")
    raise _Unknown("no such parameter", name, shape.names)


def _split(item: _Shape, name: str) -> tuple[str, str]:
    """Split off a name of the user's own, which may hold dots, from what is inside."""
    if isinstance(item, ValueType):
        return name, ""
    if isinstance(item, _UserKeyed):
        first, _, rest = name.partition(".")
        return first, rest
    ends = [known for known in item.names if name.endswith(f".{known}")]
    if ends:
        end = max(ends, key=len)
        return name[: -len(end) - 1], end
    first, dot, last = name.rpartition(".")
    return (first, last) if dot else (name, "")


def unknown_parameters(kind: type, names: Iterable[str]) -> list[Problem]:
    """Return a problem for each of ``names`` that is no parameter of the dataclass ``kind``.

    Those that every node has are none.
    """
    problems: list[Problem] = []
    for name in names:
        if is_of_every_node(name):
            continue
        try:
            _locate(_group(kind), name)
        except _Unknown as error:
            text = str(error) if len(problems) < _MOST_LISTED else "no such parameter"
            problems.append(Problem(name, text))
    return problems


def is_of_every_node(name: str) -> bool:
    """Whether rclpy declares the parameter ``name`` on every node."""
    return name in _OF_EVERY_NODE or name.startswith(_OF_EVERY_NODE_PREFIXES)


def defaults(kind: type) -> dict[str, Any]:
    """Return every parameter of the dataclass ``kind`` whose name is fixed, with its default.

    Values are as ROS has them: lists, and an empty one for a list that is not given.
    """
    return {name: _as_ros(leaf, default) for name, leaf, default in _leaves(_group(kind), "", None)}


def is_parameter(kind: type, name: str) -> bool:
    """Whether the dataclass ``kind`` has a parameter or group of this name."""
    try:
        _locate(_group(kind), name)
    except _Unknown:
        return False
    return True


def values_of(config: Any) -> dict[str, Any]:
    """Return what ``defaults`` does, but with the values of ``config``, a dataclass."""
    shape = _group(type(config))
    return {name: _as_ros(leaf, value) for name, leaf, value in _leaves(shape, "", config)}


def as_map(config: Any) -> dict[str, Any]:
    """Return ``config``, a dataclass, as nested maps for ``read``, without what has its default."""
    found: dict[str, Any] = {}
    for field in _group(type(config)).fields:
        value = getattr(config, field.field)
        if isinstance(field.shape, ValueType):
            if value != field.default:
                found[field.name] = _as_ros(field.shape, value)
        elif isinstance(field.shape, _UserKeyed):
            items = {name: as_map(item) for name, item in value.items()}
            found |= {field.name: items} if items else {}
        elif inner := as_map(value):
            found[field.name] = inner
    return found


def replaced(config: T, name: str, value: Any) -> T:
    """Return ``config``, a dataclass, with another value of the parameter ``name``.

    Raises:
        ConfigError: it has no such parameter, or that cannot have this value.
    """
    kind = type(config)
    try:
        path, shape = _locate_field(_group(kind), name)
        if name not in defaults(kind) or not isinstance(shape, ValueType):
            raise _Unknown("is more than one parameter")
        return typing.cast(T, _replaced(config, path, shape.checked(value)))
    except (_Unknown, ValueError) as error:
        raise ConfigError([Problem(name, str(error))]) from None


def _replaced(config: Any, path: Sequence[str], value: Any) -> Any:
    field, *rest = path
    new = _replaced(getattr(config, field), rest, value) if rest else value
    return dataclasses.replace(config, **{field: new})


def _leaves(shape: _Group, prefix: str, value: Any) -> Iterator[tuple[str, ValueType, Any]]:
    """All parameters with fixed names, each with its value in ``value`` or else its default."""
    for field in shape.fields:
        default = getattr(value, field.field) if value is not None else field.default
        if isinstance(field.shape, _Group):
            inner = None if default is REQUIRED else default
            yield from _leaves(field.shape, f"{prefix}{field.name}.", inner)
        elif isinstance(field.shape, ValueType):
            yield prefix + field.name, field.shape, default


def _as_ros(leaf: ValueType, value: Any) -> Any:
    if value is REQUIRED or value is None:
        return [] if leaf.many else None
    return list(value) if leaf.many else value


# Reading --------------------------------------------------------------------------------------


def flatten(values: Values, prefix: str = "") -> dict[str, Any]:
    """Return nested maps as one map of dotted names; an empty map stays, as a value."""
    flat: dict[str, Any] = {}
    for key, value in values.items():
        if isinstance(value, Mapping) and value:
            flat.update(flatten(value, f"{prefix}{key}."))
        else:
            flat[f"{prefix}{key}"] = value
    return flat


def read(kind: type[T], values: Values, places: Mapping[str, str] | None = None) -> T:
    """Return ``values`` as the dataclass ``kind``.

    Args:
        kind: a dataclass of parameters.
        values: dotted names, or nested maps as YAML has them, to values; what is missing has its
            default.
        places: where each was written, such as ``joints.yaml:7``, for the error.

    Raises:
        ConfigError: with every problem, each naming the parameter and what would be right.
    """
    reading = _Reading()
    with contextlib.suppress(_TooManyError):
        config = reading.build(_group(kind), reading.tree(kind, flatten(values)), "")
    if reading.problems:
        raise ConfigError(reading.problems, places)
    return typing.cast(T, config)


class _TooManyError(Exception):
    """Too much is wrong for anybody to read."""


class _Reading:
    """Builds one dataclass of values, and collects what is wrong with them."""

    def __init__(self) -> None:
        self.problems: list[Problem] = []

    def _report(self, key: str, text: str) -> None:
        self.problems.append(Problem(key, text))
        if len(self.problems) > _MOST_FOUND:
            raise _TooManyError

    def tree(self, kind: type, flat: Values) -> dict[str, Any]:
        """Sort ``flat`` by the fields they belong to."""
        tree: dict[str, Any] = {}
        for name, value in flat.items():
            if is_of_every_node(name):
                continue
            try:
                path, shape = _locate_field(_group(kind), name)
            except _Unknown as error:
                self._report(name, str(error))
                continue
            if isinstance(shape, ValueType):
                _put(tree, path, value)
            elif value == {}:
                _put(tree, path, {})
            else:
                self._report(name, f"{shown(value)}; write a map{_form(shape)}")
        return tree

    def build(self, shape: _Shape, content: Any, key: str) -> Any:
        """Return ``content`` checked; REQUIRED if it is wrong."""
        if isinstance(shape, ValueType):
            try:
                return shape.checked(content)
            except ValueError as error:
                self._report(key, str(error))
                return REQUIRED
        if isinstance(shape, _UserKeyed):
            items = {
                name: self.build(shape.item, inner, _join(key, name))
                for name, inner in content.items()
            }
            return {name: item for name, item in items.items() if item is not REQUIRED}
        return self._build_group(shape, content, key)

    def _build_group(self, shape: _Group, content: Mapping[str, Any], key: str) -> Any:
        found: dict[str, Any] = {}
        for field in shape.fields:
            if field.field in content:
                found[field.field] = self.build(
                    field.shape, content[field.field], _join(key, field.name)
                )
            elif field.default is REQUIRED:
                self._missing(field, key)
                found[field.field] = REQUIRED
        if any(f.default is REQUIRED and found[f.field] is REQUIRED for f in shape.fields):
            return REQUIRED
        result = shape.kind(**{name: v for name, v in found.items() if v is not REQUIRED})
        if hasattr(result, "check"):
            self._check(result.check(), key)
        return result

    def _missing(self, field: _Field, key: str) -> None:
        rule = field.shape.rule if isinstance(field.shape, ValueType) else Rule()
        choices = f"one of {', '.join(rule.choices)}" if rule.choices else ""
        what = "".join(f", {text}" for text in (rule.description, choices) if text)
        if key:  # the group's, because only what is written has a line
            self._report(key, f"has no {field.name}{what}")
        else:
            self._report(field.name, f"is missing{what}")

    def _check(self, found: Iterable[Problem], prefix: str) -> None:
        """Take the problems that follow from no other."""
        known = tuple(self.problems)
        for problem in found:
            fresh = Problem(_join(prefix, problem.key), problem.text)
            if not any(map(fresh.overlaps, known)):
                self._report(fresh.key, fresh.text)


def _join(prefix: str, name: str) -> str:
    return ".".join(part for part in (prefix, name) if part)


def _put(tree: dict[str, Any], path: Sequence[str], value: Any) -> None:
    for step in path[:-1]:
        tree = tree.setdefault(step, {})
    if value == {} and path[-1] in tree:
        return
    tree[path[-1]] = value


def _form(shape: _Shape) -> str:
    """How a map is written, in words."""
    if isinstance(shape, _Group):
        return f" with {', '.join(shape.names)}"
    assert isinstance(shape, _UserKeyed)
    if isinstance(shape.item, ValueType):
        return f", such as {{some_name: {'0.5' if shape.item.base is float else '...'}}}"
    return f" of names, each a map{_form(shape.item)}"


# Parameters of nodes --------------------------------------------------------------------------


def declare(
    node: "Node", kind: type, values: Values | None = None, fixed: Values | None = None
) -> dict[str, Any]:
    """Declare every parameter of the dataclass ``kind``, with what is known of each.

    Their types are left open, so that ``read`` reports a wrong one with all else that is wrong; an
    integer for a double is declared as a double.

    Args:
        node: to declare them on.
        kind: a dataclass of parameters.
        values: by name, instead of the defaults; also of names that only the user defines, None
            for one that the command line sets.
        fixed: by name, values that override the command line.

    Returns:
        All values in force, by dotted name.
    """
    first = {**defaults(kind), **(values or {}), **(fixed or {})}
    for name, default in first.items():
        _declare(node, kind, name, default, ignore_override=name in (fixed or {}))
    found = {name: plain(node.get_parameter(name).value) for name in first}
    ours = {name: value for name, value in found.items() if is_parameter(kind, name)}
    return {name: value for name, value in ours.items() if value is not None}


def _declare(node: "Node", kind: type, name: str, default: Any, *, ignore_override: bool) -> None:
    from rcl_interfaces.msg import ParameterDescriptor
    from rclpy.exceptions import InvalidParameterValueException

    if node.has_parameter(name):
        return
    # rclpy cannot infer the type of an empty list: it is set afterwards, as is a double.
    first = None if default == [] else default
    node.declare_parameter(name, first, ParameterDescriptor(dynamic_typing=True), ignore_override)
    given = node.get_parameter(name)
    value = ros_parameter(name, default) if given.value is None else given
    final = _with_doubles(kind, value)
    if final.type_ != given.type_:
        node.set_parameters([final])
    # Out of range, it is left to ``read`` to report.
    with contextlib.suppress(InvalidParameterValueException):
        node.set_descriptor(name, descriptor(kind, name))


def _with_doubles(kind: type, parameter: "Parameter") -> "Parameter":
    """Return a parameter of the dataclass ``kind``, as a double if it has an integer for one."""
    value = plain(parameter.value)
    try:
        _, leaf = _locate(_group(kind), parameter.name)
        if isinstance(leaf, ValueType) and leaf.base is float and value not in (None, []):
            return ros_parameter(parameter.name, _as_ros(leaf, leaf.checked(value)))
    except (_Unknown, ValueError):  # ``read`` reports it
        pass
    return parameter


def set_doubles(node: "Node", kind: type) -> None:
    """Have an integer that is set for a double of the dataclass ``kind`` be one on ``node``."""
    node.add_pre_set_parameters_callback(
        lambda parameters: [_with_doubles(kind, one) for one in parameters]
    )


def refuse_undeclared(node: "Node", kind: type) -> None:
    """Refuse to set what ``node`` does not have, with its name and what would be right.

    rclpy refuses it as well, but names nothing. Integers for doubles are set as doubles.

    Args:
        node: that declared its parameters.
        kind: their dataclass.
    """
    from rclpy.exceptions import ParameterNotDeclaredException

    def check(parameters: list["Parameter"]) -> list["Parameter"]:
        names = [one.name for one in parameters if not node.has_parameter(one.name)]
        problems = [
            next(iter(unknown_parameters(kind, [name])), Problem(name, "no such parameter"))
            for name in names
        ]
        if problems:
            error = ParameterNotDeclaredException(names)
            error.args = ("\n".join(problem.message() for problem in problems),)
            raise error
        return [_with_doubles(kind, one) for one in parameters]

    node.add_pre_set_parameters_callback(check)


def descriptor(kind: type, name: str) -> "ParameterDescriptor":
    """Return what a node publishes about the parameter ``name`` of the dataclass ``kind``."""
    from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor

    result = ParameterDescriptor(dynamic_typing=True)
    try:
        _, leaf = _locate(_group(kind), name)
    except _Unknown:
        return result
    if not isinstance(leaf, ValueType):
        return result
    rule = leaf.rule
    result.description, result.read_only = rule.description, rule.read_only
    result.additional_constraints = leaf.constraints
    if leaf.many or rule.nan or not rule.range:
        return result
    low = rule.above if rule.above is not None else rule.at_least
    if leaf.base is float:
        least, most = _or(low, -sys.float_info.max), _or(rule.at_most, sys.float_info.max)
        result.floating_point_range = [FloatingPointRange(from_value=least, to_value=most)]
    elif leaf.base is int:
        least, most = int(_or(low, -(2**63))), int(_or(rule.at_most, 2**63 - 1))
        result.integer_range = [IntegerRange(from_value=least, to_value=most, step=1)]
    return result


def _or(value: float | None, otherwise: float) -> float:
    return otherwise if value is None else value


def ros_parameter(name: str, value: Any) -> "Parameter":
    """Return a parameter of whichever type ``value`` has; None unsets it."""
    from rclpy.parameter import Parameter

    if value == []:
        return Parameter(name, Parameter.Type.STRING_ARRAY, [])
    return Parameter(name, value=value)
