"""Reads CDR messages of any type by its definition, installed or not.

    schema = Schema.of("nav_msgs/msg/Path", definition)
    path = schema.read(data)
    path.header.frame_id                        # str
    path.poses.header.frame_id                  # list[str]: a sequence of messages reads by columns
    path.poses.pose.position.array()            # (N, 3)
    path.poses[0].pose.position.x               # float

The definition is the text that rosbag2 and MCAP store with messages ("ros2msg"): the type's own
.msg file, then those of the types in it, each after a line of ``=`` and ``MSG: package/Name``.
cdr.py has the format of the bytes. ``Schema.read`` checks a whole message; after that each field is
made when it is asked for. Numbers of a sequence are a view into the message, which is never copied;
structs of varying size (those with strings) are read into rows of equal size, in one compiled call.

Strings are UTF-8, what is not is replaced, as rclpy does; the characters of a wstring are UTF-16,
as Fast DDS from Jazzy on and Cyclone DDS write them. Upper bounds are not checked.
"""

import ctypes
import functools
import itertools
import math
import re
import struct
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from onebot_description.errors import did_you_mean, printable, shortened
from onebot_description.wire.cdr import ENCAPSULATION, HEADER, WireError
from onebot_description.wire.library import load_library

_NUMBERS = {
    **{"bool": "?", "byte": "u1", "char": "u1", "float32": "<f4", "float64": "<f8"},
    **{
        f"{sign}int{8 * size}": f"<{sign or 'i'}{size}"
        for sign in ("", "u")
        for size in (1, 2, 4, 8)
    },
}
_STRINGS = {"string": 1, "wstring": 2}  # bytes of a character
_KNOWN = {  # what some writers leave out
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec",
    "builtin_interfaces/Duration": "int32 sec\nuint32 nanosec",
}
_SECTION = re.compile(r"^={3,}[ \t\r]*\n(MSG|IDL):[ \t]*(\S*)[ \t\r]*(?:\n|\Z)", re.MULTILINE)
_TYPE = re.compile(r"[A-Za-z]\w*/(?:msg/)?[A-Za-z]\w*", re.ASCII)
_FIELD = re.compile(
    r"(?P<type>[A-Za-z]\w*(?:/[A-Za-z]\w*){0,2})(?:<=\d+)?"
    r"(?P<array>\[(?:(?P<size>\d+)|(?:<=\d+)?)\])?\s+(?P<name>[A-Za-z]\w*)(?![^\s=])\s*(?P<constant>=)?",
    re.ASCII,
)
# A definition may come from anywhere.
_MAX_FIELDS = 10_000
_MAX_DEPTH = 64  # of types in types
_MAX_SIZE = 2**31 - 1  # bytes
_PHASES = 8  # the largest alignment: a layout depends on where it starts modulo this


class DefinitionError(ValueError):
    """A definition that cannot be used; ``str(error)`` names the type and the line."""


# ---- Definitions ----


class _Field(NamedTuple):
    name: str
    type: str  # as in _NUMBERS or _STRINGS, or a full name of a message type
    size: int | None  # of an array; 0: as many as the message has; None: one
    where: str


def _sections(name: str, definition: str) -> dict[str, str]:
    """Split a definition into the texts of its types."""
    first, *rest = _SECTION.split(definition)
    texts = _KNOWN | {_short(kind): text for kind, text in zip(rest[1::3], rest[2::3], strict=True)}
    if first.strip() or name not in texts:
        texts[name] = first
    if "IDL" in rest[::3] or re.match(r"\s*(#include|module)\b", first):
        raise DefinitionError(f"{name}: its definition is in IDL; only .msg text can be read")
    return texts


def _short(name: str) -> str:
    return name.replace("/msg/", "/")


