"""Reads CDR messages of any type from its definition, installed or not.

    schema = Schema.from_definition("nav_msgs/msg/Path", definition)
    path = schema.read(data)
    path.header.frame_id                        # str
    path.poses.header.frame_id                  # list[str]: a sequence of messages reads by columns
    path.poses.pose.position.array()            # (N, 3)
    path.poses[0].pose.position.x               # float

definition.py describes the format of the definition, cdr.py that of the bytes. ``Schema.read``
checks a whole message; each field is then created on demand. Numbers of a sequence are a view into
the message, which is never copied; structs of varying size (those with strings) are read into rows
of equal size, in one compiled call.

Strings are UTF-8, and invalid bytes are replaced, as in rclpy; the characters of a wstring are
UTF-16, as written by Fast DDS since Jazzy and by Cyclone DDS. Upper bounds are not checked.
"""

import ctypes
import functools
import itertools
import math
import struct
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, NamedTuple, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from onebot_description.compiled.library import load_library
from onebot_description.errors import did_you_mean
from onebot_description.ros.wire.cdr import ENCAPSULATION, HEADER, WireError
from onebot_description.ros.wire.definition import (
    NUMBERS,
    STRINGS,
    DefinitionError,
    Field,
    fields,
    files,
    short_name,
)

_V = TypeVar("_V", bound="_View")

# A definition may come from anywhere.
_MAX_FIELDS = 10_000
_MAX_DEPTH = 64  # types in types
_MAX_SIZE = 2**31 - 1  # bytes
_PLAIN = ENCAPSULATION[:2]  # the other two bytes are options, which receivers ignore
_PHASES = 8  # the largest alignment: a layout depends on its start modulo this


# ---- Readers of fields ----

_COPIED, _SEQUENCE, _STRUCTS = range(3)  # kinds of operations
_SLOT = struct.Struct("<II")  # position of a sequence in the message, and its length


class _Rows(NamedTuple):
    """Structs of one type: in rows that a program has read, or in the message."""

    data: bytes  # the message
    block: bytes  # the programs
    rows: bytes
    at: int  # byte of the first struct in ``rows``
    stride: int
    length: int

    def chosen(self, which: range) -> "_Rows":
        """Return some of the structs."""
        at, stride = self.at + which.start * self.stride, which.step * self.stride
        return _Rows(self.data, self.block, self.rows, at, stride, len(which))


class _Leaf:
    """A field that is not a struct; its place in a row is given as ``offset``."""

    kind = _SEQUENCE
    count = 0  # elements in every message, 0 if that varies
    smallest = 4  # minimum number of bytes in a message, without padding
    boolean = False  # whether bytes need a check
    dtype: np.dtype[Any] | None = None  # type of the elements, if they are numbers
    program: "_Program | None" = None  # program of the elements, if they are structs

    def __init__(self, element: int) -> None:
        self.element = element  # bytes of an element, which are also its alignment

    def value(self, rows: _Rows, offset: int) -> Any:
        """Return the value in the first row."""
        raise NotImplementedError

    def column(self, rows: _Rows, offset: int) -> Any:
        """Return the values in all rows."""
        return Sequences(self, rows, offset)


class _Number(_Leaf):
    """A number, or an array of fixed size."""

    kind = _COPIED
    dtype: np.dtype[Any]

    def __init__(self, dtype: np.dtype[Any], shape: tuple[int, ...] = ()) -> None:
        super().__init__(dtype.itemsize)
        self.dtype, self.shape, self.count = dtype, shape, math.prod(shape)
        self.smallest, self.boolean = self.count * self.element, dtype == np.bool_
        self._unpack = struct.Struct("<" + dtype.char.translate(_STANDARD)).unpack_from

    def value(self, rows: _Rows, offset: int) -> Any:
        if self.shape:
            return np.ndarray(self.shape, self.dtype, rows.rows, rows.at + offset)
        return self._unpack(rows.rows, rows.at + offset)[0]

    def column(self, rows: _Rows, offset: int) -> Any:
        shape = (rows.length, *self.shape)
        if not rows.length:
            return np.empty(shape, self.dtype)
        strides = (rows.stride, self.element)[: len(shape)]
        return np.ndarray(shape, self.dtype, rows.rows, rows.at + offset, strides)


