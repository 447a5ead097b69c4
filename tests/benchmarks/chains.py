"""Serial chains of revolute joints, and where their links are by other means than the project's.

No two joints of a chain are alike: origins, axes and positions are drawn once and for all from a
generator with a fixed seed, so that a joint taken for another shows.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Floats = NDArray[np.float64]
_LIMIT = 3.1  # rad
_DIGITS = 6


class Chain:
    """A serial chain.

    Attributes:
        joints: their names, N of them, from the root to the tip.
        links: their names, N + 1 of them, likewise.
        xyz: (N, 3), joint origins in the parent link's frame, metres.
        rpy: (N, 3), fixed-axis roll, pitch and yaw of the origins, rad.
        axes: (N, 3), unit vectors in the joint's frame; some libraries take no others.
    """

    def __init__(self, count: int) -> None:
        draw = np.random.default_rng(count)
        self.joints = tuple(f"joint_{number}" for number in range(count))
        self.links = tuple(f"link_{number}" for number in range(count + 1))
        self.xyz = draw.uniform(-0.5, 0.5, (count, 3)).round(_DIGITS)
        self.rpy = draw.uniform(-np.pi, np.pi, (count, 3)).round(_DIGITS)
        axes = draw.normal(size=(count, 3))
        self.axes = axes / np.linalg.norm(axes, axis=1, keepdims=True)

    def positions(self, count: int) -> Floats:
        """Return ``count`` sets of positions, (count, N), rad."""
        return np.random.default_rng(1).uniform(-_LIMIT, _LIMIT, (count, len(self.joints)))

    def transforms(self, positions: Floats) -> Floats:
        """Return the parent-to-child transforms by scipy.

        Args:
            positions: (B, N), rad.

        Returns:
            (B, N, 7): translation x y z in metres, rotation quaternion x y z w.
        """
        batch, count = positions.shape
        turns = Rotation.from_rotvec((self.axes * positions[..., None]).reshape(-1, 3))
        origins = Rotation.from_euler("xyz", np.tile(self.rpy, (batch, 1)))
        result = np.empty((batch, count, 7))
        result[..., :3] = self.xyz
        result[..., 3:] = (origins * turns).as_quat().reshape(batch, count, 4)
        return result

    def link_matrices(self, positions: Floats) -> Floats:
        """Return the links' poses in the root's frame as matrices, (B, N + 1, 4, 4)."""
        batch, count = positions.shape
        steps = np.zeros((batch, count, 4, 4))
        transforms = self.transforms(positions)
        rotations = Rotation.from_quat(transforms[..., 3:].reshape(-1, 4)).as_matrix()
        steps[..., :3, :3] = rotations.reshape(batch, count, 3, 3)
        steps[..., :3, 3] = transforms[..., :3]
        steps[..., 3, 3] = 1.0
        poses = np.tile(np.eye(4), (batch, count + 1, 1, 1))
        for number in range(count):
            poses[:, number + 1] = poses[:, number] @ steps[:, number]
        return poses

    def urdf(self) -> str:
        """Return its URDF, without shapes or masses."""
        links = "".join(f'<link name="{name}"/>' for name in self.links)
        joints = "".join(self._joint(number) for number in range(len(self.joints)))
        return f'<robot name="chain">{links}{joints}</robot>\n'

    def _joint(self, number: int) -> str:
        return (
            f'<joint name="{self.joints[number]}" type="revolute">'
            f'<parent link="{self.links[number]}"/><child link="{self.links[number + 1]}"/>'
            f'<origin xyz="{_text(self.xyz[number])}" rpy="{_text(self.rpy[number])}"/>'
            f'<axis xyz="{_text(self.axes[number])}"/>'
            f'<limit lower="{-_LIMIT}" upper="{_LIMIT}" effort="1" velocity="1"/></joint>'
        )


def pose_error(poses: Floats, expected: Floats) -> float:
    """Return how far poses (..., 7) are from those expected: the largest difference of a number.

    Quaternions q and -q are the same rotation. NaN makes the error NaN.
    """
    same = (poses[..., 3:] * expected[..., 3:]).sum(axis=-1, keepdims=True)
    rotations = np.where(same < 0.0, -poses[..., 3:], poses[..., 3:])
    return float(
        np.maximum(
            np.abs(poses[..., :3] - expected[..., :3]).max(initial=0.0),
            np.abs(rotations - expected[..., 3:]).max(initial=0.0),
        )
    )


def _text(values: Floats) -> str:
    return " ".join(repr(float(value)) for value in values)
