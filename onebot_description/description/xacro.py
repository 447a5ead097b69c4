"""xacro as a library: expanded as often as wanted, with every mistake located and explained.

xacro keeps its state in module globals and prints to stderr. Here each run gets globals of its own,
which are restored afterwards, under a lock; what it would print is collected. Every element of the
files carries its place as DOM user data, which survives macros and includes, so that a check of the
result can still name the line that a person wrote. Expressions that would never end, such as
``10**10**10``, are refused at once.
"""

import ast
import functools
import importlib
import re
import threading
import traceback
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Any, NamedTuple
from xml.dom import minidom

from onebot_description.description import xml
from onebot_description.description.packages import find_package, resolve
from onebot_description.description.xml import missing_file, shown_path
from onebot_description.errors import DescriptionError, OneBotError, did_you_mean

_lock = threading.RLock()
_MOST_ELEMENTS = 30_000  # some seconds of work; large robots have a tenth of that
_MOST_INCLUDES = 50
_MOST_PLACES = 4
_REPLACED = "parse warning error print_location handle_macro_call safe_eval".split()
# Private in an untyped module: of $(find ...) and $(eval ...), and the latter's names.
_FIND, _EVAL, _EVAL_NAMES = "_eval_find", "_eval", "_eval_dict"
_STATE = "_global_symbols all_includes filestack macrostack root_dir verbosity".split()


