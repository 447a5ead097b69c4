"""Entity paths, and columns for Rerun's ``send_columns``, made without the checks of its types.

One ``send_columns`` costs about as much for fifty messages as one ``rr.log`` for a single joint.
Times are the messages', on the timeline ``ros_time``.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache
from itertools import groupby
from typing import Any

import numpy as np
import pyarrow as pa
import rerun as rr
from numpy.typing import NDArray

TIMELINE = "ros_time"

_MANY = 65_536  # bytes above which copying costs more than releasing Python's memory
_STAMPS = pa.timestamp("ns")


def entity_path(*names: str) -> str:
    """Return the path of an entity from its parts, which may contain any characters."""
    return rr.new_entity_path(list(names)).lstrip("/")


def below(root: str, entity: str) -> str:
    """Return the path of ``entity`` below ``root``, which is "" for the top."""
    return f"{root}/{entity}" if root else entity


class ReadyColumn(rr.ComponentColumn):
    """A column with a finished Arrow array, which can be sent many times."""

    def __init__(self, descriptor: Any, array: pa.Array) -> None:
        self._descriptor = descriptor
        self._array = array

    def component_descriptor(self) -> Any:
        """Return the descriptor of the column's component."""
        return self._descriptor

    def as_arrow_array(self) -> pa.Array:
        """Return the array, one list per row."""
        return self._array


def ready(columns: rr.ComponentColumnList) -> Sequence[ReadyColumn]:
    """Convert columns to ones that need no more work when they are sent again."""
    return [ReadyColumn(item.component_descriptor(), item.as_arrow_array()) for item in columns]


class ColumnMaker:
    """Makes columns of one numeric component."""

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
            each: instances of the component per row.
        """
        array = self._numbers(values)
        return self._in_rows(array, len(array) // self._width // each, each)

    def row(self, values: NDArray[Any]) -> ReadyColumn:
        """Return a column of one row with any number of instances.

        Large arrays are not copied: do not write to ``values`` afterwards.
        """
        if (
            values.nbytes > _MANY
            and values.dtype == self._dtype
            and values.flags.c_contiguous
            and values.ctypes.data % 8 == 0  # aligned, as Arrow wants them
        ):
            array = pa.array(values.reshape(-1), self._number)
        else:
            array = self._numbers(values)
        return self._in_rows(array, 1, len(array) // self._width)

    def _numbers(self, values: NDArray[Any]) -> pa.Array:
        with np.errstate(over="ignore"):  # too large for float32: infinite
            return _array(self._number, values, self._dtype)

    def _in_rows(self, array: pa.Array, rows: int, each: int) -> ReadyColumn:
        if self._vector is not None:
            array = pa.Array.from_buffers(self._vector, rows * each, [None], children=[array])
        return ReadyColumn(self._descriptor, _lists(self._rows, array, rows, each))


def bytes_maker(sample: rr.ComponentColumnList) -> Callable[[NDArray[np.uint8]], ReadyColumn]:
    """Return a function that makes columns of one row of bytes, without copying them."""
    [column] = ready(sample)
    rows = column.as_arrow_array().type

    def row(data: NDArray[np.uint8]) -> ReadyColumn:
        bytes_ = _lists(rows.value_type, pa.array(data), 1, len(data))
        return ReadyColumn(column.component_descriptor(), _lists(rows, bytes_, 1, 1))

    return row


def one_row(archetype: "rr.AsComponents | ReadyColumn") -> Sequence[ReadyColumn]:
    """Return an archetype as columns of one row; a ReadyColumn is passed through."""
    if isinstance(archetype, ReadyColumn):
        return [archetype]
    return [_one_row(batch) for batch in archetype.as_component_batches()]


def _one_row(batch: Any) -> ReadyColumn:
    array = batch.as_arrow_array()
    rows = _lists(pa.list_(array.type), array, 1, len(array))
    return ReadyColumn(batch.component_descriptor(), rows)


def batches(
    rows: Sequence[tuple[int, Sequence[ReadyColumn]]],
) -> Iterator[tuple[Sequence[int], Sequence[ReadyColumn]]]:
    """Join consecutive rows of the same columns; a large row stays alone.

    Args:
        rows: the time of each row, nanoseconds, and its columns.

    Yields:
        The times of some rows, and their columns.
    """
    if len(rows) == 1:
        [(stamp_ns, columns)] = rows
        yield [stamp_ns], columns
        return

    def kind(row: tuple[int, Sequence[ReadyColumn]]) -> object:
        if any(column.as_arrow_array().nbytes > _MANY for column in row[1]):
            return object()  # equals no other
        return [column.component_descriptor() for column in row[1]]

    for _, group in groupby(rows, kind):
        stamps_ns, of_rows = zip(*group, strict=True)
        yield stamps_ns, [_joined(same) for same in zip(*of_rows, strict=True)]


def _joined(rows: Sequence[ReadyColumn]) -> ReadyColumn:
    if len(rows) == 1:
        return rows[0]
    array = pa.concat_arrays([row.as_arrow_array() for row in rows])
    return ReadyColumn(rows[0].component_descriptor(), array)


class TimeColumn:
    """A column of times on our timeline, like ``rr.TimeColumn`` but without its checks."""

    def __init__(self, stamps_ns: NDArray[np.int64]) -> None:
        self._array = _array(_STAMPS, stamps_ns, np.dtype(np.int64))

    def timeline_name(self) -> str:
        """Return the name of the timeline."""
        return TIMELINE

    def as_arrow_array(self) -> pa.Array:
        """Return the array, one time per row."""
        return self._array


def empty(shape: tuple[int, ...], dtype: Any) -> NDArray[Any]:
    """Return an uninitialized array for data to be logged, in memory that Arrow reuses.

    For large arrays, getting new memory from the system takes longer than filling it.
    """
    array: NDArray[Any] = np.frombuffer(
        pa.allocate_buffer(math.prod(shape) * np.dtype(dtype).itemsize), dtype
    )
    return array.reshape(shape)


def _array(kind: pa.DataType, values: NDArray[Any], dtype: np.dtype[Any]) -> pa.Array:
    # The memory is Arrow's own: Rerun's threads can release Python's only while they hold the
    # interpreter lock, for which they and we would wait in turn.
    memory = pa.allocate_buffer(values.size * dtype.itemsize)
    np.frombuffer(memory, dtype).reshape(values.shape)[...] = values
    return pa.Array.from_buffers(kind, values.size, [None, memory])


def _lists(kind: pa.DataType, items: pa.Array, rows: int, each: int) -> pa.Array:
    """Return an array of ``rows`` lists with ``each`` of the items in every one."""
    return pa.Array.from_buffers(kind, rows, [None, _offsets(rows, each)], children=[items])


@lru_cache(maxsize=64)
def _offsets(rows: int, each: int) -> pa.Buffer:
    """Return the offsets at which rows of ``each`` instances begin."""
    return pa.array(np.arange(rows + 1, dtype=np.int32) * np.int32(each)).buffers()[1]


def send(
    recording: rr.RecordingStream,
    entity: str,
    stamps_ns: Sequence[int] | NDArray[np.int64],
    columns: Sequence[ReadyColumn],
) -> None:
    """Log columns, a row for each stamp (nanoseconds)."""
    times = TimeColumn(np.asarray(stamps_ns, np.int64))
    recording.send_columns(entity, indexes=[times], columns=columns)
