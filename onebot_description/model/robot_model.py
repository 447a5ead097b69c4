"""Forward kinematics of all joints together, as arrays, in compiled code.

A joint's transform is its fixed origin followed by its motion, and depends on no other joint, so
/tf needs no traversal of the tree. For a revolute joint with origin rotation q0 and axis a (in the
joint frame), the rotation by an angle q is

    q0 (x) (a sin(q/2), cos(q/2))  =  q0 cos(q/2) + (q0 (x) (a, 0)) sin(q/2),

and for a prismatic joint the translation is t0 + (R0 a) q. Both are linear in constants of the
description, which are computed once; _kinematics.c evaluates them for many states at once.
"""

import ctypes
import functools
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike

from onebot_description.arrays import Floats
from onebot_description.compiled.library import load_library
from onebot_description.elements.urdf import MOVING_KINDS, Description, Joint, Mimic, reduced_mimics
from onebot_description.errors import OneBotError, did_you_mean
from onebot_description.geometry import matrices, quaternions
from onebot_description.joints.motion_limits import zero_position
from onebot_description.parameters.arguments import checked_methods
from onebot_description.parameters.values import Rule

_POSE = 7  # numbers in a transform: translation x y z, rotation x y z w
_Positions = Annotated[
    Mapping[str, Annotated[float, Rule(nan="one that is not known")]],
    Rule(write="a dict of positions by joint, rad or m"),
]
_SLACK = 1e-9  # rad or m; a position this far beyond a limit is rounding


@functools.cache
def _kinematics() -> ctypes.CDLL:
    """Return the compiled library, with the signatures of _kinematics.c declared."""
    # A CDLL, unlike a PyDLL, releases the GIL: a batch may take long.
    library = ctypes.CDLL(load_library()._name)
    pointer, number = ctypes.c_void_p, ctypes.c_int64
    library.onebot_transforms.argtypes = [pointer, number, pointer, pointer]
    library.onebot_transforms.restype = None
    library.onebot_link_poses.argtypes = [pointer, pointer, number, pointer, pointer]
    library.onebot_link_poses.restype = None
    return library


class _Joints(ctypes.Structure):
    """struct joints in _kinematics.c."""

    _fields_ = (
        ("count", ctypes.c_int64),
        *((name, ctypes.c_void_p) for name in ("half_turns", "constant", "sine", "slide")),
    )


class _Tree(ctypes.Structure):
    """struct tree in _kinematics.c."""

    _fields_ = (
        *((name, ctypes.c_int64) for name in ("links", "steps", "root")),
        *((name, ctypes.c_void_p) for name in ("parent", "child", "moving", "fixed")),
    )


