"""Running xacro as a library, as often as wanted, with every mistake located and explained.

xacro keeps its state in module globals and prints to stderr. Here each run gets globals of its own,
which are put back afterwards, under a lock; what it would print is collected. Every element of the
files carries its place as DOM user data, which survives macros and includes, so that a check on the
result can still name the line that a person wrote.
"""

import importlib
import re
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from xml.dom import minidom

from onebot_description.description import endless, explaining, reading
from onebot_description.description.meshes import find_package
from onebot_description.errors import DescriptionError
from onebot_description.text import did_you_mean

_lock = threading.RLock()
_MOST_ELEMENTS = 30_000  # some seconds of work; large robots have a tenth of that
_MOST_INCLUDES = 50
_MOST_PLACES = 4
_STAND_INS = "parse warning error print_location handle_macro_call safe_eval".split()
# Private in an untyped module: of $(find ...) and $(eval ...), and the latter's names.
_FIND, _EVAL, _EVAL_NAMES = "_eval_find", "_eval", "_eval_dict"
_STATE = "_global_symbols all_includes filestack macrostack root_dir verbosity".split()
# Arguments that are used without being declared are arguments all the same.
_USED_ARGUMENT = re.compile(rb"\$\(\s*arg\s+([^\s)]+)\s*\)|xacro\.arg\(\s*['\"]([^'\"]+)['\"]")


class _CopyPlaces:
    """Hands an element's places on to its clones (a DOM UserDataHandler).

    Places are where an element was written and, if that is in a macro, where it is called, where
    the macro with that call is called, and so on.

    Attributes:
        call: the places of the macro call whose body is about to be cloned.
    """

    def __init__(self) -> None:
        self.call: tuple[str, ...] = ()

    def handle(self, operation: int, key: str, data: Any, source: Any, clone: Any) -> None:
        """Called by minidom for each node cloned, children first."""
        clone.setUserData(key, (data + self.call)[:_MOST_PLACES], self)
        if source.parentNode is None:
            self.call = ()  # that was the macro's whole body


class _Run:
    """What one run of xacro reads, warns of and stands in for."""

    def __init__(self, xacro: Any, substitution: Any) -> None:
        self.xacro, self.substitution = xacro, substitution
        self.files: list[Path] = []
        self.arguments: set[str] = set()
        self.declared: set[str] = set()
        self.warnings: list[str] = []
        self._elements = 0
        self._copy_places = _CopyPlaces()
        self._handle_macro_call = xacro.handle_macro_call
        self._safe_eval = xacro.safe_eval
        self._eval = getattr(substitution, _EVAL)

    def parse(self, source: Any, filename: str | None = None) -> minidom.Document:
        """Stand in for ``xacro.parse``: scans first and notes places."""
        if source is not None or filename is None:
            raise DescriptionError(["xacro: only files can be included"])
        if len(self.xacro.filestack) > _MOST_INCLUDES:
            shown = reading.shown_path(filename)
            raise DescriptionError([f"{shown}: files include each other without end"])
        path = Path(filename).absolute()
        if not path.is_file() and len(self.xacro.filestack) > 1:
            # An optional include may be missing; xacro tells by the kind of the inner error.
            self.xacro.filestack.pop()
            raise self.xacro.XacroException("", exc=FileNotFoundError(2, "no such file", str(path)))
        data = reading.read_bytes(path)
        self.files.append(path)
        shown = reading.shown_path(path)
        lines = reading.scan(data, shown).lines
        document = minidom.parseString(data)
        for element, line in zip(document.getElementsByTagName("*"), lines, strict=True):
            element.setUserData("places", (f"{shown}:{line}",), self._copy_places)
            if element.tagName == "xacro:arg":
                self.declared.add(element.getAttribute("name"))
        for pair in _USED_ARGUMENT.findall(data):
            self.arguments.update(name.decode("utf-8", "replace") for name in pair if name)
        return document

    def warning(self, *words: object, **_: object) -> None:
        """Stand in for ``xacro.warning``: collects instead of printing."""
        stack = self.xacro.filestack
        place = f"{reading.shown_path(stack[-1])}: " if stack and stack[-1] else ""
        self.warnings.append(place + "xacro: " + " ".join(" ".join(map(str, words)).split()))

    def error(self, *words: object, **_: object) -> None:
        """Stand in for ``xacro.error``, which a file calls without meaning to stop."""
        self.warning(*words)

    def print_location(self, *_: object, **__: object) -> None:
        """Stand in for ``xacro.print_location``: places are in the messages already."""

    def handle_macro_call(self, node: Any, macros: Any, symbols: Any) -> bool:
        """Stand in for ``xacro.handle_macro_call``: bounds what macros may grow to."""
        self._elements += 1
        if self._elements > _MOST_ELEMENTS:
            place = explaining.written_at(node) or "xacro"
            raise DescriptionError(
                [f"{place}: the macros expand to more than {_MOST_ELEMENTS} elements"]
            )
        if node.tagName.startswith("xacro:"):
            self._copy_places.call = node.getUserData("places") or ()
        return bool(self._handle_macro_call(node, macros, symbols))

    def safe_eval(self, expression: str, *symbols: Any) -> Any:
        """Stand in for ``xacro.safe_eval``: refuses what would take for ever."""
        return self._safe_eval(endless.bounded(expression), *symbols)

    def eval(self, expression: str, context: Any) -> Any:
        """Stand in for ``$(eval expression)`` in the same way."""
        return self._eval(endless.bounded(expression), context)

    def find(self, package: str) -> str:
        """Stand in for ``$(find package)``: an installed package or one being worked on."""
        return str(find_package(package, Path(self.xacro.filestack[-1]).absolute().parent))


