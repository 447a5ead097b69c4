"""The single settings of a view, by dotted names such as ``axes.visible``: RViz's check boxes."""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from typing import Any

from onebot_bringup.viewer.view_config import ViewConfig, check_value

Value = bool | float | str | list[float] | list[int] | list[str]


def settings(view: ViewConfig) -> dict[str, Value]:
    """Return every single setting of ``view``; what is left open is an empty list.

    Trails, covariances and curves are no settings: they have names of the user's own.
    """
    return {name: _plain(value) for name, value in _leaves(view, "")}


def with_setting(view: ViewConfig, name: str, value: Any) -> ViewConfig:
    """Return ``view`` with another value of one setting, as a view file would have it.

    Raises:
        ValueError: there is no such setting, or it cannot have that value.
    """
    changed: ViewConfig = _replaced(view, name.split("."), value, name)
    return changed


def changed_settings(before: ViewConfig, after: ViewConfig) -> dict[str, Value]:
    """Return the settings of ``after`` that differ from those of ``before``."""
    old = settings(before)
    return {name: value for name, value in settings(after).items() if old[name] != value}


def _leaves(config: Any, prefix: str) -> list[tuple[str, Any]]:
    found: list[tuple[str, Any]] = []
    for entry in fields(config):
        value = getattr(config, entry.name)
        if is_dataclass(value):
            found += _leaves(value, f"{prefix}{entry.name}.")
        elif not isinstance(value, Mapping):
            found.append((prefix + entry.name, value))
    return found


def _plain(value: Any) -> Value:
    if value is None:
        return []
    return list(value) if isinstance(value, tuple) else value


def _replaced(config: Any, path: list[str], value: Any, name: str) -> Any:
    if (
        not is_dataclass(config)
        or isinstance(config, type)
        or path[0] not in {entry.name for entry in fields(config)}
    ):
        raise ValueError(f'there is no setting "{name}"')
    current = getattr(config, path[0])
    if len(path) > 1:
        new = _replaced(current, path[1:], value, name)
    elif is_dataclass(current) or isinstance(current, Mapping):
        raise ValueError(f'"{name}" is more than one setting')
    else:
        new = check_value(path[0], current, value, name)
    changed: Any = replace(config, **{path[0]: new})
    return changed
