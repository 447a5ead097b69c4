"""The hand of a Panda, whose URDF comes with PyBullet, moves to a point by inverse kinematics.

Run it with `python 10_panda.py`. `onebot view FILE sim:=true steer:=true` shows it with sliders.
"""

import numpy as np
import pybullet_data

from onebot_control import Simulation
from onebot_description import RobotModel

PANDA = f"{pybullet_data.getDataPath()}/franka_panda/panda.urdf"
# A straight arm, the default, cannot move its hand towards its base.
BENT = {"initial_positions.panda_joint4": -2.0, "initial_positions.panda_joint6": 1.6}
GOAL = np.array([0.4, 0.2, 0.5])  # m, in the base's frame

with Simulation(PANDA, parameters=BENT) as simulation:
    robot = simulation.robot
    model = RobotModel.from_description(robot.description)
    joints = {name: robot.joints[name].position for name in model.joints[:7]}
    for _ in range(20):  # steps of damped least squares
        error = GOAL - model.link_matrices(joints)["panda_hand"][:3, 3]
        jacobian = model.jacobian("panda_hand", joints)[:3, :7]
        step = jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + 1e-3 * np.eye(3), error)
        joints = dict(zip(joints, step + [*joints.values()], strict=True))
    robot.move_to(joints, seconds=3.0)
    simulation.run(until=lambda: not robot.moving)
    reached = {name: robot.joints[name].position for name in joints}
    x, y, z = model.link_matrices(reached)["panda_hand"][:3, 3]
    print(f"after {simulation.time:.2f} s the hand is at {x:.4f}, {y:.4f}, {z:.4f} m")
