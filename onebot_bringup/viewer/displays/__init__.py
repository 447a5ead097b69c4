"""The displays of the robot view: each file of this folder holds one, or some that are alike.

A display is a ``Drawing`` of message types, or a ``Display``, with a ``key`` of its own: under it,
its settings are in view files and ROS parameters. Its class names their type as the argument of its
base, as ``Drawing[PathSettings]`` does. Nothing else has to be registered.
"""

from collections.abc import Iterable, Iterator, Mapping
from importlib import import_module
from pkgutil import iter_modules
from typing import Any, TypeAlias, TypeVar, get_args

from onebot_bringup.viewer.core.display import Display
from onebot_bringup.viewer.core.drawing import Drawing

T = TypeVar("T")
AnyDisplay: TypeAlias = type[Display[Any]] | type[Drawing[Any]]


def _found(base: type[T]) -> Iterator[type[T]]:
    """Yield the subclasses of ``base`` in this folder that have a key or types of their own.

    Those without either are bases of others.
    """
    for file in iter_modules(__path__, f"{__name__}."):
        for item in vars(import_module(file.name)).values():
            is_own = isinstance(item, type) and item.__module__ == file.name
            if is_own and issubclass(item, base) and {"key", "message_types"} & vars(item).keys():
                yield item


def unique(displays: Iterable[tuple[str, T]]) -> dict[str, T]:
    """Return displays by the name of each, a key or a message type.

    Raises:
        TypeError: two have the same name.
    """
    by_name: dict[str, T] = {}
    for name, display in displays:
        first_display = by_name.setdefault(name, display)
        if first_display is not display:
            raise TypeError(f'"{name}" belongs to two displays: {first_display} and {display}')
    return by_name


def settings_type(display: AnyDisplay) -> Any:
    """Return the type of a display's settings: a dataclass, or a map from names to one.

    Raises:
        TypeError: its class does not name it.
    """
    arguments = get_args(vars(display).get("__orig_bases__", (None,))[0])
    if len(arguments) != 1 or isinstance(arguments[0], TypeVar):
        raise TypeError(f"{display} must name its settings, as Drawing[PathSettings] does")
    return arguments[0]


# Of each robot, or of all robots.
ROBOT_DISPLAYS: tuple[type[Display[Any]], ...] = tuple(
    sorted(_found(Display), key=lambda display: (display.order, display.key))  # type: ignore[type-abstract]
)
# Of the topics of message types, whichever robot's they are.
MESSAGE_DRAWINGS: tuple[type[Drawing[Any]], ...] = tuple(
    sorted(_found(Drawing), key=lambda drawing: drawing.key)
)
_ALL: tuple[AnyDisplay, ...] = (*ROBOT_DISPLAYS, *MESSAGE_DRAWINGS)
DISPLAY_BY_KEY: Mapping[str, AnyDisplay] = unique((display.key, display) for display in _ALL)
DRAWING_BY_TYPE: Mapping[str, type[Drawing[Any]]] = unique(
    (name, drawing) for drawing in MESSAGE_DRAWINGS for name in drawing.message_types
)
"""The drawing class of each message type."""