def _fields(kind: str, text: str) -> Iterator[_Field]:
    """Parse the .msg file of a type."""
    names = set()
    for number, line in enumerate(text.split("\n"), 1):
        line = line.partition("#")[0].strip()
        if not line:
            continue
        where = f'{kind}, line {number}: "{printable(shortened(line))}"'
        match = _FIELD.match(line)
        if match is None:
            raise DefinitionError(f"{where} is no field of a .msg file, such as `float64[3] point`")
        if match["constant"]:
            continue
        size = None if match["array"] is None else int(match["size"] or 0)
        if match["name"] in names or match["size"] and not 0 < int(match["size"]) <= _MAX_SIZE:
            what = "an earlier field has this name" if match["name"] in names else "no such size"
            raise DefinitionError(f"{where}: {what}")
        names.add(match["name"])
        yield _Field(match["name"], _full(match["type"], kind), size, where)


def _full(name: str, home: str) -> str:
    """Return the name of a type with its package, which is that of ``home`` if none is given."""
    if name in _NUMBERS or name in _STRINGS:
        return name
    return _short(name) if "/" in name else f"{home.partition('/')[0]}/{name}"


# ---- Programs, which _schema.c runs ----

_COPIED, _SEQUENCE, _STRUCTS = range(3)
_U32 = struct.Struct("<I")
_SLOT = struct.Struct("<II")  # in a row: where a sequence lies in the message, how many elements


@dataclass(frozen=True)
class _Leaf:
    """A field that is no struct, at some depth of one."""

    path: tuple[str, ...]
    dtype: np.dtype[Any] | None = None  # of a number or of several
    width: int = 0  # of a character, in a string
    program: "_Program | None" = None  # of the elements, in an array of structs or of strings
    size: int | None = None  # as of _Field

    @property
    def kind(self) -> int:
        """The kind of its operation."""
        if self.program is not None:
            return _STRUCTS
        return _COPIED if self.dtype is not None and self.size != 0 else _SEQUENCE

    @property
    def element(self) -> int:
        """Bytes of an element, to which it is aligned."""
        return self.dtype.itemsize if self.dtype else self.width

    @property
    def count(self) -> int:
        """Elements in every message; 0 of what varies."""
        return self.size if self.size is not None else int(self.kind == _COPIED)

    @property
    def boolean(self) -> bool:
        """Whether its bytes need a check."""
        return self.dtype == np.bool_

    @property
    def smallest(self) -> int:
        """Bytes in a message at least, without padding."""
        if not self.count:
            return _U32.size
        return self.count * (self.program.smallest if self.program else self.element)

    def node(self, offset: int) -> "_Node":
        """Return what reads it in a row."""
        if self.program:
            return _Structs(offset, self.program)
        if self.dtype is None:
            return _Text(offset, self.width)
        if self.size == 0:
            return _Numbers(offset, self.dtype)
        return _Number(offset, self.dtype, () if self.size is None else (self.size,))


class _Layout(NamedTuple):
    """Where the fields of structs of constant size lie in a message."""

    root: "_Group"
    stride: int


