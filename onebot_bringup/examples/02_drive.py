"""Drives OneBot round a square of 1 m, and compares its odometry with the ground truth.

Run it with `python 02_drive.py`. It needs no ROS, and the figures are the same on each run.
"""

from math import hypot, pi

from onebot_control import Simulation

with Simulation() as simulation:
    robot = simulation.robot

    def drive(linear: float, angular: float) -> None:
        """Drive at m/s and rad/s for 2 s, and stop: braking covers what speeding up has lost."""
        robot.drive(linear, angular)
        simulation.run(2.0)
        robot.drive(0.0)
        simulation.run(1.5)

    for corner in range(1, 5):
        drive(0.5, 0.0)
        drive(0.0, pi / 4)
        error = hypot(robot.odometry.x - robot.pose.x, robot.odometry.y - robot.pose.y)
        print(f"corner {corner}: {robot}; the odometry is {1e3 * error:.1f} mm off")

    print(f"{simulation.time:g} s of driving")
