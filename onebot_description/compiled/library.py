"""Loads the compiled library, which the state publisher, RobotModel, TFMessage and Schema need."""

import ctypes
import functools

from onebot_description.compiled import build_library
from onebot_description.errors import OneBotError

_REMEDY = "Build it with: python -m onebot_description.compiled.build_library"


class LibraryError(OneBotError, ImportError):
    """The compiled library cannot be used; ``str(error)`` says how to build it."""


@functools.cache
def load_library() -> ctypes.PyDLL:
    """Return the compiled library."""
    path = build_library.LIBRARY
    try:
        library = ctypes.PyDLL(str(path))
        digest = ctypes.c_char.in_dll(library, "onebot_source_digest")
    except (OSError, ValueError) as error:
        raise LibraryError(
            f"The compiled library {path.name} cannot be loaded: {error}. {_REMEDY}"
        ) from error
    if all(source.exists() for source in build_library.SOURCES):
        built_from = ctypes.string_at(ctypes.addressof(digest)).decode()
        if built_from != build_library.source_digest():
            raise LibraryError(
                f"The compiled library {path.name} does not match the source. {_REMEDY}"
            )
    return library