class _Program:
    """How to read structs of one type."""

    def __init__(self, kind: str, leaves: list[_Leaf], number: int) -> None:
        self.number = number
        self._kind, self._leaves = kind, leaves
        self.smallest = sum(leaf.smallest for leaf in leaves)
        [*self._offsets, self.row_size] = self._in_rows()
        if max(self.smallest, self.row_size) > _MAX_SIZE:
            raise DefinitionError(f"{kind}: its arrays are larger than two gigabytes")
        self.root = _group(kind, zip(leaves, self._offsets, strict=True))
        self._constant = all(leaf.kind == _COPIED for leaf in leaves)
        self._layouts: dict[int, _Layout | None] = {}

    def _in_rows(self) -> Iterator[int]:
        """Where the leaves lie in a row, and the size of a row."""
        at, largest = 0, 1
        for leaf in self._leaves:
            size, count = (leaf.element, leaf.count) if leaf.kind == _COPIED else (4, 2)
            at += -at % size
            yield at
            at += size * count
            largest = max(largest, size)
        yield at + -at % largest

    def layout(self, start: int) -> _Layout | None:
        """Where all lies in structs from a byte of the body on; None if that is not constant."""
        phase = start % _PHASES
        if self._constant and phase not in self._layouts:
            stride = self._stride(phase)
            places = zip(self._leaves, (place - phase for place in self._places(phase)))  # noqa: B905
            self._layouts[phase] = _Layout(_group(self._kind, places), stride) if stride else None
        return self._layouts.get(phase)

    def _stride(self, phase: int) -> int:
        """Bytes from one struct to the next; 0 if that is not constant.

        If all fields move by the same from the first to the second, that is a multiple of each
        alignment, and so it goes on.
        """
        first = self._places(phase)
        second = self._places(first[-1])
        distances = {after - before for before, after in zip(first, second, strict=True)}
        return distances.pop() if len(distances) == 1 else 0

    def _places(self, start: int) -> list[int]:
        """Where the leaves lie if the struct starts there, and where it ends."""
        places = []
        for leaf in self._leaves:
            start += -start % leaf.element
            places.append(start)
            start += leaf.element * leaf.count
        return [*places, start]

    def header(self, operations_at: int, operations: int) -> list[int]:
        """Return its ``struct program``."""
        sizes = strides = [0] * _PHASES
        if self._constant and not any(leaf.boolean for leaf in self._leaves):
            sizes = [self._places(phase)[-1] - phase for phase in range(_PHASES)]
            strides = [self._stride(phase) for phase in range(_PHASES)]
        return [operations_at, operations, self.smallest, self.row_size, *sizes, *strides]

    def operations(self) -> list[list[int]]:
        """Return each ``struct operation``; numbers of one size that lie together are one."""
        made: list[list[int]] = []
        for leaf, to in zip(self._leaves, self._offsets, strict=True):
            number = leaf.program.number if leaf.program else 0
            fixed = [leaf.kind, leaf.element, number, leaf.boolean]
            if made and leaf.kind == _COPIED and [*made[-1][:2], *made[-1][4:]] == fixed:
                made[-1][2] += leaf.count
            else:
                made.append([*fixed[:2], leaf.count, to, *fixed[2:]])
        return made


class _Compiler:
    """Makes the programs of a definition, which it numbers by the order in ``programs``."""

    def __init__(self, texts: dict[str, str]) -> None:
        self.programs: dict[str, _Program] = {}
        self._texts = texts
        self._within: list[str] = []
        self._fields = 0

    def compile(self, kind: str) -> _Program:
        """Return the program of a message type, or of ``string`` or ``wstring``."""
        if kind not in self.programs:
            text = kind in _STRINGS
            leaves = [_Leaf(("",), width=_STRINGS[kind])] if text else list(self._leaves(kind, ()))
            self.programs[kind] = _Program(kind, leaves, len(self.programs))
        return self.programs[kind]

    def _leaves(self, kind: str, path: tuple[str, ...]) -> Iterator[_Leaf]:
        self._within.append(kind)
        fields = list(_fields(kind, self._texts[kind]))
        for field in fields:
            yield from self._of_field(field, (*path, field.name))
        if not fields:  # nothing takes a byte
            yield _Leaf((*path, ""), np.dtype("u1"))
        self._within.pop()

    def _of_field(self, field: _Field, path: tuple[str, ...]) -> Iterator[_Leaf]:
        self._check(field)
        if field.type in _NUMBERS:
            yield _Leaf(path, np.dtype(_NUMBERS[field.type]), size=field.size)
        elif field.size is not None:
            yield _Leaf(path, program=self.compile(field.type), size=field.size)
        elif field.type in _STRINGS:
            yield _Leaf(path, width=_STRINGS[field.type])
        else:
            yield from self._leaves(field.type, path)

    def _check(self, field: _Field) -> None:
        self._fields += 1
        if self._fields > _MAX_FIELDS:
            raise DefinitionError(f"{field.where}: more than {_MAX_FIELDS} fields in all")
        if field.type in _NUMBERS or field.type in _STRINGS:
            return
        if field.type not in self._texts:
            raise DefinitionError(f"{field.where}: there is no definition of {field.type}")
        if field.type in self._within:
            raise DefinitionError(f"{field.where}: {field.type} contains itself")
        if len(self._within) > _MAX_DEPTH:
            raise DefinitionError(f"{field.where}: more than {_MAX_DEPTH} types in each other")


