"""Stops publishing the truth on TF while another node localizes the robots."""

import time
from collections.abc import Sequence, Set

from rclpy.node import Node

from onebot_control.nodes.foreign_localizer import (
    FramesTransform,
    Localizer,
    TransformsOf,
    TransformTap,
)
from onebot_control.nodes.publishing import Publishers


class LocalizerCheck:
    """Decides whether the truth of one robot is on TF: not while another node localizes it."""

    def __init__(self, node: Node, publishing: Publishers) -> None:
        """Begin without another node.

        Args:
            node: of the robot, for the log.
            publishing: publishes the truth.
        """
        self._node, self.publishing = node, publishing
        self._localizer = Localizer("")

    @property
    def found(self) -> str:
        """The transform that another node publishes, in words; "" if none does."""
        localizer = self._localizer
        return f"{localizer.parent} -> {localizer.odom}" if localizer.parent else ""

    def receive(self, transform: FramesTransform, now: int) -> None:
        """Take notice of a transform of odom on TF; ``now`` in ns, by a steady clock."""
        publishing = self.publishing
        if self._localizer.odom != publishing.odom_frame:
            self._localizer = Localizer(publishing.odom_frame)
        self._localizer.receive(transform, publishing.truths, now)

    def follow(self, nodes: Set[str], now: int) -> bool:
        """Stop or resume publishing the truth; return whether it was resumed.

        Args:
            nodes: the other nodes that publish TF.
            now: ns, by a steady clock.
        """
        publishing, parent = self.publishing, self._localizer.parent
        self._localizer.expire(nodes, now)
        if publishing.localized == bool(self.found):
            return False
        publishing.localized = bool(self.found)
        own_transform = f"{publishing.world_frame} -> {publishing.odom_frame}"
        if publishing.localized:
            text = f"another node publishes {self.found} on TF, so {own_transform} "
            text += "is not published; set ground_truth_tf to false where that is always so"
        else:
            gone = f"{parent} -> {self._localizer.odom}"
            text = f"nobody publishes {gone} any more: {own_transform} is published"
        if publishing.publishes_truth:
            self._node.get_logger().info(text)
        return not publishing.localized


class LocalizerWatch:
    """Looks for localizers of all robots of a world."""

    def __init__(self, nodes: Sequence[Node], robots: Sequence[LocalizerCheck]) -> None:
        """Prepare; ``poll`` subscribes.

        Args:
            nodes: of the robots, whose own transforms do not count.
            robots: those that drive.
        """
        self._nodes, self._robots = nodes, robots
        self._transforms = TransformTap(nodes[0])
        self._of_odom = TransformsOf(())

    def poll(self) -> None:
        """Look for localizers; call it several times a second, when the control loop runs."""
        robots = {
            robot.publishing.odom_frame: robot
            for robot in self._robots
            if robot.publishing.world_frame
        }
        if not robots:
            self._transforms.close()
            return
        if self._of_odom.children != robots.keys():
            self._of_odom = TransformsOf(robots)
        now = time.monotonic_ns()
        for message in self._transforms.poll(self._nodes, now):
            for transform in self._of_odom.find(message):
                robots[transform.child].receive(transform, now)
        if any([robot.follow(self._transforms.nodes, now) for robot in self._robots]):
            self._transforms.close()  # subscribe again, to receive latched transforms of others