class JointArrays:
    """Computes the transforms of M joints from their positions.

    Attributes, none of which may be changed:
        parents: parent link of each joint.
        children: child link of each joint.
        axes: (M, 3), unit vectors in the child's frame.
        half_turns: (M,), 1/2 for rotating joints, 0 for prismatic ones.
        constant: (M, 7): the transform at position 0 (translation x y z, rotation x y z w).
        sine: (M, 4): the factor of sin(q/2) in the rotation.
        slide: (M, 3): the factor of the position in the translation, m/m.
        address: address of the struct joints; valid while this object exists.
    """

    def __init__(self, joints: Sequence[Joint]) -> None:
        self._joints, count = joints, len(joints)
        self.parents = tuple(joint.parent for joint in joints)
        self.children = tuple(joint.child for joint in joints)
        rpy = np.array([joint.origin.rpy for joint in joints], float).reshape(count, 3)
        rotation = quaternions.from_rpy(rpy)
        self.axes = axis = np.array([joint.axis for joint in joints], float).reshape(count, 3)
        slides = np.array([joint.kind == "prismatic" for joint in joints], bool)
        turns = np.array([joint.kind in ("revolute", "continuous") for joint in joints], bool)
        pure = np.concatenate((axis, np.zeros((count, 1))), axis=1)
        translation = np.array([joint.origin.xyz for joint in joints], float).reshape(count, 3)
        self.half_turns = np.where(turns, 0.5, 0.0)
        self.constant = np.concatenate((translation, rotation), axis=1)
        self.sine = np.ascontiguousarray(quaternions.multiply(rotation, pure) * turns[:, None])
        self.slide = np.ascontiguousarray(quaternions.rotate(rotation, axis) * slides[:, None])
        arrays = (self.half_turns, self.constant, self.sine, self.slide)
        self._structure = _Joints(count, *(array.ctypes.data for array in arrays))
        self.address = ctypes.addressof(self._structure)

    def transforms(self, positions: Floats) -> Floats:
        """Return the parent-to-child transforms of the joints.

        Args:
            positions: (..., M), radians or meters.

        Returns:
            (..., M, 7): translation x y z in meters, rotation quaternion x y z w.
        """
        positions = np.ascontiguousarray(positions, float)
        poses = np.empty((*positions.shape, _POSE))
        states = math.prod(positions.shape[:-1])
        _kinematics().onebot_transforms(
            self.address, states, positions.ctypes.data, poses.ctypes.data
        )
        return poses

    def take(self, rows: Sequence[int]) -> "JointArrays":
        """Return the arrays of the joints in these rows."""
        return JointArrays([self._joints[row] for row in rows])


class LinkTree:
    """Computes the poses of all links in the root's frame, along the tree of joints."""

    def __init__(
        self, links: Sequence[str], root: str, moving: JointArrays, fixed: JointArrays
    ) -> None:
        """Order the joints from the root to the tips."""
        rows = {name: number for number, name in enumerate(links)}
        below: dict[str, list[tuple[str, int]]] = {}
        for row, parent in enumerate(moving.parents):
            below.setdefault(parent, []).append((moving.children[row], row))
        for row, parent in enumerate(fixed.parents):
            below.setdefault(parent, []).append((fixed.children[row], -1 - row))
        steps: list[tuple[int, int, int]] = []
        reached = [root]
        for parent in reached:
            for child, row in below.get(parent, ()):
                steps.append((rows[parent], rows[child], row))
                reached.append(child)
        columns = np.array(steps, np.int32).reshape(-1, 3).T.copy()
        self._kept = (moving, fixed, columns)  # keep alive: the structure holds only addresses
        self._links = len(links)
        addresses = [column.ctypes.data for column in columns]
        self._structure = _Tree(
            len(links), len(steps), rows[root], *addresses, fixed.constant.ctypes.data
        )
        self._addresses = moving.address, ctypes.addressof(self._structure)

    def poses(self, positions: Floats) -> Floats:
        """Return the poses (..., links, 7) in the root's frame for positions (..., M)."""
        positions = np.ascontiguousarray(positions, float)
        batch = positions.shape[:-1]
        poses = np.empty((*batch, self._links, _POSE))
        _kinematics().onebot_link_poses(
            *self._addresses, math.prod(batch), positions.ctypes.data, poses.ctypes.data
        )
        return poses


