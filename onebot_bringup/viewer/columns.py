"""Entities' paths, and columns for Rerun's ``send_columns``: arrays without its makers' checks.

One ``send_columns`` costs about as much for fifty messages as one ``rr.log`` for a single joint.
Times are those of the messages, on the timeline ``ros_time``.
"""

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
import pyarrow as pa
import rerun as rr
from numpy.typing import NDArray

TIMELINE = "ros_time"

_MANY = 65_536  # bytes: copying them takes longer than letting go of Python's memory
_STAMPS = pa.timestamp("ns")


def entity_path(*names: str) -> str:
    """Return the path of an entity, of any names."""
    return rr.new_entity_path(list(names)).lstrip("/")


class ReadyColumn(rr.ComponentColumn):
    """A column whose Arrow array is made, and can be sent many times."""

    def __init__(self, descriptor: Any, array: pa.Array) -> None:
        self._descriptor = descriptor
        self._array = array

    def component_descriptor(self) -> Any:
        """What the column is."""
        return self._descriptor

    def as_arrow_array(self) -> pa.Array:
        """A list a row."""
        return self._array


def ready(columns: rr.ComponentColumnList) -> Sequence[ReadyColumn]:
    """Return columns that need no more work when they are sent again."""
    return [ReadyColumn(item.component_descriptor(), item.as_arrow_array()) for item in columns]