class _CopyPlaces:
    """Passes an element's places to its clones (a DOM UserDataHandler).

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
    """One run of xacro: what it reads and warns of, and the functions of xacro that it replaces."""

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
        """Replace ``xacro.parse``: scans first and notes places."""
        if source is not None or filename is None:
            raise DescriptionError(["xacro: only files can be included"])
        if len(self.xacro.filestack) > _MOST_INCLUDES:
            shown = xml.shown_path(filename)
            raise DescriptionError([f"{shown}: files include each other without end"])
        path = Path(filename).absolute()
        if not path.is_file() and len(self.xacro.filestack) > 1:
            # An optional include may be missing; xacro recognises that by the inner error.
            self.xacro.filestack.pop()
            raise self.xacro.XacroException("", exc=FileNotFoundError(2, "no such file", str(path)))
        data = xml.read_bytes(path)
        self.files.append(path)
        shown = xml.shown_path(path)
        lines = xml.scan(data, shown).lines
        document = minidom.parseString(data)
        for element, line in zip(document.getElementsByTagName("*"), lines, strict=True):
            element.setUserData("places", (f"{shown}:{line}",), self._copy_places)
            if element.tagName == "xacro:arg":
                self.declared.add(element.getAttribute("name"))
        self.arguments.update(_used_arguments(data.decode("utf-8", "replace")))
        return document

    def warning(self, *words: object, **_: object) -> None:
        """Replace ``xacro.warning``: collects instead of printing."""
        stack = self.xacro.filestack
        place = f"{xml.shown_path(stack[-1])}: " if stack and stack[-1] else ""
        self.warnings.append(place + "xacro: " + " ".join(" ".join(map(str, words)).split()))

    def error(self, *words: object, **_: object) -> None:
        """Replace ``xacro.error``, which a file calls without meaning to stop."""
        self.warning(*words)

    def print_location(self, *_: object, **__: object) -> None:
        """Replace ``xacro.print_location``: places are in the messages already."""

    def handle_macro_call(self, node: Any, macros: Any, symbols: Any) -> bool:
        """Replace ``xacro.handle_macro_call``: bounds what macros may grow to."""
        self._elements += 1
        if self._elements > _MOST_ELEMENTS:
            place = written_at(node) or "xacro"
            raise DescriptionError(
                [f"{place}: the macros expand to more than {_MOST_ELEMENTS} elements"]
            )
        if node.tagName.startswith("xacro:"):
            self._copy_places.call = node.getUserData("places") or ()
        return bool(self._handle_macro_call(node, macros, symbols))

    def safe_eval(self, expression: str, *symbols: Any) -> Any:
        """Replace ``xacro.safe_eval``: refuses what would take for ever."""
        return self._safe_eval(bounded(expression), *symbols)

    def eval(self, expression: str, context: Any) -> Any:
        """Replace ``$(eval expression)`` in the same way."""
        return self._eval(bounded(expression), context)

    def find(self, package: str) -> str:
        """Replace ``$(find package)``: an installed package or one being worked on."""
        return str(find_package(package, Path(self.xacro.filestack[-1]).absolute().parent))


@contextmanager
def _own_globals(run: _Run, path: Path) -> Iterator[None]:
    """Give ``run`` globals of its own inside xacro."""
    xacro, substitution = run.xacro, run.substitution
    kept = {name: getattr(xacro, name) for name in (*_REPLACED, *_STATE)}
    kept_inside = {name: getattr(substitution, name) for name in (_FIND, _EVAL, _EVAL_NAMES)}
    try:
        for name in _REPLACED:
            setattr(xacro, name, getattr(run, name))
        setattr(substitution, _FIND, run.find)
        setattr(substitution, _EVAL, run.eval)
        setattr(substitution, _EVAL_NAMES, dict(kept_inside[_EVAL_NAMES]))
        bound_functions(getattr(substitution, _EVAL_NAMES))
        xacro.root_dir, xacro.verbosity, xacro.all_includes = ".", 1, []
        xacro.substitution_args_context.clear()
        xacro.substitution_args_context["filename"] = str(path)
        xacro._global_symbols = xacro.create_global_symbols()
        bound_functions(xacro._global_symbols)
        yield
    finally:
        for name, value in kept.items():
            setattr(xacro, name, value)
        for name, value in kept_inside.items():
            setattr(substitution, name, value)
        xacro.substitution_args_context.clear()


def expand(
    path: Path, arguments: Mapping[str, str]
) -> tuple[xml.Document, tuple[Path, ...], tuple[str, ...]]:
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
                problems.append(explain(error, path, run.declared))
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
            yield f'{xml.shown_path(path)}: takes no argument "{name}"{hint}'


def _to_document(document: minidom.Document, path: Path) -> xml.Document:
    """Parse what xacro made, keeping the places of its elements."""
    root = document.documentElement
    shown = xml.shown_path(path)
    assert root is not None  # parsed documents have one
    data = root.toxml().encode("utf-8", "replace")
    found = xml.scan(data, f"{shown} (expanded)", "utf-8")
    fresh = xml.to_document(data, found, shown, path.parent, "utf-8")
    elements = [root, *root.getElementsByTagName("*")]
    places = {
        element: written_at(node) or shown
        for element, node in zip(fresh.root.iter(), elements, strict=True)
    }
    return xml.Document(fresh.root, places, shown, path.parent)


def explain(error: Exception, path: Path, arguments: Iterable[str]) -> str:
    """Return the message for what xacro raised while it processed ``path``.

    Args:
        error: what was raised.
        path: the file xacro was started on.
        arguments: the names of the arguments the files declare.
    """
    frames = [frame for frame, _ in traceback.walk_tb(error.__traceback__)]
    places = [place for frame in frames if (place := _place(frame)) is not None]
    place = places[-1] if places else shown_path(path)
    return f"{place}: {_cause(_chain(error), frames, list(arguments))}"


def _chain(error: Exception) -> list[Exception]:
    """The exceptions that xacro wrapped into each other, outermost first."""
    chain = [error]
    while isinstance(inner := getattr(chain[-1], "exc", None), Exception):
        chain.append(inner)
    return chain


def _cause(chain: list[Exception], frames: list[FrameType], arguments: list[str]) -> str:
    """The message without its place."""
    inner = chain[-1]
    expression = _expression(chain)
    if isinstance(inner, OneBotError):
        return str(inner)
    if isinstance(inner, RecursionError):
        return f"{_recursing(frames)} calls itself without end"
    if isinstance(inner, FileNotFoundError) and inner.filename:
        return missing_file(Path(str(inner.filename)))
    if isinstance(inner, NameError) and (name := re.search(r"name '(.+?)'", str(inner))):
        hint = did_you_mean(name[1], _names(frames, "symbols"), "defined")
        return f'unknown property "{name[1]}" in ${{{expression}}}{hint}'
    if type(inner).__name__ == "ArgException":
        hint = did_you_mean(str(inner), arguments, "declared")
        return (
            f'argument "{inner}" has no value{hint}; give {inner}:=<value>, '
            f'or declare <xacro:arg name="{inner}" default="..."/>'
        )
    text = " ".join(str(inner).split()) or repr(inner)
    if unknown := re.match(r"unknown macro name: xacro:(.+)", text):
        hint = did_you_mean(unknown[1], _names(frames, "macros"), "defined")
        return f'unknown macro "{unknown[1]}"{hint}'
    if macros := getattr(inner, "macros", None):
        text = f'macro "{macros[0].body.getAttribute("name")}": {text}'
    if isinstance(inner, RuntimeError) and (
        lack := re.match(r"(.+): missing attribute (.+)", text)
    ):
        return f"<{lack[1]}> has no attribute {lack[2]}"
    if expression and not hasattr(inner, "suffix"):
        return f"cannot evaluate ${{{expression}}}: {text}"
    return f"xacro: {text}"


def _expression(chain: list[Exception]) -> str:
    """The innermost ``${...}`` that was being evaluated, "" if none."""
    for error in reversed(chain):
        if found := re.search(
            r"when evaluating expression '(.*)'", getattr(error, "suffix", None) or ""
        ):
            return found[1]
    return ""


def written_at(node: Any) -> str | None:
    """Where a DOM node was written: ``file:line``, with the macro calls that led there."""
    while node is not None:
        if places := node.getUserData("places"):
            calls = f" (called at {', from '.join(places[1:])})" if len(places) > 1 else ""
            return f"{places[0]}{calls}"
        node = node.parentNode
    return None


def _place(frame: FrameType) -> str | None:
    """Where the XML node that a frame of xacro works on was written."""
    if frame.f_globals.get("__name__") != "xacro":
        return None
    return written_at(frame.f_locals.get("node", frame.f_locals.get("elt")))


def _recursing(frames: list[FrameType]) -> str:
    """The macro that was expanded last."""
    for frame in reversed(frames):
        macro = frame.f_locals.get("m")
        if frame.f_code.co_name == "handle_macro_call" and macro is not None:
            return f'macro "{macro.body.getAttribute("name")}"'
    return "an expression"


def _names(frames: list[FrameType], table: str) -> list[str]:
    """The names in the innermost of xacro's tables of this kind (``symbols`` or ``macros``)."""
    for frame in reversed(frames):
        found = frame.f_locals.get(table)
        if isinstance(found, dict):
            return list(_own_names(found))
    return []


