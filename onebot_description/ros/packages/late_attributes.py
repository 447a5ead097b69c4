"""Attributes of a module that are made when they are first used."""

import sys
from collections.abc import Callable, Collection
from typing import Any


def provide(module: str, names: Collection[str], make: Callable[[str], Any]) -> None:
    """Give a module attributes that are made when they are first used.

    Any other attribute that it lacks raises an AttributeError with its name.
    """
    attributes = vars(sys.modules[module])

    def find(name: str) -> Any:
        if name not in names:
            raise AttributeError(f"module '{module}' has no attribute '{name}'", name=name)
        attributes[name] = make(name)
        return attributes[name]

    attributes["__getattr__"] = find
