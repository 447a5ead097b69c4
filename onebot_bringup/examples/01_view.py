"""Reads a URDF, prints where the robot's links are, and draws the robot into view.png.

Run it with `python 01_view.py`. With `onebot view FILE` any robot moves its joints in your browser.
"""

import subprocess

from onebot_description import RobotModel, load_description

FILE = "package://onebot_description/urdf/onebot.urdf.xacro"  # a path does as well
JOINTS = {"caster_swivel_joint": 1.57}  # rad; the others are at 0

description = load_description(FILE)
model = RobotModel.from_description(description)
print(f"{description.robot_name}: the joints {', '.join(model.joints)} move")

poses = model.link_poses(model.positions(JOINTS))  # x y z in m, and the quaternion x y z w
for link, (x, y, z, *_) in zip(model.links, poses, strict=True):
    print(f"{link:12} x {x:6.3f}  y {y:6.3f}  z {z:6.3f} m")

words = [f"{name}={value}" for name, value in JOINTS.items()]
subprocess.run(["onebot", "snapshot", "view.png", FILE, "--joints", *words], check=True)
