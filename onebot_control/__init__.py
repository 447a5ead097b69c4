"""Controllers, odometry, a PyBullet simulation and simulated sensors for robots described by URDF.

From Python, without ROS, start with a ``Simulation``::

    from onebot_control import Simulation

    with Simulation(world="maze", sensors=True) as simulation:
        simulation.robot.drive(0.5)
        simulation.run(2.0)
        print(simulation.robot.pose, simulation.robot.scan().ahead)

``simulation.robot`` is a ``SimulatedRobot``. It returns its true ``RobotPose`` and
``PlanarVelocity``, its ``OdometryReading``, the ``JointState`` of each joint, and what its sensors
measure: a ``Scan``, an ``ImuReading``, or arrays. To simulate several robots, pass a ``RobotSetup``
for each. A mistake in a file or an argument raises a ``OneBotError``.

To run the ROS node: ``python -m onebot_control.velocity_controller``.
"""

import onebot_description

TYPE_CHECKING = not __name__  # false; jedi leaves out what the literal excludes; typing is slow
__version__: str

__docformat__ = "google"

__all__ = [
    "Contact",
    "ImuReading",
    "JointState",
    "Moment",
    "OccupancyGrid",
    "OdometryReading",
    "OneBotError",
    "PlanarVelocity",
    "RobotPose",
    "RobotSetup",
    "Scan",
    "SimulatedRobot",
    "Simulation",
    "__version__",
]

if TYPE_CHECKING:
    # Not in __all__: ``import *`` would need ROS.
    from onebot_control.nodes.lockstep import Lockstep as Lockstep
    from onebot_control.occupancy_grid import OccupancyGrid
    from onebot_control.physics.contacts import Contact
    from onebot_control.recording import Moment
    from onebot_control.robot_setup import RobotSetup
    from onebot_control.sensing.readings import (
        ImuReading,
        JointState,
        OdometryReading,
        PlanarVelocity,
        RobotPose,
        Scan,
    )
    from onebot_control.simulated_robot import SimulatedRobot
    from onebot_control.simulation import Simulation
    from onebot_description.errors import OneBotError
else:
    __getattr__ = onebot_description.lazy(
        globals(),
        {
            "onebot_control.physics.contacts": ("Contact",),
            "onebot_control.occupancy_grid": ("OccupancyGrid",),
            "onebot_control.nodes.lockstep": ("Lockstep",),
            "onebot_control.recording": ("Moment",),
            "onebot_control.robot_setup": ("RobotSetup",),
            "onebot_control.sensing.readings": (
                *("ImuReading", "JointState", "OdometryReading"),
                *("RobotPose", "Scan", "PlanarVelocity"),
            ),
            "onebot_control.simulated_robot": ("SimulatedRobot",),
            "onebot_control.simulation": ("Simulation",),
            "onebot_description.errors": ("OneBotError",),
        },
    )