_STANDARD = str.maketrans("lL", "qQ")  # NumPy's letters with another meaning in ``struct``
_COUNT = _Number(np.dtype("<u4"))


class _Text(_Leaf):
    """A string; ``element``: bytes per character."""

    def value(self, rows: _Rows, offset: int) -> str:
        return self._read(rows, offset, 1)[0]

    def column(self, rows: _Rows, offset: int) -> list[str]:
        return self._read(rows, offset, rows.length)

    def _read(self, rows: _Rows, offset: int, count: int) -> list[str]:
        reader, at = _compiled().onebot_read_strings, rows.at + offset
        strings: list[str] = reader(rows.data, rows.rows, at, rows.stride, count, self.element)
        return strings


class _Numbers(_Leaf):
    """A sequence of numbers."""

    def __init__(self, dtype: np.dtype[Any]) -> None:
        super().__init__(dtype.itemsize)
        self.dtype, self.boolean = dtype, dtype == np.bool_

    def value(self, rows: _Rows, offset: int) -> Any:
        at, count = _SLOT.unpack_from(rows.rows, rows.at + offset)
        return np.ndarray((count,), self.dtype, rows.data, at)


class _Structs(_Leaf):
    """A sequence or an array of structs, or of strings."""

    kind = _STRUCTS

    def __init__(self, program: "_Program", count: int) -> None:
        super().__init__(1)
        self.program, self.count = program, count
        self.smallest = count * program.smallest or _Leaf.smallest

    def value(self, rows: _Rows, offset: int) -> Any:
        at, count = _SLOT.unpack_from(rows.rows, rows.at + offset)
        assert self.program is not None
        return self.program.table(rows.data, rows.block, at, count)


