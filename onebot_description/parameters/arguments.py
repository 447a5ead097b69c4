"""Checks the arguments of functions by their annotations, with the rules that parameters have.

An annotation says what an argument may be, and may add a ``Rule``, or a whole ``ValueType``::

    @checked
    def run(seconds: Annotated[float, Rule(at_least=0.0)], paused: bool = False) -> None: ...

As for parameters, integers and numpy scalars are valid for a float; strings are not. The function
gets plain Python values, but arrays and other sequences unchanged.
"""

import functools
import inspect
import os
import types
import typing
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, TypeVar, cast

from onebot_description.parameters.reader import ConfigError, Problem
from onebot_description.parameters.values import Rule, ValueType, plain, shown

F = TypeVar("F", bound=Callable[..., Any])
T = TypeVar("T")

# Takes an argument's name and value, returns the value to use, and adds problems to a list.
_Check = Callable[[str, Any, list[Problem]], Any]
# What to write in Python for a type.
_WANTED: Mapping[Any, str] = {
    **{bool: "True or False", str: "a string", float: "a number"},
    **{Path: "a path", Callable: "a function", Mapping: "a dict", Iterable: "a list"},
}
_ACCEPTED: Mapping[Any, tuple[type, ...]] = {float: (float, int), Path: (os.PathLike,)}


class ArgumentError(ConfigError, ValueError):
    """Arguments that cannot be used; ``problems`` are all that were found."""


def checked(function: F, before: Callable[[Any], object] | None = None) -> F:
    """Return a function that checks its arguments before it runs.

    Arguments whose annotation does not determine a type, such as ``Any``, are not checked.

    Args:
        function: the function, or a method.
        before: called with a method's object before anything else.

    Raises:
        ArgumentError: arguments are wrong; it names each of them, and what to write.
    """
    parameters = inspect.signature(function).parameters.values()
    names = [one.name for one in parameters if one.kind is one.POSITIONAL_OR_KEYWORD]

    @functools.wraps(function)
    def checking(*given: Any, **named: Any) -> Any:
        if before is not None:
            before(given[0])
        checks, problems = _checks(function), list[Problem]()

        def used(name: str, value: Any) -> Any:
            return checks[name](name, value, problems) if name in checks else value

        values = [*map(used, names, given), *given[len(names) :]]
        named = {name: used(name, value) for name, value in named.items()}
        if problems:
            raise ArgumentError(problems)
        return function(*values, **named)

    return cast(F, checking)


def checked_methods(before: Callable[[Any], object] | None = None) -> Callable[[type[T]], type[T]]:
    """Return a class decorator: ``__init__`` and all public methods check their arguments.

    Args:
        before: called with the object before each public method, except ``close``.
    """

    def decorate(kind: type[T]) -> type[T]:
        for name, member in [*vars(kind).items()]:
            if inspect.isfunction(member) and (name == "__init__" or not name.startswith("_")):
                first = None if name in ("__init__", "close") else before
                setattr(kind, name, checked(member, first))
        return kind

    return decorate


@functools.cache
def _checks(function: Callable[..., Any]) -> Mapping[str, _Check]:
    """Return the check of each argument.

    The return type may be imported by type checkers only, so it is not resolved.
    """
    hints = {name: hint for name, hint in function.__annotations__.items() if name != "return"}
    holder = types.SimpleNamespace(__annotations__=hints)
    resolved = typing.get_type_hints(holder, function.__globals__, include_extras=True)
    return {name: _check(hint) for name, hint in resolved.items()}


def _check(hint: Any, rule: Rule | None = None) -> _Check:
    """Return the check for an annotation with a rule."""
    rule, origin, args = rule or Rule(), typing.get_origin(hint), typing.get_args(hint)
    if origin is Annotated:
        added = args[1]
        return _value(added) if isinstance(added, ValueType) else _check(args[0], added)
    if hint in (float, int, bool, str):
        return _value(ValueType(hint, rule))
    if origin is Sequence and args[0] in (float, int, str):
        return _value(ValueType(args[0], rule, many=True))
    if origin is Mapping:
        return _map(_check(args[0]), _check(args[1]), rule)
    if origin in (typing.Union, types.UnionType):
        present = [kind for kind in args if kind is not types.NoneType]
        check = _check(present[0], rule) if len(present) == 1 else _instance(present, rule)
        return check if len(present) == len(args) else _optional(check)
    return _instance([origin if origin in _WANTED else hint], rule)


def _optional(check: _Check) -> _Check:
    return lambda name, value, problems: None if value is None else check(name, value, problems)


def _value(kind: ValueType) -> _Check:
    if kind.base is bool:
        kind = replace(kind, rule=replace(kind.rule, write=kind.rule.write or _WANTED[bool]))

    def check(name: str, value: Any, problems: list[Problem]) -> Any:
        try:
            result = kind.checked(value)
        except ValueError as error:
            problems.append(Problem(name, str(error)))
            return value
        return value if kind.many else result

    return check


def _instance(kinds: Sequence[Any], rule: Rule) -> _Check:
    """Return the check for instances of some classes; for other annotations, no check."""
    if any(typing.get_origin(kind) or kind is Any or not isinstance(kind, type) for kind in kinds):
        return lambda name, value, problems: value
    accepted = tuple(type_ for kind in kinds for type_ in _ACCEPTED.get(kind, (kind,)))
    remedy = rule.write or " or ".join(_WANTED.get(kind, f"a {kind.__name__}") for kind in kinds)

    def check(name: str, value: Any, problems: list[Problem]) -> Any:
        value = value if isinstance(value, accepted) else plain(value)
        if not isinstance(value, accepted) or (isinstance(value, bool) and bool not in kinds):
            problems.append(Problem(name, f"{shown(value)}; write {remedy}"))
        return value

    return check


def _map(key_check: _Check, item_check: _Check, rule: Rule) -> _Check:
    check_type = _instance([Mapping], rule)

    def check(name: str, value: Any, problems: list[Problem]) -> Any:
        if not isinstance(value, Mapping):
            return check_type(name, value, problems)
        result = dict[str, Any]()
        for key, item in value.items():
            key_check(name, key, problems)
            result[key] = item_check(f"{name}.{key}", item, problems)
        return result

    return check
