"""Robots whose joints the steering page moves, for tests on real DDS."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from std_msgs.msg import String
from trajectory_msgs.msg import JointTrajectory

from onebot_description.ros.wire.cdr import nanoseconds
from tests.onebot_control.arm_support import ControllerState
from tests.ros_support import LATCHED, Peer
from tests.support import wait_for

SPEED = 0.4  # rad/s
# rad until it is at rest: 0.25 s until a page counts as silent, 0.3 s of a trajectory, and what a
# busy computer adds to both.
TRAVEL = 1.5 * SPEED
UPPER = 12.0  # rad; no test holds a slider for so long
BAR = """
  <link name="{name}">
    <inertial><origin xyz="0.05 0 0"/><mass value="0.2"/>
      <inertia ixx="0.0002" iyy="0.0004" izz="0.0004" ixy="0" ixz="0" iyz="0"/></inertial>
  </link>
  <joint name="{name}_joint" type="{kind}">
    <parent link="{parent}"/><child link="{name}"/><origin xyz="0 0 0.1"/><axis xyz="0 0 1"/>
    <limit effort="50" velocity="2" {limits}/>
  </joint>"""
TURNS, SLIDES = f'lower="-{UPPER}" upper="{UPPER}"', 'lower="0" upper="0.05"'
STANDING = f"""<robot name="standing"><link name="world"/>
  {BAR.format(name="arm", kind="revolute", parent="world", limits=TURNS)}
  {BAR.format(name="lift", kind="prismatic", parent="arm", limits=SLIDES)}
</robot>"""


class Arm:
    """What a controller of joints publishes."""

    def __init__(self, peer: Peer, controller: str = "/joint_trajectory_controller") -> None:
        self.peer = peer
        self.states: list[Any] = peer.hear(ControllerState, f"{controller}/controller_state")
        self.commands = peer.hear(JointTrajectory, f"{controller}/joint_trajectory")
        wait_for(lambda: self.states, "the controller")

    def positions(self) -> list[float]:
        """As they are measured."""
        return list(self.states[-1].feedback.positions)

    def speed(self) -> float:
        """That of the first joint, rad/s."""
        return float(self.states[-1].feedback.velocities[0])

    def reach(self, speed: float) -> None:
        wait_for(lambda: abs(self.speed() - speed) < 0.05, f"{speed} rad/s")

    def stop(self, end: Callable[[], object], travel: float = TRAVEL) -> None:
        """Do something that stops it, and see that it does within rad, and for good.

        What is received here may be late: where it was then, the stamps tell afterwards.
        """
        then = time.time_ns()
        end()
        self.rest()
        start = next(s for s in reversed(self.states) if nanoseconds(s.header.stamp) <= then)
        assert abs(self.positions()[0] - start.feedback.positions[0]) < travel

    def rest(self) -> None:
        """Wait until it has been at rest for half a second.

        For a moment it rests between two trajectories that a busy computer has delayed, too.
        """
        count = len(self.states)

        def rests() -> bool:
            places = [state.feedback.positions for state in self.states[count:][-50:]]
            return len(places) == 50 and np.ptp(places, axis=0).max() < 2e-3

        wait_for(rests, "rest")


@contextmanager
def described(domain: int, text: str) -> Iterator[Peer]:
    """A peer that publishes the robot's description."""
    with Peer(domain) as peer:
        publisher = peer.node.create_publisher(String, "/robot_description", LATCHED)
        publisher.publish(String(data=text))
        yield peer
