"""RobotModel and the libraries it is compared with, all behind one small interface.

Of the other libraries only the computing is timed; results stay in whatever form the library has
them. Reading them out for the check is not timed, except where it computes them (yourdfpy).
"""

import importlib.util
import tempfile
import warnings
from collections.abc import Mapping
from typing import Any, ClassVar, Protocol

import numpy as np

from onebot_description.description import parse_description
from onebot_description.model import RobotModel
from onebot_description.model.quaternions import to_matrix
from tests.benchmarks.chains import Chain, Floats

TRANSFORMS, LINK_POSES = "parent to child", "links in root"
_ANY = 1_000_000  # joints
# pinocchio's Data holds four arrays of N x N x N doubles: 600 MB.
_PINOCCHIO = int((600e6 / 4 / 8) ** (1 / 3))


class Library(Protocol):
    """A way to compute a chain's transforms.

    Attributes:
        name: as it is shown.
        module: that has to be importable.
        tasks: what it can do, each with the most joints that it is asked for.
        batches: it takes many states at once.
    """

    name: ClassVar[str]
    module: ClassVar[str]
    tasks: ClassVar[Mapping[str, int]]
    batches: ClassVar[bool]

    def __init__(self, chain: Chain) -> None:
        """Read the chain's URDF."""

    def run(self, task: str, positions: Floats) -> Any:
        """Compute ``task`` for positions (N,), or (B, N); the result is for ``matrices`` only."""

    def matrices(self, task: str, result: Any) -> Floats:
        """Return a result of single positions as matrices, (N, 4, 4), a row a joint."""


class OneBot:
    """RobotModel."""

    name, module = "RobotModel", "onebot_description"
    tasks: ClassVar = {TRANSFORMS: _ANY, LINK_POSES: _ANY}
    batches = True

    def __init__(self, chain: Chain) -> None:
        self._model = RobotModel.from_description(parse_description(chain.urdf()))

    def run(self, task: str, positions: Floats) -> Any:
        if task == TRANSFORMS:
            return self._model.transforms(positions)
        return self._model.link_poses(positions)

    def matrices(self, task: str, result: Any) -> Floats:
        if task == LINK_POSES:
            result = result[1:, :3], result[1:, 3:]
        translations, rotations = result
        matrices = np.tile(np.eye(4), (len(rotations), 1, 1))
        matrices[:, :3, 3] = translations
        matrices[:, :3, :3] = to_matrix(rotations)
        return matrices


class Yourdfpy:
    """yourdfpy, with its scene graph."""

    name, module = "yourdfpy", "yourdfpy"
    # It walks from the root to each link anew: at 200 joints for 20 s a state.
    tasks: ClassVar = {TRANSFORMS: _ANY, LINK_POSES: 50}
    batches = False

    def __init__(self, chain: Chain) -> None:
        import yourdfpy

        with _file(chain) as file:
            self._robot = yourdfpy.URDF.load(file.name, load_meshes=False)
        self._links = chain.links[1:]
        self._pairs = list(zip(chain.links[1:], chain.links[:-1], strict=True))

    def run(self, task: str, positions: Floats) -> Any:
        self._robot.update_cfg(positions)
        if task == TRANSFORMS:
            return [self._robot.get_transform(child, parent) for child, parent in self._pairs]
        return [self._robot.get_transform(link) for link in self._links]

    def matrices(self, task: str, result: Any) -> Floats:
        return np.array(result)


class Pinocchio:
    """pinocchio (PyPI: pin): one call computes both tasks; its compiled code only is timed."""

    name, module = "pinocchio", "pinocchio"
    tasks: ClassVar = dict.fromkeys((TRANSFORMS, LINK_POSES), _PINOCCHIO)
    batches = False

    def __init__(self, chain: Chain) -> None:
        import pinocchio

        self._compute = pinocchio.forwardKinematics
        self._model = pinocchio.buildModelFromXML(chain.urdf())
        self._data = self._model.createData()

    def run(self, task: str, positions: Floats) -> Any:
        self._compute(self._model, self._data, positions)

    def matrices(self, task: str, result: Any) -> Floats:
        placements = self._data.liMi if task == TRANSFORMS else self._data.oMi
        return np.array([placements[row].homogeneous for row in range(1, len(placements))])


class Kinpy:
    """kinpy."""

    name, module = "kinpy", "kinpy"
    # It reads a chain by recursion.
    tasks: ClassVar = {LINK_POSES: 300}
    batches = False

    def __init__(self, chain: Chain) -> None:
        import kinpy

        self._chain = kinpy.build_chain_from_urdf(chain.urdf())
        self._links = chain.links[1:]

    def run(self, task: str, positions: Floats) -> Any:
        return self._chain.forward_kinematics(positions)

    def matrices(self, task: str, result: Any) -> Floats:
        return np.array([result[link].matrix() for link in self._links])


class Ikpy:
    """ikpy."""

    name, module = "ikpy", "ikpy"
    # It takes 0.1 s a joint to read a chain, and more the longer that is.
    tasks: ClassVar = {LINK_POSES: 50}
    batches = False

    def __init__(self, chain: Chain) -> None:
        import ikpy.chain

        with _file(chain) as file, warnings.catch_warnings():
            warnings.simplefilter("ignore")
            self._chain = ikpy.chain.Chain.from_urdf_file(file.name, base_elements=[chain.links[0]])
        # Its first link stands still, but wants a position.
        self._positions = np.zeros(len(chain.joints) + 1)

    def run(self, task: str, positions: Floats) -> Any:
        self._positions[1:] = positions
        return self._chain.forward_kinematics(self._positions, full_kinematics=True)

    def matrices(self, task: str, result: Any) -> Floats:
        return np.array(result)[1:]


OTHERS: tuple[type[Library], ...] = (Yourdfpy, Pinocchio, Kinpy, Ikpy)


def installed(library: type[Library]) -> bool:
    """Whether a library can be imported here."""
    return importlib.util.find_spec(library.module) is not None


def _file(chain: Chain) -> Any:
    """A temporary file with the chain's URDF."""
    file = tempfile.NamedTemporaryFile("w", suffix=".urdf")
    file.write(chain.urdf())
    file.flush()
    return file