@checked_methods()
class RobotModel:
    """Forward kinematics of a robot with M moving joints, independent of ROS.

    Attributes:
        name: the robot's name.
        root_link: the link without a parent.
        links: link names in the description's order.
        joints: names of the moving joints (revolute, continuous, prismatic, also mimic joints),
            in the description's order; positions are given in this order.
        moving: the arrays of these joints.
        fixed: the arrays of the other joints. Floating and planar joints, which JointState does
            not contain, are at their origin.
        floating: names of the links that floating joints carry.
        lower: (M,), minimum positions in rad or m; minus infinity without limit.
        upper: (M,), maximum positions in rad or m; infinite without limit.
    """

    def __init__(self, description: Description) -> None:
        """Convert a description to arrays.

        Raises:
            DescriptionError: the links are not all connected.
        """
        description.require_tree()
        self.name = description.robot_name
        self.root_link = description.root_link
        self.links = description.link_names
        moving = description.moving_joints
        fixed = [joint for joint in description.joints if joint.kind not in MOVING_KINDS]
        self.floating = {joint.child for joint in fixed if joint.kind == "floating"}
        self.joints = tuple(joint.name for joint in moving)
        self.moving, self.fixed = JointArrays(moving), JointArrays(fixed)
        self.lower, self.upper = np.array([joint.range for joint in moving]).reshape(-1, 2).T
        self._rows = {name: row for row, name in enumerate(self.joints)}
        self._mimics = {joint.name: joint.mimic for joint in moving if joint.mimic is not None}

    @classmethod
    def from_description(cls, description: Description) -> "RobotModel":
        """Return the model of a description.

        Raises:
            DescriptionError: the links are not all connected.
        """
        return cls(description)

    def row(self, joint: str) -> int:
        """Return the index of a moving joint in ``joints``.

        Raises:
            OneBotError: there is no such joint; the text lists them.
        """
        try:
            return self._rows[joint]
        except KeyError:
            hint = did_you_mean(joint, self.joints, "joints")
            raise OneBotError(f'robot "{self.name}" has no moving joint "{joint}"{hint}') from None

    def followers(self, given: Iterable[str]) -> dict[str, Mimic]:
        """Return how the moving joints follow the ``given`` ones; those that do not are left out.

        Chains of mimic joints are followed up to the first given joint, which may be the joint
        itself: a value given for a mimic joint overrides its leader's.
        """
        return reduced_mimics(self.joints, self._mimics, given)

    def positions(self, given: _Positions) -> Floats:
        """Return the positions of all moving joints, (M,), from some of them by name.

        Mimic joints follow. Other joints are at 0, even if that is beyond their limits. Limits are
        not checked, unlike in ``pose``.
        """
        for name in given:
            self.row(name)
        free = (name for name in self.joints if name not in self._mimics)
        everything = {**dict.fromkeys(free, 0.0), **given}
        result = np.zeros(len(self.joints))
        for name, mimic in self.followers(everything).items():
            result[self._rows[name]] = mimic.at(everything[mimic.joint])
        return result

    def pose(self, given: _Positions) -> Floats:
        """Return the positions of all moving joints, (M,), some given by name, others at rest.

        Joints rest at 0, or in the middle of their range if it does not include 0; mimic joints
        follow. Raises OneBotError for a joint that does not move, follows another, or would exceed
        a limit.
        """
        for name in given:
            self.row(name)
            if name in self._mimics:
                leader = self._mimics[name].joint
                text = f'joint "{name}" follows joint "{leader}": give the position of "{leader}"'
                raise OneBotError(text)
        rests = {
            name: zero_position(lower, upper)
            for name, lower, upper in zip(self.joints, self.lower, self.upper, strict=True)
            if name not in self._mimics
        }
        positions = self.positions({**rests, **given})
        # Ignore a follower that is beyond its limits while its leader is at rest.
        chosen = positions != self.positions(rests)
        within = (positions >= self.lower - _SLACK) & (positions <= self.upper + _SLACK)
        if rows := np.flatnonzero(chosen & ~within).tolist():
            raise OneBotError("\n".join(self._beyond(row, positions[row]) for row in rows))
        return positions

    def _beyond(self, row: int, position: float) -> str:
        limits = f"{self.lower[row]:g} to {self.upper[row]:g}"
        return f'joint "{self.joints[row]}": {position:g} is beyond its limits, {limits}'

    def transforms(self, positions: ArrayLike | Mapping[str, float]) -> tuple[Floats, Floats]:
        """Return the parent-to-child transforms of all moving joints.

        Args:
            positions: (..., M) in the order of ``joints``, radians or meters; or by name.

        Returns:
            Translations (..., M, 3) in meters and rotations (..., M, 4) as quaternions x y z w.
        """
        q = self._checked(positions)
        values = self.moving.transforms(q)
        return values[..., :3], values[..., 3:]

    def link_poses(self, positions: ArrayLike | Mapping[str, float]) -> Floats:
        """Return the poses of all links in the root link's frame.

        Args:
            positions: (..., M) in the order of ``joints``, rad or m; or by name, as ``positions``.

        Returns:
            (..., L, 7) in the order of ``links``: translation x y z in meters, rotation x y z w.

        Raises:
            OneBotError: the shape is wrong, or there is no such joint.
        """
        return self._tree.poses(self._checked(positions))

    def jacobian(self, link: str, positions: ArrayLike | Mapping[str, float]) -> Floats:
        """Return the geometric Jacobian of a link's origin, in the root link's frame.

        Pinocchio names it LOCAL_WORLD_ALIGNED.

        Multiplied by the joint velocities (M,), rad/s or m/s, it gives the linear velocity of the
        origin, m/s, above the angular velocity of the link, rad/s. The columns are those of
        Siciliano et al., "Robotics: Modelling, Planning and Control", 2009, eq. 3.30. Joints that
        do not carry the link have columns of zeros; a mimic joint has its own column.

        Args:
            link: name of the link.
            positions: (..., M) in the order of ``joints``, rad or m; or by name, as ``positions``.

        Returns:
            (..., 6, M).

        Raises:
            OneBotError: there is no such link or joint, or the shape is wrong.
        """
        if link not in self.links:
            hint = did_you_mean(link, self.links, "links")
            raise OneBotError(f'robot "{self.name}" has no link "{link}"{hint}')
        poses = self.link_poses(positions)
        rows = {name: row for row, name in enumerate(self.links)}
        children = poses[..., [rows[child] for child in self.moving.children], :]
        axes = quaternions.rotate(children[..., 3:], self.moving.axes)
        levers = poses[..., rows[link], None, :3] - children[..., :3]
        turns = self.moving.half_turns[:, None] > 0.0
        linear = np.where(turns, np.cross(axes, levers), axes)
        columns = np.concatenate((linear, np.where(turns, axes, 0.0)), axis=-1)
        carrying = np.isin(self.moving.children, self._chain(link))
        return np.swapaxes(np.where(carrying[:, None], columns, 0.0), -1, -2)

    def _chain(self, link: str) -> list[str]:
        """Return a link and those between it and the root, from the link up."""
        joints = (self.moving, self.fixed)
        parents = {
            c: p for each in joints for c, p in zip(each.children, each.parents, strict=True)
        }
        chain = [link]
        while chain[-1] in parents:
            chain.append(parents[chain[-1]])
        return chain

    def link_matrices(self, positions: ArrayLike | Mapping[str, float]) -> dict[str, Floats]:
        """Return the pose (..., 4, 4) of each link in the root link's frame, by name.

        Args:
            positions: (..., M) in the order of ``joints``, rad or m; or by name, as ``positions``.

        Raises:
            OneBotError: the shape is wrong, or there is no such joint.
        """
        poses = matrices.of_poses(self.link_poses(positions))
        return dict(zip(self.links, np.moveaxis(poses, -3, 0), strict=True))

    @functools.cached_property
    def _tree(self) -> LinkTree:
        return LinkTree(self.links, self.root_link, self.moving, self.fixed)

    def _checked(self, positions: ArrayLike | Mapping[str, float]) -> Floats:
        if isinstance(positions, Mapping):
            return self.positions(positions)
        count = len(self.joints)
        text = f'robot "{self.name}" has {count} moving joints, so positions must be of shape'
        try:
            q = np.asarray(positions, float)
        except (TypeError, ValueError):
            raise OneBotError(f"{text} (..., {count}), or a dict by joint") from None
        if q.shape[-1:] != (count,):
            raise OneBotError(f"{text} (..., {count}), not {q.shape}")
        return q
