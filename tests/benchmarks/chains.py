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
        frames: parent and child link of each joint.
    """

    def __init__(self, count: int) -> None:
        draw = np.random.default_rng(count)
        self.joints = [f"joint_{number}" for number in range(count)]
        self.frames = [(f"link_{number}", f"link_{number + 1}") for number in range(count)]
        self._xyz = draw.uniform(-0.5, 0.5, (count, 3)).round(_DIGITS)
        self._rpy = draw.uniform(-np.pi, np.pi, (count, 3)).round(_DIGITS)
        axes = draw.normal(size=(count, 3))
        self._axes = axes / np.linalg.norm(axes, axis=1, keepdims=True)

    def positions(self, count: int) -> Floats:
        """Return ``count`` sets of positions, (count, N), rad."""
        return np.random.default_rng(1).uniform(-_LIMIT, _LIMIT, (count, len(self.joints)))

    def transforms(self, positions: Floats) -> Floats:
        """Return the parent-to-child transforms by scipy.

        Args:
            positions: (B, N), rad.

        Returns:
            (B, N, 7): translation x y z in meters, rotation quaternion x y z w.
        """
        batch, count = positions.shape
        turns = Rotation.from_rotvec((self._axes * positions[..., None]).reshape(-1, 3))
        origins = Rotation.from_euler("xyz", np.tile(self._rpy, (batch, 1)))
        result = np.empty((batch, count, 7))
        result[..., :3] = self._xyz
        result[..., 3:] = (origins * turns).as_quat().reshape(batch, count, 4)
        return result

    def urdf(self) -> str:
        """Return its URDF, without shapes or masses."""
        links = "".join(f'<link name="link_{k}"/>' for k in range(len(self.joints) + 1))
        joints = "".join(
            f'<joint name="{joint}" type="revolute"><parent link="{parent}"/>'
            f'<child link="{child}"/><origin xyz="{_text(xyz)}" rpy="{_text(rpy)}"/>'
            f'<axis xyz="{_text(axis)}"/>'
            f'<limit lower="{-_LIMIT}" upper="{_LIMIT}" effort="1" velocity="1"/></joint>'
            for joint, (parent, child), xyz, rpy, axis in zip(
                self.joints, self.frames, self._xyz, self._rpy, self._axes, strict=True
            )
        )
        return f'<robot name="chain">{links}{joints}</robot>\n'


def _text(values: Floats) -> str:
    return " ".join(map(repr, values.tolist()))
