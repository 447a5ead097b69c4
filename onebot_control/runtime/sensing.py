"""Measures with due sensors that have subscribers, immediately or in a thread."""

import threading
from collections.abc import Callable, Mapping, Sequence
from queue import SimpleQueue
from typing import Any, Protocol

from onebot_control.controlled_robot import Snapshot
from onebot_control.physics.contacts import Contact
from onebot_control.runtime.pacing import Divider
from onebot_control.sensing.instrument import Frame, Instrument
from onebot_control.sensing.sensors import Sensors
from onebot_control.sensing.surroundings import SensedRobot
from onebot_description.geometry.poses import Transform
from onebot_description.timing.throttled import Throttled

_REPORT = 60.0  # s between reports of dropped measurements
_WINDOW, _MIN_TIME = 100, 10.0  # due measurements that are checked together; seconds if slow
_ENOUGH = 0.95  # minimum fraction of these measurements that must be made
_PATIENCE = 10.0  # s to wait for the end of the thread


class Outlet(Protocol):
    """Publishes the measurements of one sensor."""

    @property
    def topics(self) -> Mapping[str, str]:
        """The topic of each output."""

    def wanted(self) -> frozenset[str]:
        """Return the outputs with subscribers."""

    def publish(self, stamp: int, outputs: Mapping[str, Any]) -> None:
        """Publish the outputs of a measurement at ``stamp``, ns."""


class Channel:
    """A sensor with its topics, and counts of its measurements.

    Attributes:
        instrument: makes the measurements.
        outlet: publishes the measurements.
        divider: selects the control cycles in which a measurement is due.
        given: number of measurements requested by the control thread.
        done: number of completed measurements.
        dropped: number of due measurements that were dropped despite subscribers.
    """

    def __init__(self, instrument: Instrument[Any], outlet: Outlet, cycles: float) -> None:
        """Measure at the instrument's rate; there are ``cycles`` control cycles per second."""
        self.instrument, self.outlet = instrument, outlet
        self.divider = Divider(instrument.rate, cycles)
        self.given = self.done = self.dropped = 0
        self._judged = (0, 0)  # done and dropped at the last check

    @property
    def busy(self) -> bool:
        """Whether the maximum number of measurements is waiting."""
        return self.given - self.done > self.instrument.waiting

    def warning(self) -> str:
        """Return a warning if too few of the last measurements were made, or ""."""
        done, dropped = self.done - self._judged[0], self.dropped - self._judged[1]
        if done + dropped < min(_WINDOW, _MIN_TIME * self.instrument.rate):
            return ""
        self._judged = self.done, self.dropped
        share = done / (done + dropped)
        if share >= _ENOUGH:
            return ""
        rate, name = self.instrument.rate, self.instrument.sensor.name
        text = f'sensor "{name}" reaches {share * rate:.3g} of {rate:g} Hz'
        return f"{text}: measuring takes too long; lower its rate or its size"