class _Group:
    """A struct, nested or top-level."""

    def __init__(self, name: str, leaves: Iterable[tuple[tuple[str, ...], _Leaf, int]]) -> None:
        self.name, self.leaves = name, list(leaves)
        self.fields: dict[str, tuple[_Leaf | _Group, int]] = {}
        for field, group in itertools.groupby(self.leaves, lambda leaf: leaf[0][0]):
            inner = [(path[1:], leaf, offset) for path, leaf, offset in group]
            path, leaf, offset = inner[0]
            self.fields[field] = (_Group(f"{name}.{field}", inner), 0) if path else (leaf, offset)

    def value(self, rows: _Rows, offset: int = 0) -> "Message":
        """Return the first row."""
        return self._message(rows)

    def column(self, rows: _Rows, offset: int = 0) -> "Table":
        """Return all rows."""
        return self._table(rows)

    @functools.cached_property
    def _message(self) -> "type[Message]":
        return self._view(Message)

    @functools.cached_property
    def _table(self) -> "type[Table]":
        return self._view(Table)

    def _view(self, base: "type[_V]") -> "type[_V]":
        """Return a class of views with an attribute for each field."""
        attributes = {name: _Attribute(name, *field) for name, field in self.fields.items()}
        return cast("type[_V]", type(base.__name__, (base,), {**attributes, "_group": self}))

    def find(self, path: str) -> tuple["_Leaf | _Group", int]:
        """Return a field, or a field within fields by its path with dots."""
        name, dot, inner = path.partition(".")
        if name not in self.fields:
            hint = did_you_mean(name, filter(None, self.fields), "fields")
            raise LookupError(f'{self.name} has no field "{name}"{hint}')
        field = self.fields[name]
        if not dot:
            return field
        if not isinstance(field[0], _Group):
            raise LookupError(f'{self.name}.{name} has no field "{inner}": it is not a message')
        return field[0].find(inner)

    @functools.cached_property
    def array(self) -> tuple[_Number, int]:
        """All its numbers as one field; TypeError if types differ or they are not adjacent."""
        _, leaves, offsets = zip(*self.leaves, strict=True)
        [dtype, *other_dtypes] = {leaf.dtype if leaf.kind == _COPIED else None for leaf in leaves}
        *places, end = itertools.accumulate((leaf.smallest for leaf in leaves), initial=offsets[0])
        if other_dtypes or dtype is None or places != [*offsets]:
            raise TypeError(f"the fields of {self.name} are not adjacent numbers of one type")
        return _Number(dtype, ((end - places[0]) // dtype.itemsize,)), places[0]


# ---- Programs, which _schema.c runs ----


def _places(parts: Iterable[tuple[int, int]], at: int) -> list[int]:
    """Return the aligned positions of parts of (size, count) after ``at``, and their end."""
    places = []
    for size, count in parts:
        at += -at % size
        places.append(at)
        at += size * count
    return [*places, at]


class _Program:
    """A program that reads structs of one type."""

    def __init__(self, name: str, leaves: dict[tuple[str, ...], _Leaf], number: int) -> None:
        self.number = number
        self._name, self._leaves = name, leaves
        self.smallest = sum(leaf.smallest for leaf in leaves.values())
        inner = (leaf.program.depth for leaf in leaves.values() if leaf.program)
        self.depth: int = 1 + max(inner, default=0)  # arrays in arrays: _schema.c calls itself
        self._on_wire = [(leaf.element, leaf.count) for leaf in leaves.values()]
        self._constant = all(leaf.kind == _COPIED for leaf in leaves.values())
        in_row = [(e.element, e.count) if e.kind == _COPIED else (4, 2) for e in leaves.values()]
        [*self._offsets, end] = _places(in_row, 0)
        self.row_size = end + -end % max(size for size, _ in in_row)
        if max(self.smallest, self.row_size) > _MAX_SIZE:
            raise DefinitionError(f"{name}: its arrays are larger than two gigabytes")
        if self.depth > _MAX_DEPTH:
            raise DefinitionError(f"{name}: types are nested more than {_MAX_DEPTH} deep")
        self.root = self._group(self._offsets)
        self._strides = [self._stride(phase) for phase in range(_PHASES)]
        self._layouts: dict[int, _Group] = {}

    def _group(self, offsets: list[int]) -> _Group:
        return _Group(self._name, zip(self._leaves, self._leaves.values(), offsets, strict=True))

    def _stride(self, phase: int) -> int:
        """Return the bytes from a struct at ``phase`` to the next one; 0 if they vary.

        If all fields of the second struct have the same distance from those of the first, this
        distance is a multiple of each alignment, so all later structs follow at the same distance.
        """
        first = _places(self._on_wire, phase)
        second = _places(self._on_wire, first[-1])
        distances = {next_place - place for place, next_place in zip(first, second, strict=True)}
        return distances.pop() if self._constant and len(distances) == 1 else 0

    def table(self, data: bytes, block: bytes, at: int, count: int) -> "Table | list[str]":
        """Return the structs from byte ``at`` of a message, in place if the stride is constant."""
        phase = (at - HEADER) % _PHASES
        stride = self._strides[phase]
        if not count or not stride:
            rows = self.read(data, block, at, count)
            text, offset = self.root.fields.get("", (None, 0))
            return text.column(rows, offset) if isinstance(text, _Text) else self.root.column(rows)
        if phase not in self._layouts:
            places = _places(self._on_wire, phase)[:-1]
            self._layouts[phase] = self._group([place - phase for place in places])
        return self._layouts[phase].column(_Rows(data, block, data, at, stride, count))

    def read(self, data: bytes, block: bytes, at: int, count: int) -> _Rows:
        """Read structs into rows; raise WireError if they are missing."""
        reader = _compiled().onebot_read_structs
        rows = reader(data, len(data), at, count, block, self.number)
        if rows is None:
            raise WireError(f"not a {self._name}: it is truncated, or a bool in it is not 0 or 1")
        return _Rows(data, block, rows, 0, self.row_size, count)

    def header(self, operations_at: int, operations: int) -> list[int]:
        """Return its ``struct program``."""
        strides = self._strides
        if any(leaf.boolean for leaf in self._leaves.values()):
            strides = [0] * _PHASES
        sizes = [_places(self._on_wire, phase)[-1] - phase for phase in range(_PHASES)]
        return [operations_at, operations, self.smallest, self.row_size, *sizes, *strides]

    def operations(self) -> list[list[int]]:
        """Return each ``struct operation``; adjacent numbers of one size are one operation."""
        steps: list[list[int]] = []
        for leaf, to in zip(self._leaves.values(), self._offsets, strict=True):
            number = leaf.program.number if leaf.program else 0
            fixed = [leaf.kind, leaf.element, number, int(leaf.boolean)]
            if steps and leaf.kind == _COPIED and [*steps[-1][:2], *steps[-1][4:]] == fixed:
                steps[-1][2] += leaf.count
            else:
                steps.append([*fixed[:2], leaf.count, to, *fixed[2:]])
        return steps


class _Compiler:
    """Compiles the programs of a definition, numbered by their order in ``programs``."""

    def __init__(self, texts: dict[str, str]) -> None:
        self.programs: dict[str, _Program] = {}
        self._files = texts
        self._within: list[str] = []
        self._fields = 0

    def compile(self, kind: str) -> _Program:
        """Return the program of a message type, or of ``string`` or ``wstring``."""
        if kind not in self.programs:
            text = [(("",), _Text(STRINGS[kind]))] if kind in STRINGS else None
            leaves = dict(text or self._leaves(kind, ()))
            self.programs[kind] = _Program(kind, leaves, len(self.programs))
        return self.programs[kind]

    def _leaves(self, kind: str, path: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], _Leaf]]:
        self._within.append(kind)
        lines = list(fields(kind, self._files[kind]))
        for field in lines:
            self._check(field)
            inner = (*path, field.name)
            if field.size is None and field.type not in (*NUMBERS, *STRINGS):
                yield from self._leaves(field.type, inner)
            else:
                yield inner, self._leaf(field)
        if not lines:  # an empty struct takes a byte
            yield (*path, ""), _Number(np.dtype("u1"))
        self._within.pop()

    def _leaf(self, field: Field) -> _Leaf:
        if field.type in NUMBERS:
            dtype = np.dtype(NUMBERS[field.type])
            if field.size == 0:
                return _Numbers(dtype)
            return _Number(dtype, () if field.size is None else (field.size,))
        if field.size is None:
            return _Text(STRINGS[field.type])
        return _Structs(self.compile(field.type), field.size)

    def _check(self, field: Field) -> None:
        self._fields += 1
        problem = None
        if self._fields > _MAX_FIELDS:
            problem = f"more than {_MAX_FIELDS} fields in total"
        elif field.type not in (*NUMBERS, *STRINGS, *self._files):
            problem = f"there is no definition of {field.type}"
        elif field.type in self._within:
            problem = f"{field.type} contains itself"
        elif len(self._within) > _MAX_DEPTH:
            problem = f"types are nested more than {_MAX_DEPTH} deep"
        if problem:
            raise DefinitionError(f"{field.where}: {problem}")


