"""The displays of the robot view: each file of this folder holds one, or several similar ones.

A display is a ``Drawing`` of message types, or a ``Display``, with its own ``key``, under which its
settings are in view files and ROS parameters. The argument of its base class is their type, as in
``Drawing[PathSettings]``. Nothing else has to be registered.
"""

from collections.abc import Iterator, Mapping
from importlib import import_module
from pkgutil import iter_modules
from typing import Any, TypeAlias, TypeVar, get_args

from onebot_bringup.viewer.core.display import Display
from onebot_bringup.viewer.core.drawing import Drawing

T = TypeVar("T")
AnyDisplay: TypeAlias = type[Display[Any]] | type[Drawing[Any]]


def _found(base: type[T]) -> Iterator[type[T]]:
    """Yield the subclasses of ``base`` in this folder that have a key or types of their own.

    Classes without either are bases of others.
    """
    for file in iter_modules(__path__, f"{__name__}."):
        for item in vars(import_module(file.name)).values():
            is_own = isinstance(item, type) and item.__module__ == file.name
            if is_own and issubclass(item, base) and {"key", "message_types"} & vars(item).keys():
                yield item


def settings_type(display: AnyDisplay) -> Any:
    """Return the type of a display's settings: a dataclass, or a map from names to one."""
    [settings] = get_args(vars(display)["__orig_bases__"][0])
    return settings


# The displays of each robot, or of all robots.
ROBOT_DISPLAYS: tuple[type[Display[Any]], ...] = tuple(
    sorted(_found(Display), key=lambda display: (display.order, display.key))  # type: ignore[type-abstract]
)
# The drawings of message types, for the topics of any robot.
MESSAGE_DRAWINGS: tuple[type[Drawing[Any]], ...] = tuple(
    sorted(_found(Drawing), key=lambda drawing: drawing.key)
)
_ALL: tuple[AnyDisplay, ...] = (*ROBOT_DISPLAYS, *MESSAGE_DRAWINGS)
DISPLAY_BY_KEY: Mapping[str, AnyDisplay] = {display.key: display for display in _ALL}
DRAWING_BY_TYPE: Mapping[str, type[Drawing[Any]]] = {
    name: drawing for drawing in MESSAGE_DRAWINGS for name in drawing.message_types
}
"""The drawing class of each message type."""
