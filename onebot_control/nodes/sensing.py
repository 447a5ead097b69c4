"""Measures when a sensor is due and somebody subscribes to it: at once, or in a thread."""

import threading
import time
from collections.abc import Callable, Mapping, Sequence
from queue import SimpleQueue
from typing import Any, Protocol

from onebot_control.driven_robot import Snapshot
from onebot_control.fleet import Divider
from onebot_control.poses import Transform
from onebot_control.sensing.instruments import Frame, Instrument, Sensors
from onebot_control.sensing.surroundings import SensedRobot
from onebot_description.description.description import Camera, Imu, Lidar

# Measurements of a sensor that may wait, in the order in which those of a robot are made.
_WAITING = {Imu: 50, Lidar: 4, Camera: 1}
_FIRST_REPORT, _REPORT = 10.0, 60.0  # s between reports of dropped measurements
_ENOUGH = 0.95  # share of the measurements due; a smaller one is reported
_PATIENCE = 10.0  # s for the thread to end


class Outlet(Protocol):
    """Where measurements go.

    Attributes:
        topics: by output.
    """

    @property
    def topics(self) -> Mapping[str, str]:
        """The topic of each output."""

    def wanted(self) -> frozenset[str]:
        """Return the outputs that somebody wants: keys of ``Sensor.topics``."""

    def publish(self, stamp: int, outputs: Mapping[str, Any]) -> None:
        """Publish arrays by output, measured at ``stamp``, ns."""


class Channel:
    """A sensor, and where its measurements go.

    Attributes:
        instrument: the sensor.
        outlet: takes the measurements.
        divider: picks the control cycles in which it is due.
        given: measurements that the control thread has asked for.
        done: those that were made.
        dropped: those that were not asked for, although somebody subscribes to them.
    """

    def __init__(self, instrument: Instrument, outlet: Outlet, cycles: float) -> None:
        """Measure at ``cycles`` control cycles a second."""
        self.instrument, self.outlet = instrument, outlet
        self.divider = Divider(instrument.rate, cycles)
        self.given = self.done = self.dropped = 0
        self._next_report, self._reported = 0.0, (0, 0)  # monotonic s; done and dropped before

    @property
    def busy(self) -> bool:
        """Whether no more measurements may wait."""
        return self.given - self.done > _WAITING[type(self.instrument.sensor.model)]

    def warning(self, now: float) -> str:
        """Return what to warn of at a time, s: once a minute, if too few measurements were made."""
        self._next_report = self._next_report or now + _FIRST_REPORT
        if now < self._next_report:
            return ""
        done, dropped = self.done - self._reported[0], self.dropped - self._reported[1]
        self._next_report, self._reported = now + _REPORT, (self.done, self.dropped)
        share = done / (done + dropped)
        if share >= _ENOUGH:
            return ""
        rate, name = self.instrument.rate, self.instrument.sensor.name
        text = f'sensor "{name}" reaches {share * rate:.3g} of {rate:g} Hz'
        return f"{text}: measuring takes too long; lower its rate or its size"


class Sensing:
    """Measures what is due, at once.

    ``due``, ``take`` and ``enter`` are for the control cycle.
    """

    def __init__(self, sensors: Sensors) -> None:
        """Get ready; ``start`` has to follow."""
        self._sensors = sensors
        self._channels: dict[int, list[Channel]] = {}
        self._due: list[tuple[Channel, frozenset[str]]] = []
        self._last: Sequence[Snapshot] | None = None

    def start(self) -> None:
        """Start to measure.

        The surroundings of robots with sensors are built here: reading meshes would hold up the
        loop.
        """
        if any(self._channels.values()):
            self._sensors.prepare()

    def stop(self) -> None:
        """End."""

    def restart(self, seed: int) -> None:
        """Begin again, as at the start, with noise by a seed."""
        self.flush()
        self._last = None
        self._sensors.restart()
        for channels in self._channels.values():
            for channel in channels:
                channel.divider.restart()
                channel.instrument.reseed(seed)

    def flush(self) -> None:
        """Wait until all that was taken is measured and published."""

    def asked(self, row: int) -> frozenset[str]:
        """Return the topics on which a robot's measurements are due in this control cycle."""
        return frozenset(
            channel.outlet.topics[output]
            for channel, outputs in self._due
            if channel.instrument.row == row
            for output in outputs
        )

    def enter(self, row: int, robot: SensedRobot, channels: Sequence[Channel]) -> None:
        """Sense by these ``channels`` of the robot of ``row`` from now on."""
        self._sensors.enter(row, robot)
        order = list(_WAITING)
        self._channels[row] = sorted(
            channels, key=lambda channel: order.index(type(channel.instrument.sensor.model))
        )

    def due(self, tick: int) -> frozenset[int]:
        """Return the rows of the robots of which measurements are due in a control cycle."""
        self._due = []
        if self._last is None or self._last[0].tick != tick:  # else simulated time stands still
            for channels in self._channels.values():
                for channel in channels:
                    if channel.divider.due() and (topics := channel.outlet.wanted()):
                        self._due.append((channel, topics))
        return frozenset(channel.instrument.row for channel, _ in self._due)

    def take(self, stamp: int, snapshots: Sequence[Snapshot], boxes: Sequence[Transform]) -> None:
        """Have what is due measured at a stamp, ns; ``boxes`` are poses of what can be pushed."""
        frame = self._sensors.frame(stamp, snapshots, self._last, boxes)
        for channel, topics in self._due:
            self._measure(channel, topics, frame)
        self._last = snapshots

    def _measure(self, channel: Channel, topics: frozenset[str], frame: Frame) -> None:
        outputs = channel.instrument.measure(self._sensors.world(frame), topics)
        channel.outlet.publish(frame.stamp, outputs)


class SensingThread(Sensing):
    """Measures in a thread, for which the control cycle does not wait.

    What is due while a sensor still has enough to do is dropped, the newest first; unless it is
    patient: then the cycle waits, and nothing is dropped.
    """

    def __init__(
        self,
        sensors: Sensors,
        warn: Callable[[str], object],
        failed: Callable[[BaseException], None],
        patient: Callable[[], bool] = lambda: False,
    ) -> None:
        """Get ready; ``start`` starts the thread, and ``failed`` gets the error that ends it."""
        super().__init__(sensors)
        self._warn, self._failed, self._patient = warn, failed, patient
        self._jobs: SimpleQueue[tuple[Channel, frozenset[str], Frame] | None] = SimpleQueue()
        self._stopped = False
        self._progress = threading.Condition()
        self._thread = threading.Thread(target=self._run, name="sensing", daemon=True)

    def start(self) -> None:
        """Start to measure; see ``Sensing``."""
        super().start()
        self._thread.start()

    def stop(self) -> None:
        """End the thread after what it is measuring."""
        self._end()
        self._jobs.put(None)
        if self._thread.is_alive():
            self._thread.join(_PATIENCE)

    def flush(self) -> None:
        """Wait for the thread."""
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
                if text := channel.warning(time.monotonic()):
                    self._warn(text)
        except BaseException as error:
            self._failed(error)
        finally:
            self._end()
