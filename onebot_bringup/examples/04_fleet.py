"""Four robots drive in a convoy: one leads, and the others keep 0.5 m behind the robot ahead.

Run it with `python 04_fleet.py`. On ROS topics a fleet is `onebot_bringup robots:=4`.
"""

from onebot_control import RobotSetup, Simulation

GAP = 0.5  # m
NAMES = ("leader", "second", "third", "fourth")

with Simulation(robots={name: RobotSetup(x=-row) for row, name in enumerate(NAMES)}) as simulation:
    leader, *followers = simulation.robots.values()

    def drive(speed: float, seconds: float) -> None:
        """Let the leader drive, and set the followers' speeds ten times a second."""
        leader.drive(speed)
        for _ in range(round(10.0 * seconds)):
            for robot in followers:
                robot.drive(leader.twist.linear + 0.8 * (robot.distance_ahead() - GAP))
            simulation.run(0.1)

    drive(0.3, 6.0)
    drive(0.0, 4.0)
    print(f"the leader is at x {leader.pose.x:.3f} m")
    for robot in followers:
        print(f"{robot}, {robot.distance_ahead():.3f} m behind the robot ahead")