def _own_names(table: Any) -> Iterator[str]:
    """The names defined in the files: those of ``table`` and its parents but xacro's globals."""
    root = getattr(table, "root", None)
    while table is not None and table is not root and hasattr(table, "parent"):
        yield from (name for name in dict.keys(table) if not name.startswith(("*", "__")))
        table = table.parent


_MOST_BITS = 10_000  # of an integer; a double ends at 1024
_MOST_ITEMS = 100_000  # of a string, list or range; some seconds of work at the most
_SHORT = 100  # bits
_SPACES = ("math", "python")  # where xacro has its functions, beside the expression's own names


def bounded(expression: str) -> str:
    """Return an expression whose unbounded operators are calls of bounded functions.

    Raises:
        SyntaxError: it is no Python expression.
    """
    if "*" not in expression and "<<" not in expression:
        return expression
    return _bounded(expression.strip())


@functools.lru_cache(maxsize=4096)  # macros repeat theirs
def _bounded(expression: str) -> str:
    tree = ast.parse(expression, "<expression>", "eval")
    operators = _Operators()
    changed = operators.visit(tree)
    return ast.unparse(changed) if operators.found else expression


class _Operators(ast.NodeTransformer):
    """Turns operators into calls, and notes whether there were any."""

    found = False

    def visit_BinOp(self, node: ast.BinOp) -> ast.AST:
        self.generic_visit(node)
        name = _CALLS.get(type(node.op))
        if name is None:
            return node
        self.found = True
        return ast.Call(ast.Name(name, ast.Load()), [node.left, node.right], [])


