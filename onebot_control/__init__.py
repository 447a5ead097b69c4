"""Controllers, odometry, a PyBullet simulation and simulated sensors for robots described by URDF.

From Python, without ROS, start with a ``Simulation``::

    from onebot_control import Simulation

    with Simulation(world="maze", sensors=True) as simulation:
        simulation.robot.drive(0.5)
        simulation.run(2.0)
        print(simulation.robot.pose, simulation.robot.scan().ahead)

What the package exports:

- ``Simulation``: Simulates one or several robots in one world; time advances only in ``run``.
- ``RobotSetup``: Model, start pose and parameters of one of several robots.
- ``SimulatedRobot``: One robot: takes commands, and returns its true state and measurements.
- ``SimulatedNavigation``: Drives a robot to goals; ``robot.navigation`` returns it.
- ``RobotPose``, ``PlanarVelocity``: True pose and velocity of a robot.
- ``OdometryReading``: Pose and velocity from wheel odometry.
- ``JointState``: Measured state of one joint.
- ``Scan``, ``ImuReading``: Measurements of a lidar and of an IMU; other sensors return arrays.
- ``Contact``: A contact point between a robot and something else.
- ``OccupancyGrid``: The true map; ``simulation.occupancy_grid`` returns it.
- ``Moment``: The poses and joints of all robots at one time, from ``simulation.moments``.
- ``Lockstep``: Runs ROS nodes in lockstep; ``simulation.ros`` returns it. It needs ROS.
- ``OneBotEnv``: A Gymnasium environment. It needs ``pip install 'onebot-robots[gym]'``.
- ``OneBotError``: A mistake in a file or an argument, which a user can fix.

``onebot_control.evaluation`` runs an episode for many cases.

To run the ROS node: ``python -m onebot_control.velocity_controller``.
"""

import onebot_description

TYPE_CHECKING = not __name__  # false; jedi skips blocks under a literal False; typing is slow
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
    "SimulatedNavigation",
    "SimulatedRobot",
    "Simulation",
    "__version__",
]

if TYPE_CHECKING:
    # Not in __all__: ``import *`` would need Gymnasium and ROS.
    from onebot_control.environment import OneBotEnv as OneBotEnv
    from onebot_control.nodes.lockstep import Lockstep as Lockstep
    from onebot_control.occupancy_grid import OccupancyGrid
    from onebot_control.physics.contacts import Contact
    from onebot_control.robot_setup import RobotSetup
    from onebot_control.sensing.readings import (
        ImuReading,
        JointState,
        OdometryReading,
        RobotPose,
        Scan,
    )
    from onebot_control.simulated_navigation import SimulatedNavigation
    from onebot_control.simulated_robot import SimulatedRobot
    from onebot_control.simulation import Simulation
    from onebot_control.simulation_core import Moment
    from onebot_description.errors import OneBotError
    from onebot_description.geometry.poses import PlanarVelocity
else:
    __getattr__ = onebot_description.lazy(
        globals(),
        {
            "onebot_control.physics.contacts": ("Contact",),
            "onebot_control.environment": ("OneBotEnv",),
            "onebot_control.occupancy_grid": ("OccupancyGrid",),
            "onebot_control.nodes.lockstep": ("Lockstep",),
            "onebot_control.simulation_core": ("Moment",),
            "onebot_control.robot_setup": ("RobotSetup",),
            "onebot_control.sensing.readings": (
                *("ImuReading", "JointState", "OdometryReading"),
                *("RobotPose", "Scan"),
            ),
            "onebot_control.simulated_navigation": ("SimulatedNavigation",),
            "onebot_control.simulated_robot": ("SimulatedRobot",),
            "onebot_control.simulation": ("Simulation",),
            "onebot_description.errors": ("OneBotError",),
            "onebot_description.geometry.poses": ("PlanarVelocity",),
        },
    )