class ColumnMaker:
    """Makes columns of numbers of one component."""

    def __init__(self, sample: rr.ComponentColumnList) -> None:
        [column] = ready(sample)
        self._descriptor = column.component_descriptor()
        self._rows = column.as_arrow_array().type
        item = self._rows.value_type
        self._vector = item if pa.types.is_fixed_size_list(item) else None
        self._number = item if self._vector is None else item.value_type
        self._width = 1 if self._vector is None else item.list_size
        self._dtype = pa.nulls(0, self._number).to_numpy(zero_copy_only=False).dtype

    def column(self, values: NDArray[Any], each: int = 1) -> ReadyColumn:
        """Return a column of numbers.

        Args:
            values: all numbers, row by row.
            each: components a row, of as many numbers as the component has.
        """
        array = self._numbers(values)
        return self._in_rows(array, len(array) // self._width // each, each)

    def row(self, values: NDArray[Any]) -> ReadyColumn:
        """Return a column of one row of numbers, of any number of components.

        Many numbers are not copied: nobody may write to them from now on.
        """
        if values.nbytes > _MANY and self._dtype == values.dtype and _is_ready(values):
            array = pa.Array.from_buffers(
                self._number, values.size, [None, pa.py_buffer(values.reshape(-1))]
            )
        else:
            array = self._numbers(values)
        return self._in_rows(array, 1, len(array) // self._width)

    def _numbers(self, values: NDArray[Any]) -> pa.Array:
        if self._dtype == values.dtype:
            return _array(self._number, values, self._dtype)
        with np.errstate(over="ignore"):  # too much for 32 bits: infinite
            return _array(self._number, values, self._dtype)

    def _in_rows(self, array: pa.Array, rows: int, each: int) -> ReadyColumn:
        if self._vector is not None:
            array = pa.Array.from_buffers(self._vector, rows * each, [None], children=[array])
        buffers = [None, _offsets(rows, each)]
        return ReadyColumn(
            self._descriptor, pa.Array.from_buffers(self._rows, rows, buffers, children=[array])
        )


class BytesMaker:
    """Makes columns of a component that is bytes; they are not copied."""

    def __init__(self, sample: rr.ComponentColumnList) -> None:
        [column] = ready(sample)
        self._descriptor = column.component_descriptor()
        self._rows = column.as_arrow_array().type

    def row(self, data: NDArray[np.uint8]) -> ReadyColumn:
        """Return a column of one row of bytes, which nobody may write to from now on."""
        kind = self._rows.value_type
        items = pa.Array.from_buffers(kind.value_type, len(data), [None, pa.py_buffer(data)])
        bytes_ = pa.Array.from_buffers(kind, 1, [None, _offsets(1, len(data))], children=[items])
        array = pa.Array.from_buffers(self._rows, 1, [None, _offsets(1, 1)], children=[bytes_])
        return ReadyColumn(self._descriptor, array)


def one_row(archetype: "rr.AsComponents | ReadyColumn") -> Sequence[ReadyColumn]:
    """Return an archetype as columns of one row; a column that is made already stays."""
    if isinstance(archetype, ReadyColumn):
        return [archetype]
    return [_one_row(batch) for batch in archetype.as_component_batches()]


def _one_row(batch: Any) -> ReadyColumn:
    array = batch.as_arrow_array()
    rows = pa.Array.from_buffers(
        pa.list_(array.type), 1, [None, _offsets(1, len(array))], children=[array]
    )
    return ReadyColumn(batch.component_descriptor(), rows)


def joinable(
    rows: Sequence[tuple[int, Sequence[ReadyColumn]]],
) -> list[list[tuple[int, Sequence[ReadyColumn]]]]:
    """Split consecutive rows into runs of the same columns, none of them large."""
    if len(rows) == 1:
        return [[*rows]]
    groups: list[list[tuple[int, Sequence[ReadyColumn]]]] = []
    last_kinds = None
    for row in rows:
        kinds = [column.component_descriptor() for column in row[1]]
        if any(column.as_arrow_array().nbytes > _MANY for column in row[1]):
            last_kinds = None
        elif kinds == last_kinds:
            groups[-1].append(row)
            continue
        else:
            last_kinds = kinds
        groups.append([row])
    return groups


def joined(rows: Sequence[Sequence[ReadyColumn]]) -> Sequence[ReadyColumn]:
    """Return rows of the same columns as columns of several rows."""
    if len(rows) == 1:
        return rows[0]
    return [
        ReadyColumn(
            same[0].component_descriptor(),
            pa.concat_arrays([column.as_arrow_array() for column in same]),
        )
        for same in zip(*rows, strict=True)
    ]


class StampColumn:
    """A column of times (``rr.TimeColumn`` is another)."""

    def __init__(self, timeline: str, stamps_ns: NDArray[np.int64]) -> None:
        self._timeline = timeline
        self._array = _array(_STAMPS, stamps_ns, np.dtype(np.int64))

    def timeline_name(self) -> str:
        """Of the timeline."""
        return self._timeline

    def as_arrow_array(self) -> pa.Array:
        """A time a row."""
        return self._array


def _is_ready(values: NDArray[Any]) -> bool:
    """Whether numbers lie side by side, and where Arrow wants them."""
    return bool(values.flags.c_contiguous and values.ctypes.data % 8 == 0)


def empty(shape: tuple[int, ...], dtype: Any) -> NDArray[Any]:
    """Return an array to be filled with what is logged, in memory that Arrow uses again.

    New memory from the system, as large arrays get it, takes longer than to fill it.
    """
    array: NDArray[Any] = np.frombuffer(
        pa.allocate_buffer(math.prod(shape) * np.dtype(dtype).itemsize), dtype
    )
    return array.reshape(shape)


def _array(kind: pa.DataType, values: NDArray[Any], dtype: np.dtype[Any]) -> pa.Array:
    # The memory is Arrow's own: Rerun's threads let go of Python's only with the interpreter's
    # lock, for which they and we would wait in turn.
    memory = pa.allocate_buffer(values.size * dtype.itemsize)
    np.frombuffer(memory, dtype).reshape(values.shape)[...] = values
    return pa.Array.from_buffers(kind, values.size, [None, memory])


@lru_cache(maxsize=64)
def _offsets(rows: int, each: int) -> pa.Buffer:
    """Where rows of so many components each begin."""
    return pa.array(np.arange(rows + 1, dtype=np.int32) * np.int32(each)).buffers()[1]


def time_column(stamps_ns: NDArray[np.int64]) -> StampColumn:
    """Return nanoseconds as times on our timeline."""
    return StampColumn(TIMELINE, stamps_ns)
