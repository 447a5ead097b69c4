"""Measures with OneBot's lidar, IMU and camera while it drives towards a wall.

Run it with `python 03_sense.py`. It saves what the camera sees as camera.png.
"""

from PIL import Image

from onebot_control import Simulation

with Simulation(world="maze", y=0.8, sensors=True, seed=7) as simulation:
    robot = simulation.robot
    robot.drive(0.5)
    for _ in range(4):
        simulation.run(1.0)
        measured, exact = robot.scan().ahead, robot.distance_ahead()
        print(f"{simulation.time:g} s: the lidar measures {measured:.3f} m of {exact:.3f} m ahead")

    nearest = robot.scan().ranges.min()  # It is an array with a range for each degree.
    print(f"the nearest wall is {nearest:.2f} m away")

    upwards = robot.imu().linear_acceleration[2]
    print(f"the IMU measures {upwards:.2f} m/s^2 upwards")

    Image.fromarray(robot.image()).save("camera.png")
    height, width = robot.depth().shape
    middle = robot.depth()[height // 2, width // 2]
    print(f"the camera has {width} x {height} pixels, and the wall is {middle:.2f} m ahead")
