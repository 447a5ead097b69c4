"""The numbers that Rerun can draw, and how often data is logged to it."""

import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

# A server with a memory limit drops the oldest data. Data that seldom changes is logged again this
# often (seconds), so that it is never the oldest.
REPEAT_AFTER = 10.0
# Nanoseconds between calls into Rerun for data that is not urgent: each call costs a kilobyte in
# the file and in the server's memory, and work for a page that draws slowly.
SELDOM = 200_000_000
LARGEST = 1e38  # largest drawable number: finite as float32, and its square finite as float64


def is_old(logged_at: float) -> bool:
    """Whether data logged at this time (of ``time.monotonic``) should be logged again."""
    return time.monotonic() - logged_at > REPEAT_AFTER


def is_drawable(numbers: NDArray[Any]) -> bool:
    """Whether all numbers are finite and at most LARGEST."""
    return bool((np.abs(numbers) <= LARGEST).all())


def drawable(rows: NDArray[Any]) -> NDArray[Any]:
    """Return the rows of ``rows`` (N, k) whose numbers are all finite and at most LARGEST."""
    finite: NDArray[Any] = rows[(np.abs(rows) <= LARGEST).all(axis=1)]
    return finite