def _block(programs: Sequence[_Program]) -> bytes:
    """Return all ``struct program``, then their operations, as _schema.c reads them."""
    operations = [program.operations() for program in programs]
    at = 4 * len(programs) * len(programs[0].header(0, 0))
    numbers: list[int] = []
    for program, program_operations in zip(programs, operations, strict=True):
        numbers += program.header(at, len(program_operations))
        at += sum(4 * len(operation) for operation in program_operations)
    numbers += itertools.chain.from_iterable(itertools.chain.from_iterable(operations))
    return np.array(numbers, np.uint32).tobytes()


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


# ---- Messages ----


class _Attribute:
    """A field of a view, created on first use, then kept."""

    def __init__(self, name: str, leaf: _Leaf | _Group, offset: int) -> None:
        self._name, self._leaf, self._offset = name, leaf, offset

    def __get__(self, view: Any, owner: type) -> Any:
        if view is None:
            return self
        value = view._get(self._leaf, self._offset)
        setattr(view, self._name, value)  # Python finds this first from now on
        return value


class _View:
    """The fields of a struct, each an attribute; there is a class for each struct.

    ``view["pose.position.x"]`` is ``view.pose.position.x``.
    """

    _group: _Group

    def __init__(self, rows: _Rows) -> None:
        self._rows = rows

    def _get(self, leaf: _Leaf | _Group, offset: int) -> Any:
        return leaf.value(self._rows, offset)

    def __getattr__(self, name: str) -> Any:
        try:
            return self[name]
        except LookupError as error:
            raise AttributeError(str(error)) from None

    def __getitem__(self, path: Any) -> Any:
        return self._get(*self._group.find(path))

    def array(self) -> NDArray[Any]:
        """Return all its numbers as one array, with those of one struct in the last axis.

        A field with this name hides the method.
        """
        numbers: NDArray[Any] = self._get(*self._group.array)
        return numbers

    def __repr__(self) -> str:
        return f"<{self._group.name}: {', '.join(filter(None, self._group.fields))}>"


