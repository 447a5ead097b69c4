"""The noise of a measured value, and its ``<noise>`` element."""

import math
from dataclasses import dataclass, fields, replace

from onebot_description.description.sensors.block import ANY, NOT_NEGATIVE, Block
from onebot_description.elements.reading import Element

_KINDS = ("none", "gaussian", "gaussian_quantized")


@dataclass(frozen=True)
class Noise:
    """Gaussian noise of one measured value, in its unit."""

    mean: float = 0.0
    stddev: float = 0.0
    bias_mean: float = 0.0  # mean of an offset drawn once, with a random sign
    bias_stddev: float = 0.0
    precision: float = 0.0  # step to which the sum is rounded; 0: no rounding

    def plus(self, stddev: float) -> "Noise":
        """Return this noise with independent noise of another ``stddev`` added."""
        return replace(self, stddev=math.hypot(self.stddev, stddev)) if stddev else self


def read_noise(block: Block, element: Element | None) -> Noise:
    """Return the noise that an element describes; none without an element."""
    if element is None:
        return Noise()
    kind = (element.get("type") or element.findtext("type") or "gaussian").strip()
    if kind not in _KINDS:
        block.problem(f'unknown noise type "{kind}"; write one of: {", ".join(_KINDS)}', element)
    if kind == "none":
        return Noise()
    values = (
        block.number(element, field.name, 0.0, ANY if "mean" in field.name else NOT_NEGATIVE)
        for field in fields(Noise)
    )
    return Noise(*values)
