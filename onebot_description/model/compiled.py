"""The compiled way from joint positions to transforms and link poses, for many states at once.

Where the library is not built, RobotModel does the same with arrays.
"""

import ctypes
import functools
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from onebot_description.tf._type_support import TypeSupportError, load_library

Floats = NDArray[np.float64]
_POSE = 7


class _Joints(ctypes.Structure):
    """struct joints in _kinematics.c."""

    _fields_ = (
        ("count", ctypes.c_int64),
        ("half_turns", ctypes.c_void_p),
        ("constant", ctypes.c_void_p),
        ("sine", ctypes.c_void_p),
        ("slide", ctypes.c_void_p),
    )


class _Tree(ctypes.Structure):
    """struct tree in _kinematics.c."""

    _fields_ = (
        ("links", ctypes.c_int64),
        ("steps", ctypes.c_int64),
        ("root", ctypes.c_int64),
        ("parent", ctypes.c_void_p),
        ("child", ctypes.c_void_p),
        ("moving", ctypes.c_void_p),
        ("fixed", ctypes.c_void_p),
    )


class Joints:
    """M joints that move."""

    def __init__(
        self, half_turns: Floats, constant: Floats, sine: Floats, slide: Floats | None
    ) -> None:
        """Keep their arrays, see ``JointArrays``; ``slide`` is None where none slides."""
        given = (half_turns, constant, sine, slide)
        self._arrays = [None if a is None else np.ascontiguousarray(a, float) for a in given]
        addresses = [None if array is None else array.ctypes.data for array in self._arrays]
        self._structure = _Joints(len(half_turns), *addresses)
        self.address = ctypes.addressof(self._structure)

    def transforms(self, positions: Floats) -> Floats:
        """Return (..., M, 7) of positions (..., M)."""
        positions = np.ascontiguousarray(positions, float)
        poses = np.empty((*positions.shape, _POSE))
        states = math.prod(positions.shape[:-1])
        library = _library()
        assert library is not None
        library.onebot_transforms(self.address, states, positions.ctypes.data, poses.ctypes.data)
        return poses


class Tree:
    """How links hang together."""

    def __init__(
        self,
        joints: Joints,
        links: int,
        root: int,
        steps: Sequence[tuple[int, int, int]],
        fixed: Floats,
    ) -> None:
        """Keep a tree.

        Args:
            joints: those that move.
            links: how many there are, L.
            root: row of the root link.
            steps: parent link, child link, and row of the moving joint between them, or -1 - row
                of the fixed one; parents come before their children.
            fixed: (F, 7), the fixed joints' transforms.
        """
        columns = np.array(steps, np.int32).reshape(-1, 3).T.copy()
        fixed = np.ascontiguousarray(fixed, float)
        self._kept = (joints, columns, fixed)
        self._links = links
        addresses = [column.ctypes.data for column in columns]
        self._structure = _Tree(links, len(steps), root, *addresses, fixed.ctypes.data)
        self._addresses = joints.address, ctypes.addressof(self._structure)

    def poses(self, positions: Floats) -> Floats:
        """Return (..., L, 7) of positions (..., M)."""
        positions = np.ascontiguousarray(positions, float)
        batch = positions.shape[:-1]
        poses = np.empty((*batch, self._links, _POSE))
        states = math.prod(batch)
        library = _library()
        assert library is not None
        library.onebot_link_poses(
            *self._addresses, states, positions.ctypes.data, poses.ctypes.data
        )
        return poses


def available() -> bool:
    """Whether the library is built."""
    return _library() is not None


@functools.cache
def _library() -> ctypes.CDLL | None:
    """Return the library with its functions declared; None if it is not built."""
    try:
        path = load_library()._name
    except TypeSupportError:
        return None
    # Unlike a PyDLL, it lets other threads run meanwhile: a batch may take long.
    library = ctypes.CDLL(path)
    pointer, number = ctypes.c_void_p, ctypes.c_int64
    library.onebot_transforms.argtypes = [pointer, number, pointer, pointer]
    library.onebot_transforms.restype = None
    library.onebot_link_poses.argtypes = [pointer, pointer, number, pointer, pointer]
    library.onebot_link_poses.restype = None
    return library
