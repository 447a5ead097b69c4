"""Poses, rotations and transforms, shared by all packages.

- ``poses``: one at a time, as plain floats, without numpy.
- ``quaternions``: batches of rotations, as arrays (..., 4).
- ``matrices``: homogeneous transforms, as arrays (..., 4, 4).

Lengths are in meters, angles in radians, frames as in REP-103 (x ahead, y left, z up). A rotation
is a unit quaternion x y z w, the real part last, as in geometry_msgs. Roll, pitch and yaw turn
about the fixed axes x, y, z of the parent, in this order, as in URDF: R = Rz(yaw) Ry(pitch)
Rx(roll). A pose of a frame in its parent is also the transform of its points into the parent:
p_parent = R p + t. The conversions are those of J. Diebel, "Representing Attitude: Euler Angles,
Unit Quaternions, and Rotation Vectors", Stanford 2006.

This package imports none of its modules.
"""