def _block(programs: Sequence[_Program]) -> bytes:
    """Return the programs as _schema.c reads them."""
    operations = [program.operations() for program in programs]
    header_size = 4 * len(programs[0].header(0, 0))
    at = header_size * len(programs)
    numbers: list[int] = []
    for program, own in zip(programs, operations, strict=True):
        numbers += program.header(at, len(own))
        at += sum(4 * len(operation) for operation in own)
    for operation in itertools.chain.from_iterable(operations):
        numbers += operation
    return np.array(numbers, np.uint32).tobytes()


# ---- What reads a field in rows ----


class _Rows(NamedTuple):
    """Structs of one type: in rows that were read by a program, or in the message itself."""

    data: bytes  # the message
    block: bytes
    rows: bytes
    at: int  # byte in ``rows`` of the first one
    stride: int
    length: int

    def slice(self, first: int, step: int, count: int) -> "_Rows":
        """Return some of them."""
        at = self.at + first * self.stride
        return _Rows(self.data, self.block, self.rows, at, step * self.stride, count)


class _Node(Protocol):
    """Reads a field, which lies ``offset`` bytes after the start of a row."""

    def value(self, rows: _Rows) -> Any:
        """Return it in the first row."""

    def column(self, rows: _Rows) -> Any:
        """Return it in all rows."""


class _Number:
    """A number or a fixed number of them."""

    def __init__(self, offset: int, dtype: np.dtype[Any], shape: tuple[int, ...]) -> None:
        self.offset, self.dtype, self.shape = offset, dtype, shape
        self._unpack = struct.Struct("<" + dtype.char.replace("l", "q").replace("L", "Q"))

    def value(self, rows: _Rows) -> Any:
        at = rows.at + self.offset
        if self.shape:
            return np.ndarray(self.shape, self.dtype, rows.rows, at)
        return self._unpack.unpack_from(rows.rows, at)[0]

    def column(self, rows: _Rows) -> NDArray[Any]:
        shape = (rows.length, *self.shape)
        if not rows.length:
            return np.empty(shape, self.dtype)
        strides = (rows.stride, self.dtype.itemsize)[: len(shape)]
        at = rows.at + self.offset
        numbers: NDArray[Any] = np.ndarray(shape, self.dtype, rows.rows, at, strides)
        return numbers


@dataclass(frozen=True)
class _Text:
    """A string."""

    offset: int
    width: int

    def value(self, rows: _Rows) -> str:
        [text] = self.column(rows.slice(0, 1, 1))
        return text

    def column(self, rows: _Rows) -> list[str]:
        place = rows.at + self.offset
        read = _compiled().onebot_read_strings
        strings: list[str] = read(rows.data, rows.rows, place, rows.stride, rows.length, self.width)
        return strings


class _Varying:
    """A sequence, or an array of structs."""

    offset: int

    def value(self, rows: _Rows) -> Any:
        raise NotImplementedError

    def _slot(self, rows: _Rows) -> tuple[int, int]:
        at, count = _SLOT.unpack_from(rows.rows, rows.at + self.offset)
        return at, count

    def column(self, rows: _Rows) -> "Sequences":
        return Sequences(self, rows)

    def counts(self, rows: _Rows) -> Any:
        count = _Number(self.offset + _U32.size, np.dtype("<u4"), ())
        return count.column(rows)


@dataclass(frozen=True)
class _Numbers(_Varying):
    offset: int
    dtype: np.dtype[Any]

    def value(self, rows: _Rows) -> NDArray[Any]:
        at, count = self._slot(rows)
        numbers: NDArray[Any] = np.ndarray((count,), self.dtype, rows.data, at)
        return numbers


@dataclass(frozen=True)
class _Structs(_Varying):
    offset: int
    program: _Program

    def value(self, rows: _Rows) -> Any:
        at, count = self._slot(rows)
        layout = self.program.layout(at - HEADER) if count else None
        if layout:
            data = rows.data
            return Table(layout.root, _Rows(data, rows.block, data, at, layout.stride, count))
        root = self.program.root
        found = _read(rows.data, rows.block, self.program, at, count)
        elements = root.fields.get("") if len(root.fields) == 1 else None
        return elements.column(found) if isinstance(elements, _Text) else Table(root, found)