def bounded_power(base: Any, exponent: Any) -> Any:
    """Return ``base ** exponent``.

    Raises:
        OverflowError: it is an integer of unreasonable size.
    """
    if isinstance(base, int) and isinstance(exponent, int) and abs(base) > 1:
        _check_bits(base.bit_length() * exponent, f"{_short(base)} ** {_short(exponent)}")
    return base**exponent


def bounded_product(left: Any, right: Any) -> Any:
    """Return ``left * right``, where one may be a string or a list.

    Raises:
        OverflowError: it is an integer, or a repetition, of unreasonable size.
    """
    if isinstance(left, int) and isinstance(right, int):
        _check_bits(left.bit_length() + right.bit_length(), "a product")
    for sequence, times in ((left, right), (right, left)):
        if isinstance(sequence, str | bytes | list | tuple) and isinstance(times, int):
            if len(sequence) * times > _MOST_ITEMS:
                kind = type(sequence).__name__
                raise OverflowError(f"a {kind} repeated {_short(times)} times is too long")
    return left * right


def bounded_shift(number: Any, bits: Any) -> Any:
    """Return ``number << bits``.

    Raises:
        OverflowError: it is an integer of unreasonable size.
    """
    if isinstance(number, int) and isinstance(bits, int) and number:
        _check_bits(number.bit_length() + bits, f"{_short(number)} << {_short(bits)}")
    return number << bits


def bound_functions(symbols: Any) -> None:
    """Bound the functions of an expression's names, and add those that ``bounded`` calls.

    Args:
        symbols: xacro's names, or those of its ``$(eval ...)``; changed in place.
    """
    for space in (symbols, *(symbols[name] for name in _SPACES if name in symbols)):
        there = {name: check for name, check in _CHECKS.items() if name in space}
        space.update({name: _checked(space[name], check) for name, check in there.items()})
    symbols.update(_FUNCTIONS)


def _checked(function: Callable[..., Any], check: Callable[..., None]) -> Callable[..., Any]:
    @functools.wraps(function)
    def checked(*values: Any, **named: Any) -> Any:
        check(*values, **named)  # the function itself refuses what it does not take
        return function(*values, **named)

    return checked


def _check_range(*bounds: Any, **_: Any) -> None:
    if all(isinstance(bound, int) for bound in bounds) and bounds and 0 not in bounds[2:]:
        if range(*bounds)[_MOST_ITEMS:]:
            raise OverflowError(f"a range of more than {_MOST_ITEMS} numbers is too long")


def _check_factorial(number: Any = 0, *_: Any, **__: Any) -> None:
    if isinstance(number, int):
        _check_bits(number * number.bit_length(), f"factorial({_short(number)})")


def _check_choices(number: Any = 0, chosen: Any = None, *_: Any, **__: Any) -> None:
    """Of comb and perm: at most ``chosen`` factors that are no larger than ``number``."""
    factors = number if chosen is None else chosen
    if isinstance(number, int) and isinstance(factors, int):
        bits = min(number, factors) * number.bit_length()
        _check_bits(bits, f"the number of choices of {_short(factors)} from {_short(number)}")


def _check_round(number: Any = 0, ndigits: Any = None, *_: Any, **__: Any) -> None:
    """Rounding an integer to -n digits computes 10**n."""
    if isinstance(number, int) and isinstance(ndigits, int) and -4 * ndigits > _MOST_BITS:
        raise OverflowError(f"round to {_short(ndigits)} digits is too much")


def _check_bits(bits: int, what: str) -> None:
    if bits > _MOST_BITS:
        raise OverflowError(f"{what} is too large a number")


def _short(number: int) -> str:
    return str(number) if number.bit_length() < _SHORT else "a large number"


_FUNCTIONS = {
    function.__name__: function for function in (bounded_power, bounded_product, bounded_shift)
}
_CALLS: dict[type[ast.operator], str] = {
    ast.Pow: bounded_power.__name__,
    ast.Mult: bounded_product.__name__,
    ast.LShift: bounded_shift.__name__,
}
_CHECKS: dict[str, Callable[..., None]] = {
    "range": _check_range,
    "factorial": _check_factorial,
    "comb": _check_choices,
    "perm": _check_choices,
    "round": _check_round,
}


