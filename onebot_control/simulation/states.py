"""What a simulation says of its robot, as plain arrays."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


class JointStates(NamedTuple):
    """State of all joints that move, in the description's order.

    Attributes:
        positions: (M,), rad (never wrapped), m for prismatic joints.
        velocities: (M,), rad/s or m/s.
        efforts: (M,), mean of what the motors applied in the last ``step``, Nm or N; 0 for joints
            without a motor.
    """

    positions: Floats
    velocities: Floats
    efforts: Floats


class Pose(NamedTuple):
    """Pose of the root link's frame (not of its centre of mass) in the world.

    Attributes:
        translation: (3,), m.
        rotation: (4,), unit quaternion x y z w.
    """

    translation: Floats
    rotation: Floats


class Twist(NamedTuple):
    """Velocity of the root link's frame, in that frame's own axes, as nav_msgs/Odometry has it.

    Attributes:
        linear: (3,), of the frame's origin, m/s.
        angular: (3,), rad/s.
    """

    linear: Floats
    angular: Floats