class _Group:
    """A struct: one field or the whole."""

    def __init__(self, name: str, fields: dict[str, _Node]) -> None:
        self.name, self.fields = name, fields

    def value(self, rows: _Rows) -> "Message":
        return Message(self, rows)

    def column(self, rows: _Rows) -> "Table":
        return Table(self, rows)

    def find(self, path: str) -> _Node:
        """Return a field, or one of a field's: names are joined by dots.

        Raises:
            LookupError: there is none; the message lists the fields.
        """
        name, dot, rest = path.partition(".")
        node = self.fields.get(name)
        if node is None:
            raise LookupError(
                f'{self.name} has no field "{path}"{did_you_mean(name, self.fields, "fields")}'
            )
        if not dot:
            return node
        if not isinstance(node, _Group):
            raise LookupError(f'{self.name} has no field "{path}": "{name}" is no message')
        return node.find(rest)

    @functools.cached_property
    def array(self) -> _Number:
        """All its numbers, as one field.

        Raises:
            TypeError: they are of several types, or other fields lie among them.
        """
        first, *rest = self._leaves()
        end, count = first.offset, 0
        for leaf in (first, *rest):
            if not isinstance(leaf, _Number) or (leaf.dtype, leaf.offset) != (first.dtype, end):
                raise TypeError(
                    f"the fields of {self.name} are not numbers of one type, side by side"
                )
            end += leaf.dtype.itemsize * math.prod(leaf.shape)
            count += math.prod(leaf.shape)
        return _Number(first.offset, first.dtype, (count,))

    def _leaves(self) -> Iterator[Any]:
        for node in self.fields.values():
            if isinstance(node, _Group):
                yield from node._leaves()
            else:
                yield node

    def numeric_fields(self) -> Iterator[str]:
        """List the single numbers in it, by their path."""
        for name, node in self.fields.items():
            if isinstance(node, _Group):
                yield from (f"{name}.{path}" for path in node.numeric_fields())
            elif name and isinstance(node, _Number) and not node.shape:
                yield name


def _group(name: str, places: Iterable[tuple[_Leaf, int]], depth: int = 0) -> _Group:
    """Return what reads structs whose leaves lie at those bytes."""
    fields: dict[str, _Node] = {}
    for part, leaves in itertools.groupby(places, lambda place: place[0].path[depth]):
        [(leaf, offset), *others] = leaves
        if len(leaf.path) == depth + 1:
            fields[part] = leaf.node(offset)
        else:
            fields[part] = _group(f"{name}.{part}", [(leaf, offset), *others], depth + 1)
    return _Group(name, fields)


@functools.cache
def _compiled() -> ctypes.PyDLL:
    """Return the library with the functions of _schema.c."""
    library = load_library()
    size, text = ctypes.c_uint64, ctypes.c_char_p
    structs, strings = library.onebot_read_structs, library.onebot_read_strings
    structs.argtypes = [text, size, size, size, text, ctypes.c_uint32]
    strings.argtypes = [text, text, size, ctypes.c_int64, size, size]
    structs.restype = strings.restype = ctypes.py_object
    return library


def _read(data: bytes, block: bytes, program: _Program, at: int, count: int) -> _Rows:
    """Read structs from a byte of a message on.

    Raises:
        WireError: they are not there.
    """
    read = _compiled().onebot_read_structs
    rows = read(data, len(data), at, count, block, program.number)
    if rows is None:
        raise WireError(f"no {program.root.name}: it is truncated, or a bool in it is not 0 or 1")
    return _Rows(data, block, rows, 0, program.row_size, count)


# ---- Messages ----


