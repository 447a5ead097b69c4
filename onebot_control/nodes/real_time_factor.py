"""Publishes the real-time factor of a control loop, and logs when it falls and recovers."""

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from onebot_control.runtime.pace_meter import Pace, PaceMeter
from onebot_description.ros.topic_qos import DEPTH


class PaceReports(PaceMeter):
    """Reports the pace of a control loop on /diagnostics, and in the log when it falls."""

    def __init__(self, node: Node) -> None:
        """Publish and log as ``node``."""
        self._node = node
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", DEPTH)

    def measured(self, pace: Pace, *, is_slow: bool) -> None:
        """Publish the real-time factor of the last second, from the control thread."""
        values = {
            "real_time_factor": f"{pace.factor:.3f}",
            "wanted real_time_factor": f"{self.wanted:g}",
            "control cycles": str(pace.cycles),
            "missed control cycles": str(pace.missed),
        }
        status = DiagnosticStatus(
            level=DiagnosticStatus.WARN if is_slow else DiagnosticStatus.OK,
            name=f"{self._node.get_fully_qualified_name()[1:]}: real-time factor",
            message=str(pace),
            values=[KeyValue(key=key, value=value) for key, value in values.items()],
        )
        message = DiagnosticArray(status=[status])
        message.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(message)

    def log(self, text: str, *, is_slow: bool) -> None:
        """Log a line."""
        if is_slow:  # rclpy allows only one severity per line of code
            text = f"{text}; the CPU is overloaded, or the process was stopped"
            self._node.get_logger().warning(text)
        else:
            self._node.get_logger().info(text)
