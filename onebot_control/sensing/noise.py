"""Gaussian noise that depends on sensor, time and seed only: runs repeat to the byte."""

import zlib
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from onebot_description.description.description import Noise

# Annotations are strings where numpy would import numpy.random for them: most robots have no noise.
T = TypeVar("T", np.float32, np.float64)

_NONE = Noise()


def noise_of(sensor: str, tick: int, seed: int = 0) -> "np.random.Generator":
    """Return the generator of a sensor's noise in a control cycle; -1 is for what is drawn once.

    Each measurement has its own, so that it does not matter which ones were made. The ``seed``, 0
    to 2^64 - 1, gives all sensors other noise.
    """
    # Of the counter's four words the lowest counts the numbers drawn; the key has two words.
    key, counter = zlib.crc32(sensor.encode()) | seed << 64, [0, tick + 1, 0, 0]
    return np.random.Generator(np.random.Philox(key=key, counter=counter))


def bias(noise: Noise, once: "np.random.Generator") -> float:
    """Return the offset of a value, drawn once."""
    drawn = once.normal(noise.bias_mean, noise.bias_stddev)
    return float(drawn if once.random() < 0.5 else -drawn)


def add_noise(
    values: NDArray[T], noise: Noise, offset: float, generator: "np.random.Generator"
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