class _View:
    """The fields of a struct, each an attribute; made when first asked for, then kept.

    ``view["pose.position.x"]`` is ``view.pose.position.x``. ``view.pose.array()``, unless a field
    has that name, returns all numbers in it as one array, whose last axis has as many as the
    struct; TypeError if they are of several types, or other fields lie among them.
    """

    def __init__(self, group: _Group, rows: _Rows) -> None:
        self._group, self._rows = group, rows

    def _get(self, node: _Node) -> Any:
        raise NotImplementedError

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        if name == "array" and name not in self._group.fields:
            return lambda: self._get(self._group.array)
        try:
            value = self.__dict__[name] = self._get(self._group.find(name))
        except LookupError as error:
            raise AttributeError(str(error)) from None
        return value

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *filter(None, self._group.fields)]


class Message(_View):
    """A message: numbers, strings, arrays, messages and, for its sequences of messages, tables."""

    def _get(self, node: _Node) -> Any:
        return node.value(self._rows)

    def __getitem__(self, path: str) -> Any:
        return self._get(self._group.find(path))

    def __repr__(self) -> str:
        return f"<{self._group.name}: {', '.join(filter(None, self._group.fields))}>"


class Table(_View):
    """Messages of one type, by columns: a field is an array of all its numbers, or a list.

    A number selects a message, a slice some of them.
    """

    def _get(self, node: _Node) -> Any:
        return node.column(self._rows)

    def __len__(self) -> int:
        return self._rows.length

    def __iter__(self) -> Iterator[Message]:
        return (self[row] for row in range(len(self)))

    def __getitem__(self, which: int | slice | str) -> Any:
        if isinstance(which, str):
            return self._get(self._group.find(which))
        chosen = range(len(self))[which]
        if isinstance(chosen, int):
            return Message(self._group, self._rows.slice(chosen, 1, 1))
        return Table(self._group, self._rows.slice(chosen.start, chosen.step, len(chosen)))

    def __repr__(self) -> str:
        fields = ", ".join(filter(None, self._group.fields))
        return f"<{len(self)} of {self._group.name}: {fields}>"


class Sequences(Sequence[Any]):
    """A sequence from each row of a table: an array, a table or a list of strings each."""

    def __init__(self, node: _Varying, rows: _Rows) -> None:
        """Show the sequences of ``node`` in ``rows``."""
        self._node, self._rows = node, rows

    def __len__(self) -> int:
        return self._rows.length

    def __getitem__(self, which: Any) -> Any:
        chosen = range(len(self))[which]
        if isinstance(chosen, int):
            return self._node.value(self._rows.slice(chosen, 1, 1))
        return Sequences(self._node, self._rows.slice(chosen.start, chosen.step, len(chosen)))

    @property
    def counts(self) -> Any:
        """Elements of each."""
        return self._node.counts(self._rows)


class Schema:
    """Reads the messages of one type."""

    def __init__(self, name: str, definition: str) -> None:
        """Compile a definition; ``Schema.of`` keeps what is compiled."""
        if not _TYPE.fullmatch(name):
            raise DefinitionError(f'"{printable(shortened(name))}" is no name of a message type')
        compiler = _Compiler(_sections(_short(name), definition))
        self._program = compiler.compile(_short(name))
        self._block = _block([*compiler.programs.values()])

    @staticmethod
    @functools.lru_cache(maxsize=256)
    def of(name: str, definition: str) -> "Schema":
        """Return the schema of a type.

        Args:
            name: such as ``sensor_msgs/msg/LaserScan``.
            definition: its text as rosbag2 and MCAP store it, with those of the types in it.

        Raises:
            DefinitionError: the definition cannot be used; the message has the type and the line.
        """
        return Schema(name, definition)

    def read(self, data: bytes) -> Message:
        """Read a message; its arrays are views into ``data``.

        Raises:
            WireError: these bytes are no such message, or not plain little-endian CDR.
        """
        if data[:2] != ENCAPSULATION[:2] or len(data) < HEADER:
            raise WireError("not plain little-endian CDR")
        program = self._program
        return Message(program.root, _read(data, self._block, program, HEADER, 1))

    def numeric_fields(self) -> tuple[str, ...]:
        """List the single numbers outside of arrays, such as ``twist.linear.x``.

        ``message[path]`` reads one.
        """
        return tuple(self._program.root.numeric_fields())