@contextmanager
def _own_globals(run: _Run, path: Path) -> Iterator[None]:
    """Give ``run`` globals of its own inside xacro."""
    xacro, substitution = run.xacro, run.substitution
    kept = {name: getattr(xacro, name) for name in (*_STAND_INS, *_STATE)}
    kept_inside = {name: getattr(substitution, name) for name in (_FIND, _EVAL, _EVAL_NAMES)}
    try:
        for name in _STAND_INS:
            setattr(xacro, name, getattr(run, name))
        setattr(substitution, _FIND, run.find)
        setattr(substitution, _EVAL, run.eval)
        setattr(substitution, _EVAL_NAMES, dict(kept_inside[_EVAL_NAMES]))
        endless.bound_functions(getattr(substitution, _EVAL_NAMES))
        xacro.root_dir, xacro.verbosity, xacro.all_includes = ".", 1, []
        xacro.substitution_args_context.clear()
        xacro.substitution_args_context["filename"] = str(path)
        xacro._global_symbols = xacro.create_global_symbols()
        endless.bound_functions(xacro._global_symbols)
        yield
    finally:
        for name, value in kept.items():
            setattr(xacro, name, value)
        for name, value in kept_inside.items():
            setattr(substitution, name, value)
        xacro.substitution_args_context.clear()


def expand(
    path: Path, arguments: Mapping[str, str]
) -> tuple[reading.Document, tuple[Path, ...], tuple[str, ...]]:
    """Run xacro on a file.

    Args:
        path: the file, absolute.
        arguments: values for its ``<xacro:arg>``s.

    Returns:
        The expanded document, the files read (``path`` first), and xacro's warnings.

    Raises:
        DescriptionError: xacro cannot expand it, or has no argument of a name given.
    """
    with _lock:
        run = _Run(*map(importlib.import_module, ("xacro", "xacro.substitution_args")))
        problems: list[str] = []
        document = None
        with _own_globals(run, path):
            try:
                document = run.xacro.process_file(str(path), mappings=dict(arguments))
            except DescriptionError as error:
                problems.extend(error.problems)
            except Exception as error:
                problems.append(explaining.explain(error, path, run.declared))
            included = [Path(name).absolute() for name in run.xacro.all_includes]
    problems += unknown_arguments(path, arguments, run.declared | run.arguments)
    if document is None or problems:
        raise DescriptionError(problems)
    files = tuple(dict.fromkeys([*run.files, *included]))
    return _to_document(document, path), files, tuple(run.warnings)


def unknown_arguments(
    path: Path, arguments: Mapping[str, str], declared: set[str]
) -> Iterator[str]:
    """Yield a problem for each argument that the file at ``path`` does not declare."""
    for name in arguments:
        if name not in declared:
            hint = did_you_mean(name, declared, "declared")
            yield f'{reading.shown_path(path)}: takes no argument "{name}"{hint}'


def _to_document(document: minidom.Document, path: Path) -> reading.Document:
    """Parse what xacro made, taking over the places of its elements."""
    root = document.documentElement
    shown = reading.shown_path(path)
    assert root is not None  # parsed documents have one
    data = root.toxml().encode("utf-8", "replace")
    found = reading.scan(data, f"{shown} (expanded)", "utf-8")
    fresh = reading.to_document(data, found, shown, path.parent, "utf-8")
    elements = [root, *root.getElementsByTagName("*")]
    places = {
        element: explaining.written_at(node) or shown
        for element, node in zip(fresh.root.iter(), elements, strict=True)
    }
    return reading.Document(fresh.root, places, shown, path.parent, plain=False)
