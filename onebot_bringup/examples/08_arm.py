"""An arm of two links, with its URDF in this file, moves; its motors then hold it against gravity.

Run it with `python 08_arm.py`. For an arm in a file there is `onebot view FILE sim:=true`.
"""

from math import sin

from onebot_control import Simulation
from onebot_description import parse_description

PART = """<joint name="{joint}" type="revolute">
  <parent link="{parent}"/> <child link="{link}"/> <origin xyz="0 0 {z}"/> <axis xyz="0 1 0"/>
  <limit lower="-2" upper="2" effort="20" velocity="2"/> </joint>
<link name="{link}"> <inertial> <mass value="1"/> <origin xyz="0 0 0.2"/>
  <inertia ixx="0.0133" iyy="0.0133" izz="0.0001" ixy="0" ixz="0" iyz="0"/> </inertial> </link>"""
UPPER = PART.format(joint="shoulder", parent="base", link="upper", z=0.0)
LOWER = PART.format(joint="elbow", parent="upper", link="lower", z=0.4)
URDF = f'<robot name="arm"> <link name="base"/> {UPPER} {LOWER} </robot>'

with Simulation(parse_description(URDF, "arm")) as simulation:
    robot = simulation.robot
    robot.move_to({"shoulder": 0.5, "elbow": 1.0}, seconds=2.0)  # rad
    simulation.run(until=lambda: not robot.moving)
    for name, joint in robot.joints.items():
        print(f"{name} is at {joint.position:.4f} rad, and holds {-joint.effort:.3f} N m")
    print(f"against gravity the elbow has to hold {1.0 * 9.81 * 0.2 * sin(0.5 + 1.0):.3f} N m")