class Message(_View):
    """A message: numbers, strings, arrays, messages and, for its sequences of messages, tables."""


class Table(_View):
    """Messages of one type, by columns: a field is an array of all its numbers, or a list.

    An index selects one message, a slice several.
    """

    def _get(self, leaf: _Leaf | _Group, offset: int) -> Any:
        return leaf.column(self._rows, offset)

    def __len__(self) -> int:
        return self._rows.length

    def __iter__(self) -> Iterator[Message]:
        return (self[row] for row in range(len(self)))

    def __getitem__(self, which: int | slice | str) -> Any:
        if isinstance(which, str):
            return super().__getitem__(which)
        chosen = range(len(self))[which]
        if isinstance(chosen, range):
            return type(self)(self._rows.chosen(chosen))
        return self._group.value(self._rows.chosen(range(chosen, chosen + 1)))


class Sequences(Sequence[Any]):
    """A sequence from each row of a table: an array, a table or a list of strings each."""

    def __init__(self, leaf: _Leaf, rows: _Rows, offset: int) -> None:
        self._leaf, self._rows, self._offset = leaf, rows, offset

    def __len__(self) -> int:
        return self._rows.length

    def __getitem__(self, which: Any) -> Any:
        chosen = range(len(self))[which]
        if isinstance(chosen, range):
            return Sequences(self._leaf, self._rows.chosen(chosen), self._offset)
        return self._leaf.value(self._rows.chosen(range(chosen, chosen + 1)), self._offset)

    @property
    def counts(self) -> NDArray[np.uint32]:
        """The number of elements of each sequence."""
        counts: NDArray[np.uint32] = _COUNT.column(self._rows, self._offset + 4)
        return counts


class Schema:
    """Reads the messages of one type."""

    def __init__(self, name: str, definition: str) -> None:
        name = short_name(name)
        compiler = _Compiler(files(name, definition))
        self._program = compiler.compile(name)
        self._block = _block([*compiler.programs.values()])

    @staticmethod
    @functools.lru_cache(maxsize=256)
    def from_definition(name: str, definition: str) -> "Schema":
        """Return the schema of a type such as ``sensor_msgs/msg/LaserScan``.

        ``definition`` is its text as rosbag2 and MCAP store it, with those of the types in it.
        Raises DefinitionError, with the type and the line.
        """
        return Schema(name, definition)

    def read(self, data: bytes) -> Message:
        """Read a message; its arrays are views into ``data``.

        Raises WireError for bytes that are not such a message, or not plain little-endian CDR.
        """
        return self._program.root.value(self._rows(data))

    def read_table(self, data: bytes) -> Table:
        """Read a message as ``read`` does, as a table of one row."""
        return self._program.root.column(self._rows(data))

    def _rows(self, data: bytes) -> _Rows:
        if not data.startswith(_PLAIN):
            raise WireError("not plain little-endian CDR")
        return self._program.read(data, self._block, HEADER, 1)

    @property
    def program(self) -> tuple[bytes, int]:
        """The programs, and the number of the message's own: ``struct program`` in _program.h."""
        return self._block, self._program.number

    def numeric_fields(self) -> tuple[str, ...]:
        """Return the names of single numbers outside arrays, such as ``twist.linear.x``.

        ``message[path]`` reads one.
        """
        return tuple(
            ".".join(path)
            for path, leaf, _ in self._program.root.leaves
            if path[-1] and isinstance(leaf, _Number) and not leaf.shape
        )
