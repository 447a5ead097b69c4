"""What of /tf is in a Rerun recording, complete or still being written."""

import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import onebot_bringup.viewer  # noqa: F401  before Rerun, whose log it quiets

# isort: split
import numpy as np
import rerun.chunk
from numpy.typing import NDArray

from onebot_bringup.viewer.columns import TIMELINE
from onebot_bringup.viewer.displays.tf_display import TF_ENTITY


class Frames(NamedTuple):
    """Rows of an entity of transforms, in the order logged."""

    stamps_ns: NDArray[np.int64]  # (R,), nanoseconds
    parents: list[str]  # of each row
    children: list[str]  # of each row
    translations: NDArray[np.float64]  # (R, 3), m
    rotations: NDArray[np.float64]  # (R, 4), quaternion x y z w


def read_frames(file: Path) -> Frames:
    """Return what was logged of /tf, without /tf_static."""
    found = list(batches(file, f"/{TF_ENTITY}"))
    stamps = [batch.column(TIMELINE).cast("int64").to_numpy() for batch in found]
    return Frames(
        np.concatenate([np.empty(0, np.int64), *stamps]),
        [name for batch in found for name in _one_each(batch, "parent_frame").to_pylist()],
        [name for batch in found for name in _one_each(batch, "child_frame").to_pylist()],
        _numbers(found, "translation", 3),
        _numbers(found, "quaternion", 4),
    )


def _one_each(batch: Any, column: str) -> Any:
    """A column of rows that hold one thing each; one that holds none or more is an error."""
    values = batch.column(f"Transform3D:{column}").flatten()
    if len(values) != batch.num_rows:
        raise ValueError(f"{len(values)} of {column} in {batch.num_rows} rows")
    return values


def _numbers(batches: list[Any], column: str, width: int) -> NDArray[np.float64]:
    arrays = [_one_each(batch, column).flatten().to_numpy() for batch in batches]
    return np.concatenate([np.empty(0), *arrays]).reshape(-1, width)


def frames_logged(file: Path) -> set[str]:
    """Return the child frames in ``file``, which may not exist, or not be whole, yet."""
    if not file.is_file() or not file.stat().st_size:
        return set()
    try:
        return set(read_frames(file).children)
    except Exception:  # Rerun's kinds of complaint about half a file are not public
        return set()


def batches(file: Path, entity: str) -> Iterator[Any]:
    """Yield the rows of an entity, in the order logged, but for the static ones."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # it is experimental
        reader = rerun.chunk.RrdReader(str(file))
    for chunk in reader.stream():
        if str(chunk.entity_path) == entity and not chunk.is_static:
            yield chunk.to_record_batch()
