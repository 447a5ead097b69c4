"""Types of NumPy arrays (comments beside them say their shapes and units), and sums of numbers."""

import functools
import operator
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]
Bytes = NDArray[np.uint8]


def total(numbers: Iterable[float]) -> float:
    """Add up numbers one by one; ``sum`` rounds differently from Python 3.12 on."""
    return functools.reduce(operator.add, numbers, 0.0)
