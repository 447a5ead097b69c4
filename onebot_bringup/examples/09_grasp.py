"""OneBot with a gripper drives to a box, grips it, and lifts it; nothing but friction holds it.

Run it with `python 09_grasp.py`. It prints; to watch it, open the notebook grasping.ipynb.
"""

from onebot_control import Simulation

FOLDER = "package://onebot_bringup/notebooks"

with Simulation(f"{FOLDER}/gripper.urdf.xacro", world=f"{FOLDER}/table.urdf.xacro") as simulation:
    robot = simulation.robot

    def move(**positions: float) -> None:
        """Move joints to positions in m; the others are held, so the fingers keep their grip."""
        robot.move_to(positions, seconds=1.0)
        simulation.run(until=lambda: not robot.moving)

    move(lift=0.1, finger=0.04)  # up, and open
    robot.drive(0.2)
    simulation.run(2.0)
    robot.drive(0.0)  # at rest it has driven 0.4 m, and the hand is above the box
    simulation.run(1.0)
    move(lift=0.0)
    move(finger=0.0)
    grip = robot.joints["finger"]
    print(f"at {1e3 * grip.position:.1f} mm the fingers press with {-grip.effort:.1f} N")
    move(lift=0.1)
    print(f"the middle of the box is {1e3 * simulation.boxes['box'].z:.1f} mm high")
