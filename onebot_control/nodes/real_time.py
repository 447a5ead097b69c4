"""Measures the real-time factor of a control loop, and logs when it falls and recovers."""

from collections.abc import Callable
from dataclasses import dataclass

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

_DEPTH = 10  # ROS's system default
_SECOND = 1.0
# Fractions of the wanted factor: a second below _SLOW is logged; when every second within _STEADY
# has reached _BACK, it is logged that the pace is back.
_SLOW, _BACK = 0.9, 0.95
_STEADY = 5.0  # s


@dataclass
class Pace:
    """The real-time factor and missed cycles over some seconds."""

    seconds: float = 0.0  # real ones
    simulated: float = 0.0  # s
    cycles: int = 0  # control cycles done
    missed: int = 0  # control cycles left out

    @property
    def factor(self) -> float:
        """Simulated seconds per real second."""
        return self.simulated / self.seconds

    def add(self, seconds: float, simulated: float, missed: int) -> None:
        """Add a control cycle."""
        self.seconds += seconds
        self.simulated += simulated
        self.cycles += 1
        self.missed += missed

    def __str__(self) -> str:
        all_cycles = self.cycles + self.missed
        return (
            f"real-time factor {self.factor:.2g} in the last {self.seconds:.0f} s, "
            f"{self.missed} of {all_cycles} control cycles missed"
        )


class PaceMeter:
    """Measures the pace of a control loop, and reports it each second.

    Attributes:
        wanted: simulated seconds per real second; 0: as fast as possible.
    """

    def __init__(
        self,
        measured: Callable[[Pace, bool], None] = lambda pace, is_slow: None,
        log: Callable[[str, bool], None] = lambda text, is_slow: None,
    ) -> None:
        """Prepare; call ``set`` to start measuring.

        Args:
            measured: called about once a second with its pace, and whether that is slow.
            log: called with a line to log, and whether the pace is slow: once when it falls, and
                once when it is back.
        """
        self._measured, self._log = measured, log
        self._is_slow = False

    def set(self, due: float, wanted: float) -> None:
        """Start measuring at the cycle due at ``due`` (monotonic, s), for a wanted factor."""
        self._due, self.wanted = due, wanted
        self._second, self._steady = Pace(), Pace()

    def skip(self, due: float) -> None:
        """Leave out the time until ``due`` (monotonic, s): simulated time was paused."""
        self._due = due

    def cycle(self, due: float, simulated: float, missed: int) -> None:
        """Count a control cycle.

        Args:
            due: when the next cycle is due, monotonic, s.
            simulated: simulated duration of the cycle, s.
            missed: number of cycles that were left out after it.
        """
        seconds, self._due = due - self._due, due
        self._second.add(seconds, simulated, missed)
        self._steady.add(seconds, simulated, missed)
        if self._second.seconds >= _SECOND:
            self._report()

    def _report(self) -> None:
        pace, self._second = self._second, Pace()
        is_slow = pace.factor < _SLOW * self.wanted
        self._measured(pace, is_slow)
        if pace.factor < _BACK * self.wanted:
            self._steady = Pace()
        if is_slow and not self._is_slow:
            self._is_slow = True
            self._log(f"slow motion: {pace}", True)
        elif self._is_slow and self._steady.seconds >= _STEADY:
            self._is_slow = False
            self._log(f"the pace is back: {self._steady}", False)


class PaceReports:
    """Reports the pace of a control loop on /diagnostics, and in the log when it falls.

    Attributes:
        meter: measures the pace.
    """

    def __init__(self, node: Node, wanted: Callable[[], float]) -> None:
        """Publish and log as ``node``; ``wanted`` returns the real_time_factor wanted."""
        self._node, self._wanted = node, wanted
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", _DEPTH)
        self.meter = PaceMeter(self._publish, self._log)

    def _publish(self, pace: Pace, is_slow: bool) -> None:
        """Publish the real-time factor of the last second, from the control thread."""
        values = {
            "real_time_factor": f"{pace.factor:.3f}",
            "wanted real_time_factor": f"{self._wanted():g}",
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

    def _log(self, text: str, is_slow: bool) -> None:
        if is_slow:  # rclpy allows only one severity per line of code
            text = f"{text}; the CPU is overloaded, or the process was stopped"
            self._node.get_logger().warning(text)
        else:
            self._node.get_logger().info(text)
