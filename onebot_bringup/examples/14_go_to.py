"""OneBot finds its way through the maze with its lidar, and maps it.

Run it with `python 14_go_to.py`. It needs no ROS, and the figures are the same on each run.
"""

from math import hypot

from onebot_control import Simulation
from onebot_control.navigation.map_files import save_map

limits = {"linear.x.max_velocity": 0.5}
with Simulation(world="maze", sensors=True, y=0.8, parameters=limits) as simulation:
    robot = simulation.robot
    robot.go_to(0.1, 1.7, yaw=1.57)
    while robot.navigating:
        simulation.run(2.0)
        print(f"{simulation.time:g} s: {robot.navigation.status}, {robot}")

    pose, navigator = robot.pose, robot.navigation.navigator
    print(f"it is {1e3 * hypot(pose.x - 0.1, pose.y - 1.7):.0f} mm from its goal")
    error = hypot(pose.x - navigator.pose.x, pose.y - navigator.pose.y)
    print(f"it is {1e3 * error:.0f} mm from its own estimate")
    save_map(navigator.map.occupancy(), "maze")  # maze.yaml and maze.pgm, as map_server's
