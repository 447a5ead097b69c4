"""Gaussian noise that only depends on sensor, time and seed, so that runs are bit-identical."""

import zlib
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from onebot_description.description.sensors.noise import Noise

# Annotations with np.random are strings: evaluating them would import it for robots without noise.
T = TypeVar("T", np.float32, np.float64)

_NONE = Noise()


def noise_generator(sensor: str, tick: int, seed: int = 0) -> "np.random.Generator":
    """Return the random generator of a sensor's noise in one control cycle.

    Each cycle has a separate generator (Philox: Salmon et al., "Parallel Random Numbers: As Easy as
    1, 2, 3", 2011), so that noise does not depend on earlier measurements.

    Args:
        sensor: name of the sensor, unique in its world.
        tick: number of the control cycle; -1 for values that are drawn once.
        seed: 0 to 2^64 - 1; changes the noise of all sensors.
    """
    # The lowest of the counter's four words counts the drawn numbers; the key has two words.
    key, counter = zlib.crc32(sensor.encode()) | seed << 64, [0, tick + 1, 0, 0]
    return np.random.Generator(np.random.Philox(key=key, counter=counter))


def bias(noise: Noise, once: "np.random.Generator") -> float:
    """Draw the constant offset of a value, with the generator ``once``."""
    drawn = once.normal(noise.bias_mean, noise.bias_stddev)
    return float(drawn if once.random() < 0.5 else -drawn)


def add_noise(
    values: NDArray[T], noise: Noise, offset: float, generator: "np.random.Generator"
) -> NDArray[T]:
    """Return values with noise.

    Args:
        values: values of any shape.
        noise: parameters of the noise, in the unit of the values.
        offset: the result of ``bias``.
        generator: generator of this control cycle; see ``noise_generator``.
    """
    if noise == _NONE:
        return values
    drawn = generator.standard_normal(values.shape, np.float32)
    shift = np.float32(noise.stddev) * drawn + np.float32(noise.mean + offset)
    result: NDArray[T] = values + shift
    if noise.precision > 0.0:
        steps: NDArray[T] = np.round(result / values.dtype.type(noise.precision))
        result = steps * values.dtype.type(noise.precision)
    return result