_DEPTH = 10  # includes of includes; more is a circle
# Arguments that are used without being declared are arguments all the same.
_USED = re.compile(r"\$\(\s*arg\s+([^\s)]+)\s*\)|xacro\.arg\(\s*['\"]([^'\"]+)['\"]")


class XacroArgument(NamedTuple):
    """One ``<xacro:arg>``, or an argument that is used without one."""

    name: str
    default: str
    description: str  # which file declares or uses it


@dataclass(frozen=True)
class XacroArguments:
    """The arguments of a xacro file and of what it includes."""

    arguments: tuple[XacroArgument, ...] = ()  # declared ones, then those used without that
    complete: bool = True  # all includes could be followed; if not, there may be more


def xacro_arguments(source: str) -> XacroArguments:
    """Return the arguments of a xacro file, given as a path or as ``package://name/path``.

    A file that cannot be read, or an include whose name is only known when it is expanded, adds
    nothing: loading the description is what reports it.
    """
    declared: dict[str, XacroArgument] = {}
    used: dict[str, XacroArgument] = {}
    complete = True
    for file, root in _files(_path_of(source), _DEPTH):
        for element in root.iter():
            kind = _xacro_kind(element)
            if kind == "arg" and element.get("name"):
                argument = _argument(element, file)
                declared.setdefault(argument.name, argument)
            elif kind == "include" and _included(element.get("filename", ""), file) is None:
                complete = False
            for text in (element.text or "", *element.attrib.values()):
                for name in _used_arguments(text):
                    used.setdefault(name, XacroArgument(name, "", f"used in {file.name}, required"))
    return XacroArguments(tuple({**used, **declared}.values()), complete)


def included_files(source: str) -> tuple[Path, ...]:
    """Return the file itself, and those it includes as far as they can be read now."""
    file = _path_of(source).absolute()
    return tuple(dict.fromkeys([file, *(path for path, _ in _files(file, _DEPTH))]))


def _used_arguments(text: str) -> Iterator[str]:
    """Yield the arguments that ``text`` uses, as ``$(arg name)`` or ``xacro.arg('name')``."""
    for name, in_expression in _USED.findall(text):
        yield name or in_expression


def _path_of(source: str) -> Path:
    """Return the file that is meant; one that does not exist if there is no such package."""
    if not source.startswith("package://"):
        return Path(source).expanduser()
    try:
        return resolve(source, None)
    except OneBotError:
        return Path(source)


def _files(file: Path, depth: int) -> Iterator[tuple[Path, ElementTree.Element]]:
    try:
        root = ElementTree.parse(file).getroot()
    except (OSError, ElementTree.ParseError, ValueError):
        return
    yield file, root
    for element in root.iter():
        if depth and _xacro_kind(element) == "include":
            included = _included(element.get("filename", ""), file)
            if included is not None:
                yield from _files(included, depth - 1)


def _xacro_kind(element: ElementTree.Element) -> str:
    """Return ``arg`` for ``<xacro:arg>``, and "" for an element that is not xacro's."""
    if not isinstance(element.tag, str):  # a comment
        return ""
    namespace, _, name = element.tag.rpartition("}")
    return name if "xacro" in namespace else ""


def _argument(element: ElementTree.Element, file: Path) -> XacroArgument:
    default = element.get("default")
    required = "" if default is not None else ", required"
    description = f"declared in {file.name}{required}"
    return XacroArgument(element.get("name", ""), default or "", description)


def _included(name: str, file: Path) -> Path | None:
    """Return the file an include of ``name`` in ``file`` means, if that is plain."""
    if name.startswith("$(find ") and ")" in name:
        package, _, rest = name.removeprefix("$(find ").partition(")")
        try:
            name = f"{find_package(package.strip(), file.absolute().parent)}{rest}"
        except OneBotError:
            return None
    return None if "$" in name or not name else file.parent / name
