"""Expands a xacro file to URDF text, with the place of each element; or returns its mistakes.

xacro keeps its state in module globals and prints to stderr. This module therefore runs in a
process of its own (see ``bounded_process``), and replaces some functions of xacro there: output is
collected, files are read by ``xml``, and expressions are evaluated by ``expressions``. Every
element carries its place as DOM user data, which survives macros and includes, so that later checks
can name the line that a person wrote.
"""

import io
import os
import re
import sys
import traceback
from collections.abc import Collection
from pathlib import Path
from types import FrameType
from typing import Any
from xml.dom import minicompat, minidom
from xml.etree.ElementTree import Element

import xacro
from xacro import substitution_args

from onebot_description.description.bounded_process import Place
from onebot_description.description.expressions import evaluate, global_symbols
from onebot_description.description.xacro import arguments_in
from onebot_description.elements import xml
from onebot_description.elements.packages import Resources
from onebot_description.elements.xml import missing_file, shown_path
from onebot_description.errors import (
    DescriptionError,
    OneBotError,
    did_you_mean,
    printable,
    shortened,
)

_MAX_PLACES = 4


def expand_file(request: dict[str, Any], place: Place) -> dict[str, Any]:
    """Run xacro on the file ``path`` of a request with its ``arguments``.

    Returns:
        ``problems``, and ``arguments``, the names that the files declare or use. Without problems
        also ``text``, ``places`` of its elements, ``files`` read, and ``warnings``.
    """
    path = Path(request["path"])
    run = _Run(place)
    run.replace_functions(str(path))
    answer: dict[str, Any] = {"problems": []}
    failure: Exception | None = None
    try:
        document = xacro.process_file(str(path), mappings=dict(request["arguments"]))
        answer |= _result(document, path)
    except MemoryError:
        raise
    except DescriptionError as error:
        answer["problems"] = list(error.problems)
    except Exception as error:
        failure = error
    declared, used = arguments_in(run.files.items())
    if failure is not None:
        answer["problems"] = [explain(failure, path, declared)]
    included = [str(Path(name).absolute()) for name in xacro.all_includes]
    files = list(dict.fromkeys([*map(str, run.files), *included]))
    arguments = sorted({*declared, *used})
    return {**answer, "files": files, "warnings": run.warnings, "arguments": arguments}


def _result(document: minidom.Document, path: Path) -> dict[str, Any]:
    root = document.documentElement
    assert root is not None  # parsed documents have one
    text = root.toxml()
    if len(text) > xml.MAX_BYTES:
        most = xml.MAX_BYTES // 1_000_000
        raise DescriptionError([f"{shown_path(path)}: expands to more than {most} MB"])
    elements = [root, *root.getElementsByTagName("*")]
    return {"text": text, "places": [written_at(node) or shown_path(path) for node in elements]}


class _CopyPlaces:
    """Passes an element's places to its clones (a DOM UserDataHandler).

    The places of an element are where it was written and, in a macro, where the macro was called,
    where the macro that contains that call was called, and so on.
    """

    def __init__(self) -> None:
        self.call: tuple[str, ...] = ()

    def handle(self, operation: int, key: str, data: Any, source: Any, clone: Any) -> None:
        """Called by minidom for each node cloned, children first."""
        clone.setUserData(key, (data + self.call)[:_MAX_PLACES], self)
        if source.parentNode is None:
            self.call = ()  # the macro's whole body is cloned


class _Children(minicompat.NodeList[Any]):
    """The children of an element; a search starts where the last one ended.

    Otherwise xacro and minidom would take time quadratic in their number.
    """

    _last = 0

    def index(self, node: Any, *_: Any) -> int:
        try:
            self._last = super().index(node, max(self._last - 2, 0))
        except ValueError:
            self._last = super().index(node)
        return self._last

    def remove(self, node: Any) -> None:
        del self[self.index(node)]


