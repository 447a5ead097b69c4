"""Which bytes of a message say what its numbers belong to."""

import numpy as np
from numpy.typing import NDArray

from onebot_description.tf.wire import ENCAPSULATION, Reader


class MarkingReader(Reader):
    """Reads a message, and marks what must be the same in others to be read like it.

    Strings and lengths are; padding and numbers may hold anything.

    Attributes:
        mask: (bytes of the message,) 255 where it is marked, 0 elsewhere.
    """

    def __init__(self, data: bytes) -> None:
        """Check the encapsulation.

        Raises:
            WireError: it is not plain little-endian CDR.
        """
        super().__init__(data)
        self.mask: NDArray[np.uint8] = np.zeros(len(data), np.uint8)
        self.mask[: len(ENCAPSULATION) // 2] = 255  # the other half are options

    def u32(self) -> int:
        """Read and mark an unsigned 32-bit number, which is the length of something."""
        number = super().u32()
        self.mask[self.offset - 4 : self.offset] = 255
        return number

    def string(self) -> str:
        """Read and mark a string."""
        self.align(4)
        start = self.offset
        text = super().string()
        self.mask[start : self.offset] = 255
        return text
