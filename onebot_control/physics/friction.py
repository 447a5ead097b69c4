"""Sets friction and contacts of everything on the ground: wheels, casters, base, scenes.

URDF does not specify all that a simulation needs, and PyBullet's defaults are unsuitable:

- Wheels, driven ones and those of casters, have the friction of ``PhysicsSettings``, unless the
  URDF has a <lateral_friction>.
- A wide or faceted driven wheel would touch the ground at changing points, so it rolls on a thin
  cylinder instead; if the robot steers, on a disc that touches the ground at its center.
- More than two driven wheels are soft, to share the load, and give way sideways; see ``SkidAxle``.
- Everything else that touches the ground glides, unless the URDF has a <lateral_friction>, and is
  lifted a little if it would carry the robot instead of the wheels.
"""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from onebot_control.drive.wheels.rolling_shapes import Tyre, lowest_point
from onebot_control.physics.engine import Bullet, logger
from onebot_description.elements.urdf import (
    Box,
    Capsule,
    Cylinder,
    Description,
    Geometry,
    Joint,
    Link,
    Mesh,
    Shape,
    Sphere,
)
from onebot_description.geometry import matrices
from onebot_description.geometry.poses import Origin
from onebot_description.model.rigid_bodies import Body, rigid_frames

_THIN = 0.006  # m; wheels up to this width touch the ground at one point
_WIDTH = 0.004  # m, width of the cylinder that replaces a wider wheel
# The width for a robot that steers. With it, PyBullet's margin of 1 mm rounds the whole rim, so the
# wheel touches the ground at its center. On an axle that is not exactly level, a wider wheel would
# touch with one edge: 1 mm is 1 % of a small car's track, and wheels would work against each other.
_DISC = 0.002
_GLIDING = 0.01  # coefficient of friction of parts that glide
# Rigid casters in front of and behind the wheels could carry the robot alone. Therefore, round
# shapes up to _LEVEL (m) below the wheels are raised to _LIFT (m) above the ground.
_LEVEL, _LIFT = 0.005, 0.0002
# The same for meshes and boxes of a base that round shapes support. PyBullet uses a mesh's
# convex hull, which also fills the space between the wheels.
_DEEP, _CLEAR = 0.02, 0.002
_MARGIN = 0.001  # m by which PyBullet's convex hulls are larger than the mesh

# The solver ignores contact points of bodies that are farther apart than this, m. PyBullet keeps
# up to four points per wheel where a rolling wheel has touched the ground, and solves them all:
# at 1 m/s that takes four times as long, for forces of zero.
TOUCHING = 1e-6
# Torsional friction of grippers, m: moment per force. The pressure distribution of rigid pads is
# indeterminate; with all pressure at one point, nothing else would resist turning.
_TORSION = 0.005
# Deflection of skidding wheels under load, m. The loads of more than three rigid wheels are
# indeterminate, and friction would determine which of them carry the robot.
_SAG = 1e-4


# In the description -----------------------------------------------------------------------------