class Sensing:
    """Makes due measurements immediately, in the control cycle.

    ``due``, ``take`` and ``enter`` are called by the control thread.
    """

    def __init__(self, sensors: Sensors) -> None:
        """Prepare; call ``start`` afterwards."""
        self._sensors = sensors
        self._channels: dict[int, list[Channel]] = {}
        self._due: list[tuple[Channel, frozenset[str]]] = []
        self._tick: int | None = None  # number of the last cycle

    def start(self) -> None:
        """Start measuring.

        If there are sensors, the surroundings are built now, because reading meshes later would
        delay the loop.
        """
        if any(self._channels.values()):
            self._sensors.prepare()

    def stop(self) -> None:
        """Stop measuring."""

    def restart(self, seed: int) -> None:
        """Restart from the beginning, with the noise of this seed."""
        self.flush()
        self._tick = None
        self._sensors.restart()
        for channels in self._channels.values():
            for channel in channels:
                channel.divider.restart()
                channel.instrument.reseed(seed)

    def flush(self) -> None:
        """Wait until all requested measurements have been published."""

    def asked(self, row: int) -> frozenset[str]:
        """Return the topics on which a robot's measurements are due in this control cycle."""
        return frozenset(
            channel.outlet.topics[output]
            for channel, outputs in self._due
            if channel.instrument.row == row
            for output in outputs
        )

    def enter(self, row: int, robot: SensedRobot, channels: Sequence[Channel]) -> None:
        """Use these sensors of a robot from now on.

        Args:
            row: index of the robot in its fleet.
            robot: the robot as seen by sensors.
            channels: its sensors.
        """
        self._sensors.enter(row, robot)
        self._channels[row] = sorted(channels, key=lambda channel: -channel.instrument.waiting)

    def due(self, tick: int) -> frozenset[int]:
        """Find the measurements due in a control cycle; return the rows of their robots."""
        self._due = []
        if self._tick != tick:  # otherwise simulated time is paused
            for channels in self._channels.values():
                for channel in channels:
                    if channel.divider.due() and (topics := channel.outlet.wanted()):
                        self._due.append((channel, topics))
        return frozenset(channel.instrument.row for channel, _ in self._due)

    def take(
        self,
        stamp: int,
        snapshots: Sequence[Snapshot],
        boxes: Sequence[Transform],
        contacts: Callable[[int], Sequence[Contact]] = lambda row: (),
    ) -> None:
        """Make or queue all measurements that are due in this cycle.

        Args:
            stamp: stamp of the cycle, ns.
            snapshots: snapshots of the robots.
            boxes: poses of movable boxes in the world.
            contacts: returns the contacts of a robot in the last cycle.
        """
        instruments = [channel.instrument for channel, _ in self._due]
        touching = {item.row: contacts(item.row) for item in instruments if item.needs_contacts}
        frame = self._sensors.frame(stamp, snapshots, boxes, touching)
        for channel, topics in self._due:
            self._measure(channel, topics, frame)
        self._sensors.last, self._tick = snapshots, snapshots[0].tick

    def _measure(self, channel: Channel, topics: frozenset[str], frame: Frame) -> None:
        outputs = channel.instrument.measure(self._sensors.world(frame), topics)
        channel.outlet.publish(frame.stamp, outputs)


class SensingThread(Sensing):
    """Makes measurements in a thread, so that the control cycle does not wait for them.

    While too many measurements of a sensor are waiting, new ones are dropped; if ``patient`` is
    true, the control cycle waits instead, and nothing is dropped.
    """

    def __init__(
        self,
        sensors: Sensors,
        warn: Callable[[str], object],
        failed: Callable[[BaseException], None],
        patient: Callable[[], bool] = lambda: False,
    ) -> None:
        """Prepare; ``start`` starts the thread.

        Args:
            sensors: robots and surroundings.
            warn: logs a warning.
            failed: called with the error that ends the thread.
            patient: returns whether the control cycle waits instead of dropping measurements.
        """
        super().__init__(sensors)
        self._warn, self._failed, self._patient = Throttled(warn, _REPORT), failed, patient
        self._jobs: SimpleQueue[tuple[Channel, frozenset[str], Frame] | None] = SimpleQueue()
        self._stopped = False
        self._progress = threading.Condition()
        self._thread = threading.Thread(target=self._run, name="sensing", daemon=True)

    def start(self) -> None:
        """Start the thread; see ``Sensing``."""
        super().start()
        self._thread.start()

    def stop(self) -> None:
        """End the thread after its current measurement."""
        self._end()
        self._jobs.put(None)
        if self._thread.is_alive():
            self._thread.join(_PATIENCE)

    def flush(self) -> None:
        """Wait until the thread has published all requested measurements."""
        channels = [channel for channels in self._channels.values() for channel in channels]
        self._wait(lambda: all(channel.done == channel.given for channel in channels))

    def _wait(self, condition: Callable[[], bool]) -> None:
        """Wait until a condition holds, or the thread has ended."""
        with self._progress:
            self._progress.wait_for(lambda: condition() or self._stopped)

    def _end(self) -> None:
        with self._progress:
            self._stopped = True
            self._progress.notify_all()

    def _measure(self, channel: Channel, topics: frozenset[str], frame: Frame) -> None:
        if channel.busy and self._patient():
            self._wait(lambda: not channel.busy)
        if channel.busy:
            channel.dropped += 1
        else:
            channel.given += 1
            self._jobs.put((channel, topics, frame))

    def _run(self) -> None:
        try:
            while (job := self._jobs.get()) and not self._stopped:
                super()._measure(*job)
                channel = job[0]
                with self._progress:
                    channel.done += 1
                    self._progress.notify_all()
                if text := channel.warning():
                    self._warn(channel.instrument.sensor.name, text)
        except BaseException as error:
            self._failed(error)
        finally:
            self._end()
