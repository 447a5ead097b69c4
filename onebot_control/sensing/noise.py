"""Gaussian noise that depends on the sensor and the time only: runs repeat to the byte."""

import zlib
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from onebot_description.description.description import Noise

T = TypeVar("T", np.float32, np.float64)

_NONE = Noise()


class NoiseSource:
    """The noise of one sensor.

    Each measurement has a generator of its own, so that it does not matter which ones were made.
    """

    def __init__(self, name: str) -> None:
        self._key = zlib.crc32(name.encode())

    def at(self, tick: int) -> np.random.Generator:
        """Return the generator of a control cycle, from 0; -1 is that of what is drawn once."""
        # Of the counter's four words the lowest counts the numbers drawn.
        return np.random.Generator(np.random.Philox(key=self._key, counter=[0, tick + 1, 0, 0]))


def bias(noise: Noise, once: np.random.Generator) -> float:
    """Return the offset of a value, drawn once."""
    drawn = once.normal(noise.bias_mean, noise.bias_stddev)
    return float(drawn if once.random() < 0.5 else -drawn)


def add_noise(
    values: NDArray[T], noise: Noise, offset: float, generator: np.random.Generator
) -> NDArray[T]:
    """Return ``values`` with noise and the offset that ``bias`` has drawn."""
    if noise == _NONE:
        return values
    drawn = generator.standard_normal(values.shape, np.float32)
    shift = np.float32(noise.stddev) * drawn + np.float32(noise.mean + offset)
    result: NDArray[T] = values + shift
    if noise.precision > 0.0:
        steps: NDArray[T] = np.round(result / values.dtype.type(noise.precision))
        result = steps * values.dtype.type(noise.precision)
    return result