class Contacts:
    """Gives the links of one robot suitable collision shapes and friction for the simulation."""

    def __init__(
        self,
        robot: Description,
        tyres: Mapping[str, Tyre | None],
        casters: Collection[str],
        moved: Collection[str],
        *,
        steers: bool = False,
    ) -> None:
        """Determine what supports the robot.

        Args:
            robot: the robot; joints that are held still are fixed.
            tyres: the round shapes of the driven wheels, by joint; None if a wheel has none.
            casters: joints of casters, swivelling and rolling ones.
            moved: joints of arms and grippers, whose links keep their shapes and friction.
            steers: whether the robot steers wheels.
        """
        self._width, self._thin = (_DISC, _DISC) if steers else (_WIDTH, _THIN)
        self._robot, self._tyres, self._casters, self._moved = robot, tyres, casters, moved
        self._poses = rigid_frames(robot)
        self._joints = {joint.child: joint for joint in robot.joints}
        # A single caster's load follows from the mass alone, so it needs no shrinking.
        self._shrinks = sum(map(self._rolls_on_caster, robot.joints)) > 1
        self._ground = self._ground_height()
        supported = any(
            _is_round(geometry.shape) and abs(self._gap(link, geometry)) < _LEVEL
            for link in robot.links
            if self._joint_of(link.name) is None
            for geometry in link.collisions
        )
        self._depth, self._lift = (_DEEP, _CLEAR) if supported else (_LEVEL, _LIFT)

    def changed(self, link: Link) -> Link:
        """Return a link of the robot with suitable shapes and friction."""
        joint = self._joint_of(link.name)
        if joint is not None and joint.name in self._tyres:
            return replace(self._wheel(link, joint), mu=None)
        if joint is not None and joint.name in self._moved:
            return link
        link = replace(link, mu=None)
        if link.friction is not None or self._rolls_on_caster(joint):
            return _shrunk(link) if self._shrinks else link
        if joint is None:
            link = self._lifted(link)
        return replace(link, friction=_GLIDING)

    def _joint_of(self, link: str) -> Joint | None:
        """Return the joint that moves a link; None for the base and links fixed to it."""
        first, _ = self._poses[link]
        return self._joints.get(first)

    def _rolls_on_caster(self, joint: Joint | None) -> bool:
        """Return whether a joint is a caster's wheel: both it and its carrier are caster joints."""
        if joint is None or joint.name not in self._casters:
            return False
        carrier = self._joint_of(joint.parent)
        return carrier is not None and carrier.name in self._casters

    def _ground_height(self) -> float:
        """Return the height of the ground below the driven wheels, in the root link's frame, m."""
        heights = [-math.inf]
        for joint in self._robot.joints:
            if tyre := self._tyres.get(joint.name):
                place = self._poses[joint.parent][1] @ matrices.of_origin(joint.origin)
                middle = place @ np.array([*(tyre.offset * value for value in joint.axis), 1.0])
                heights.append(float(middle[2]) - tyre.radius)
        return max(heights)

    def _gap(self, link: Link, geometry: Geometry) -> float:
        """Return the height of a shape above the ground, m."""
        pose = self._poses[link.name][1] @ matrices.of_origin(geometry.origin)
        margin = _MARGIN if isinstance(geometry.shape, Mesh) else 0.0
        return lowest_point(geometry.shape, pose) - margin - self._ground

    def _wheel(self, link: Link, joint: Joint) -> Link:
        """Return a driven wheel's link, rolling on a thin cylinder unless it is thin itself."""
        tyre, first = self._tyres[joint.name], joint.child
        shapes = [
            geometry.shape
            for part in self._robot.links
            if self._poses[part.name][0] == first
            for geometry in part.collisions
        ]
        if tyre is None or (shapes and all(_is_thin(shape, self._thin) for shape in shapes)):
            return link
        return replace(
            link, collisions=(_wheel(joint, tyre, self._width),) if link.name == first else ()
        )

    def _lifted(self, link: Link) -> Link:
        """Return a link of the base; shapes at about the height of the wheels are lifted."""
        collisions, highest_lift = [], 0.0
        pose = self._poses[link.name][1]
        for geometry in link.collisions:
            gap = self._gap(link, geometry)
            is_round = _is_round(geometry.shape)
            depth, lift = (_LEVEL, _LIFT) if is_round else (self._depth, self._lift)
            if -depth < gap < lift:
                highest_lift = max(highest_lift, lift - gap)
                place = pose @ matrices.of_origin(geometry.origin)
                place[2, 3] += lift - gap
                geometry = replace(geometry, origin=matrices.to_origin(np.linalg.inv(pose) @ place))
            collisions.append(geometry)
        if highest_lift > _LEVEL:
            logger.warning(
                '%s: a collision shape of link "%s" reaches below the wheels; the simulation '
                "lifts it by %.0f mm, so that the wheels carry the robot",
                link.where,
                link.name,
                1e3 * highest_lift,
            )
        return replace(link, collisions=tuple(collisions))


def _shrunk(link: Link) -> Link:
    """Return a caster's wheel with smaller round shapes; if lifted, it would roll unevenly."""
    collisions = tuple(
        replace(geometry, shape=replace(geometry.shape, radius=geometry.shape.radius - _LIFT))
        if isinstance(geometry.shape, Sphere | Cylinder | Capsule)
        and geometry.shape.radius > 2.0 * _LIFT
        else geometry
        for geometry in link.collisions
    )
    return replace(link, collisions=collisions)


def _is_round(shape: Shape) -> bool:
    """Return whether a shape can support a robot like a caster."""
    return not isinstance(shape, Mesh | Box)


def _is_thin(shape: Shape, width: float) -> bool:
    return isinstance(shape, Sphere) or (isinstance(shape, Cylinder) and shape.length <= width)


def _wheel(joint: Joint, tyre: Tyre, width: float) -> Geometry:
    """Return a thin wheel of this ``width``, m, on the axle of ``joint``."""
    x, y, z = joint.axis
    # A cylinder lies along z.
    rpy = (0.0, math.atan2(math.hypot(x, y), z), math.atan2(y, x))
    middle = (tyre.offset * x, tyre.offset * y, tyre.offset * z)
    return Geometry(Cylinder(tyre.radius, width), Origin(middle, rpy))


# In PyBullet ------------------------------------------------------------------------------------


def set_contact(
    bullet: Bullet, robot: int, index: int, body: Body, *, grasps: bool = False
) -> None:
    """Set the friction of a loaded body.

    Args:
        bullet: the world.
        robot: PyBullet's index of the robot.
        index: PyBullet's index of the link; -1 for the root.
        body: the rigid body that was loaded as this link.
        grasps: use friction anchors, so that a grasped object does not creep as long as friction
            suffices (without them, a box in a gripper creeps 0.4 mm in 10 s), and torsional
            friction, like soft fingers.
    """
    bullet.changeDynamics(
        robot,
        index,
        lateralFriction=bullet.settings.friction if body.friction is None else body.friction,
        contactProcessingThreshold=TOUCHING,
        frictionAnchor=grasps,
    )
    if grasps:
        bullet.changeDynamics(robot, index, spinningFriction=_TORSION)


def soften(bullet: Bullet, robot: int, wheels: Sequence[int], mass: float) -> None:
    """Let wheels share the weight of ``mass``, kg, like tyres, with critically damped springs."""
    for index in wheels:
        share = mass / len(wheels)
        stiffness = share * bullet.settings.gravity / _SAG
        bullet.changeDynamics(
            robot,
            index,
            contactStiffness=stiffness,
            contactDamping=2.0 * math.sqrt(stiffness * share),
        )
