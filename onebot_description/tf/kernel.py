"""The compiled way from joint positions to transforms, with arrays as the plain way beside it.

Both do the arithmetic of JointArrays.transforms; they differ by the rounding of sine and cosine.
Where the library is not built (a ROS installation that has tf2_msgs of its own), arrays serve.
"""

import ctypes
import functools
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from onebot_description.model.robot_model import JointArrays
from onebot_description.tf._type_support import TypeSupportError, load_library
from onebot_description.tf.wire import DOUBLES_PER_TRANSFORM, Floats, TfTemplate

# Numbers up to this size stay finite when they are multiplied and added, as transforms are made.
MODERATE = 1e100

# struct joint in _joint_transforms.h.
_JOINT = np.dtype(
    [
        ("half_turn", "f8"),
        ("multiplier", "f8"),
        ("offset", "f8"),
        ("constant", "f8", DOUBLES_PER_TRANSFORM),
        ("sine", "f8", 4),
        ("slide", "f8", 3),
        ("column", "u8"),
        ("stamp_at", "u8"),
        ("values_at", "u8"),
    ]
)


class Motion(NamedTuple):
    """How the joints of a plan follow the positions of a message.

    Attributes:
        joints: K joints.
        columns: (K,) which of the message's positions each one takes.
        multiplier, offset: (K,), of that position; radians or metres.
    """

    joints: JointArrays
    columns: NDArray[np.intp]
    multiplier: Floats
    offset: Floats


class Kernel:
    """Writes a plan's transforms; one object a plan, because it holds where all of it lies.

    Attributes:
        joints: address and number of the plan's joints, as long as this object lives.
    """

    def __init__(self, library: ctypes.PyDLL, motion: Motion, template: TfTemplate) -> None:
        """Lay ``motion`` out for the ``library``, with the places of ``template``."""
        joints = motion.joints
        rows = np.zeros(len(motion.columns), _JOINT)
        rows["half_turn"] = joints.half_turns
        rows["multiplier"], rows["offset"] = motion.multiplier, motion.offset
        rows["constant"], rows["sine"], rows["slide"] = joints.constant, joints.sine, joints.slide
        rows["column"] = motion.columns
        rows["stamp_at"], rows["values_at"] = template.stamps_at, template.values_at
        self._rows, self._template = rows, template
        self.joints = (rows.ctypes.data, len(rows))
        self._fill = library.onebot_fill_message
        self._transforms = library.onebot_joint_transforms

    def message(self, data: bytes, at: int) -> bytes:
        """Return the serialized TFMessage for a JointState.

        Args:
            data: the serialized JointState; its positions are all finite.
            at: where they begin, in bytes.
        """
        blank, size = self._template.address, self._template.size
        message = ctypes.create_string_buffer(size)
        self._fill(message, blank, size, *self.joints, data, at)
        return message.raw

    def transforms(self, positions: Floats) -> Floats:
        """(K, 7) transforms for positions in the message's order."""
        values = np.empty((len(self._rows), DOUBLES_PER_TRANSFORM))
        self._transforms(values.ctypes.data, *self.joints, positions.astype("<f8").tobytes())
        return values


def make_kernel(motion: Motion, template: TfTemplate) -> Kernel | None:
    """Return what computes ``motion`` into ``template``; None where nothing is compiled."""
    library = compiled()
    return None if library is None else Kernel(library, motion, template)


def all_moderate(data: bytes, at: int, count: int) -> bool:
    """Say whether the ``count`` doubles that begin at byte ``at`` are finite and not enormous."""
    library = compiled()
    if library is None:
        return bool((np.abs(np.frombuffer(data, "<f8", count, at)) <= MODERATE).all())
    return bool(library.onebot_all_moderate(data, at, count))


@functools.cache
def compiled() -> ctypes.PyDLL | None:
    """Return the library with its functions declared; None if it is not built."""
    try:
        library = load_library()
    except TypeSupportError:
        return None
    pointer, size, text = ctypes.c_void_p, ctypes.c_size_t, ctypes.c_char_p
    library.onebot_all_moderate.argtypes = [text, size, size]
    library.onebot_fill_message.argtypes = [pointer, pointer, size, pointer, size, text, size]
    library.onebot_fill_message.restype = None
    library.onebot_joint_transforms.argtypes = [pointer, pointer, size, text]
    library.onebot_joint_transforms.restype = None
    library.onebot_state_converter.argtypes = [ctypes.py_object]
    library.onebot_state_converter.restype = ctypes.py_object
    return library