class _Run:
    """One run of xacro: collects files and warnings, and has the replaced functions of xacro."""

    def __init__(self, place: Place) -> None:
        self.files: dict[Path, Element] = {}  # the root of each file read
        self.warnings: list[str] = []
        self._place = place
        self._packages: dict[Path, Resources] = {}  # key: folder of the file that names them
        self._copy_places = _CopyPlaces()
        self._handle_macro_call = xacro.handle_macro_call

    def replace_functions(self, file: str) -> None:
        """Make xacro call the methods below; ``file`` is its first file."""
        for name in ("open", "parse", "message", "warning"):
            setattr(xacro, name, getattr(self, name))
        xacro.error = self.warning
        xacro.print_location = lambda *_: None  # places are in the messages already
        xacro.handle_macro_call = self.handle_macro_call
        setattr(minidom, "NodeList", _Children)  # noqa: B010 (minidom creates elements with it)
        xacro.safe_eval = evaluate
        # Private functions behind $(find ...) and $(eval ...), and the names known to $(eval ...).
        substitution_args._eval_find = self.find
        substitution_args._eval = self.eval
        names = substitution_args._eval_dict
        symbols = global_symbols()
        self._eval_names = {
            **symbols["python"],
            **{name: value for name, value in names.items() if not name.startswith("_")},
            "find": self.find,
        }
        xacro._global_symbols = symbols
        xacro.substitution_args_context["filename"] = file

    def parse(self, _: None, filename: str) -> minidom.Document:
        path = Path(filename).absolute()
        if not path.exists() and len(xacro.filestack) > 1:
            # An optional include may be missing; xacro recognises that by the inner error.
            xacro.filestack.pop()
            raise xacro.XacroException("", exc=FileNotFoundError(2, "no such file", str(path)))
        name = shown_path(path)
        self._place.note(name)
        data = xml.read_bytes(path)
        parsed = xml.parse(data, name)
        self.files[path] = parsed.root
        document = minidom.parseString(data)
        elements, places = document.getElementsByTagName("*"), parsed.places.values()
        for element, place in zip(elements, places, strict=True):
            element.setUserData("places", (place,), self._copy_places)
        return document

    def open(self, filename: str) -> io.BytesIO:
        return io.BytesIO(xml.read_bytes(Path(filename)))

    def message(self, *words: object, **_: object) -> None:
        print(printable(" ".join(map(str, words))), file=sys.stderr)

    def warning(self, *words: object, **_: object) -> None:
        stack = xacro.filestack
        place = f"{shown_path(stack[-1])}: " if stack and stack[-1] else ""
        self.warnings.append(place + "xacro: " + " ".join(" ".join(map(str, words)).split()))

    def handle_macro_call(self, node: Any, macros: Any, symbols: Any) -> bool:
        """Replace ``xacro.handle_macro_call``, which is called for every element; note places."""
        places = node.getUserData("places") or ()
        if places:
            self._place.note(places[0])
        if node.tagName.startswith("xacro:"):
            self._copy_places.call = places
        return bool(self._handle_macro_call(node, macros, symbols))

    def eval(self, expression: str, context: Any) -> str:
        """Replace ``$(eval expression)``."""
        values = context.get("arg", {})

        def convert(name: str) -> Any:
            return substitution_args.convert_value(values[name], "auto")

        names = {
            **{name: convert(name) for name in values},
            **self._eval_names,
            "arg": convert,
            "dirname": lambda: os.path.dirname(os.path.abspath(context["filename"])),
        }
        return str(evaluate(expression, names))

    def find(self, package: str) -> str:
        """Replace ``$(find package)`` by the folder of a package, installed or in a source tree."""
        folder = Path(xacro.filestack[-1]).absolute().parent
        return str(self._packages.setdefault(folder, Resources(folder)).package(package))


def explain(error: Exception, path: Path, arguments: Collection[str]) -> str:
    """Return the message for an exception that xacro raised.

    Args:
        error: the exception; a MemoryError is raised again.
        path: the file.
        arguments: names that the files declare.
    """
    chain = _chain(error)
    if isinstance(chain[-1], MemoryError):
        raise chain[-1]
    frames = [frame for frame, _ in traceback.walk_tb(error.__traceback__)]
    places = [place for frame in frames if (place := written_at(_node(frame))) is not None]
    place = places[-1] if places else shown_path(path)
    return f"{place}: {_cause(chain, arguments)}"


def _chain(error: Exception) -> list[Exception]:
    """Return the exceptions that xacro wrapped into each other, outermost first."""
    chain = [error]
    while isinstance(inner := getattr(chain[-1], "exc", None), Exception):
        chain.append(inner)
    return chain


def _cause(chain: list[Exception], arguments: Collection[str]) -> str:
    """Return the message without its place."""
    inner = chain[-1]
    if isinstance(inner, OneBotError):
        return str(inner)
    if isinstance(inner, RecursionError):
        return "this expression is nested too deeply, or refers to itself endlessly"
    if isinstance(inner, FileNotFoundError) and inner.filename:
        return missing_file(Path(str(inner.filename)))
    if type(inner).__name__ == "ArgException":
        name = str(inner)
        hint = "" if name in arguments else did_you_mean(name, arguments, "declared")
        return (
            f'argument "{name}" has no value here{hint}; give {name}:=<value>, '
            f'or declare <xacro:arg name="{name}" default="..."/> above'
        )
    text = " ".join(str(inner).split()) or repr(inner)
    expression = _expression(chain)
    if expression and not hasattr(inner, "suffix"):
        return f"cannot evaluate ${{{expression}}}: {text}"
    return f"xacro: {text}"


def _expression(chain: list[Exception]) -> str:
    """Return the innermost ``${...}`` that was being evaluated; "" if there is none."""
    for error in reversed(chain):
        if match := re.search(
            r"when evaluating expression '(.*)'", getattr(error, "suffix", None) or ""
        ):
            return shortened(match[1])
    return ""


def written_at(node: Any) -> str | None:
    """Return where a DOM node was written: ``file:line``, with the macro calls that led there."""
    while node is not None:
        if places := node.getUserData("places"):
            calls = f" (called at {', from '.join(places[1:])})" if len(places) > 1 else ""
            return f"{places[0]}{calls}"
        node = node.parentNode
    return None


def _node(frame: FrameType) -> Any:
    """Return the XML node that a stack frame of xacro works on; None if there is none."""
    if frame.f_globals.get("__name__") != "xacro":
        return None
    return frame.f_locals.get("node", frame.f_locals.get("elt"))
