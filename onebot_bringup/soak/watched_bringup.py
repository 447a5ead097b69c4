"""A bringup that is driven and watched: what it publishes, and what its processes use."""

import math
import random
import shutil
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

from onebot_bringup.cli.session import Session
from onebot_bringup.soak.processes import (
    BringupProcess,
    segments,
    send,
    usage,
    waited_for_processor,
)
from onebot_bringup.soak.watch import OdometryCheck, Watch, clock
from onebot_control.poses import PlanarPose
from onebot_description.description.packages import package_share
from onebot_description.errors import OneBotError
from onebot_description.shared_memory import YOUNG, find_segments

STOPPED = 6.5  # s; the launcher promises 5
_STARTED, _SETTLED = 60.0, 3.0  # s until a robot is there, and until its rates are judged
_COMMANDS, _LASTS = 0.05, 4.0  # s between two, and for which the speeds stay
_POLL, _SAMPLES = 1.0, 2.0  # s
_LATE = 0.5  # s that this process was not run for: the machine is too busy to judge the robot
_BUSY = 0.1  # of the time waiting for a processor: then no rate is judged
_LAST = 4.0  # s after Ctrl-C, until it is killed
_MEMORY_LIMIT = "4MB"  # of the viewer, which would go on growing for long
_JOINTS, _ODOMETRY = 100.0, 50.0  # Hz
_MOST_TF = 4  # robots whose /tf can be read beside
_QUEUE = 1000  # messages


class WatchedBringup:
    """Starts bringups one after the other; drives, and gives what it measures to a ``Watch``."""

    def __init__(
        self,
        session: Session,
        watch: Watch,
        folder: Path,
        words: Sequence[str] = (),
        *,
        robots: int = 1,
        seed: int = 1,
        patience: float = 1.0,
        log: Path | None = None,
    ) -> None:
        """Nothing is started yet.

        Args:
            session: its node drives and subscribes.
            watch: judges.
            folder: for copies of the files that can be broken.
            words: further arguments of the bringup.
            robots: how many it is to have.
            seed: of the commands.
            patience: a factor for the time in which things are to happen.
            log: a file for the bringup's output.
        """
        self.session, self.watch = session, watch
        self._began = time.time()
        self._robots, self._words, self._patience = robots, words, patience
        self._chance = random.Random(seed)
        self._log = log or folder / "log"
        self.files = _copied_files(folder)
        self.starts, self.machine_busy = 0, 0.0  # the latter in s
        self._bringup: BringupProcess | None = None
        self.nodes: set[str] = set()  # that the bringup has when all is well
        self.missing: set[str] = set()  # of them, those that need not be there now
        self._segments: set[Path] = set()  # of all processes so far
        self.over_network = False
        self.descriptions, self.speed = 0, 0.0  # received; m/s of the first robot
        self._driving, self._next_command = True, -math.inf
        self._called = self._polled = 0.0
        self._waited = waited_for_processor()
        self._subscribe()

    def _subscribe(self) -> None:
        from geometry_msgs.msg import Twist
        from nav_msgs.msg import Odometry
        from sensor_msgs.msg import JointState
        from std_msgs.msg import String

        from onebot_description.node import LATCHED
        from onebot_description.wire.tf_message import TFMessage

        node = self.session.node
        spaces = [f"/robot{n + 1}" for n in range(self._robots)] if self._robots > 1 else [""]
        self.command_topic = f"{spaces[0]}/velocity_controller/cmd_vel"
        self.fast = (0.1, 1.0) if self._robots > 1 else (0.5, 0.5)  # m/s and rad/s
        self._twist = Twist()
        self._publishers = [
            node.create_publisher(Twist, f"{space}/velocity_controller/cmd_vel", 10)
            for space in spaces
        ]
        self._drives: list[OdometryCheck] = []
        for space in dict.fromkeys((spaces[0], spaces[-1])):  # of more there is not the time
            drive = OdometryCheck(self.watch, space or "robot")
            self._drives.append(drive)
            for kind, name, callback in (
                (JointState, "joint_states", self._on_joints),
                (Odometry, "velocity_controller/odom", partial(self._on_odometry, drive, False)),
                (Odometry, "velocity_controller/ground_truth",
                 partial(self._on_odometry, drive, space == spaces[0])),
            ):  # fmt: skip
                topic = f"{space}/{name}"
                node.create_subscription(kind, topic, partial(callback, topic), _QUEUE, raw=True)
        if self._robots <= _MOST_TF:
            node.create_subscription(TFMessage, "/tf", self._on_tf, _QUEUE, raw=True)
        topic = f"{spaces[0]}/robot_description"
        node.create_subscription(String, topic, self._on_description, LATCHED)
        node.create_timer(_COMMANDS, self._drive)
        node.create_timer(_SAMPLES, self._sample)

    @property
    def bringup(self) -> BringupProcess:
        """The one that runs, or ran last."""
        assert self._bringup is not None
        return self._bringup

    @property
    def now(self) -> float:
        """Seconds since the soak began."""
        return time.time() - self._began

    # What it publishes

    def _seconds(self, stamp_ns: int) -> float:
        return stamp_ns * 1e-9 - self._began

    def _on_joints(self, topic: str, data: bytes) -> None:
        from onebot_description.wire.messages import one_joint_state

        now, joints = self.now, one_joint_state(data)
        self.watch.message(topic, _JOINTS, now, self._seconds(joints.stamp_ns))
        self.watch.values(topic, now, joints.positions, joints.velocities, joints.efforts)

    def _on_odometry(self, drive: OdometryCheck, first: bool, topic: str, data: bytes) -> None:
        from onebot_description.wire.messages import odometry_sample

        now, sample = self.now, odometry_sample(data)
        stamp = self._seconds(sample.stamp_ns)
        self.watch.message(topic, _ODOMETRY, now, stamp)
        self.watch.values(topic, now, *sample[3:])
        (x, y, _), (_, _, z, w) = sample.translation, sample.rotation
        is_truth = topic.endswith("truth")
        (drive.truth if is_truth else drive.odometry)(
            stamp, PlanarPose(x, y, 2.0 * math.atan2(z, w))
        )
        if is_truth and first:
            self.speed = abs(sample.linear[0]) + 0.1 * abs(sample.angular[2])

    def _on_tf(self, data: bytes) -> None:
        from onebot_description.wire.messages import tf_arrays

        now, tf = self.now, tf_arrays(data)
        self.watch.values("/tf", now, tf.translations, tf.rotations)
        stamps: dict[tuple[str, float], int] = {}  # by topic and rate; links of a robot have one
        for child, stamp_ns in zip(tf.children, tf.stamps_ns, strict=True):
            prefix, slash, link = child.rpartition("/")
            node, rate = (
                ("velocity_controller", _ODOMETRY)
                if link == "base_link"
                else ("robot_state_publisher", _JOINTS)
            )
            stamps[f"{slash}{prefix}/{node}/tf", rate] = int(stamp_ns)
        for (topic, rate), stamp_ns in stamps.items():
            self.watch.message(topic, rate, now, self._seconds(stamp_ns))

    def _on_description(self, message: Any) -> None:
        self.descriptions += 1

    # The timers

    def _drive(self) -> None:
        now = self.now
        if now - self._called > _LATE and self._called:
            self.watch.excuse(self._called).end = now + _LATE
        self._called = now
        if now > self._next_command:
            self._next_command = now + _LASTS
            speed, turn = self._chance.uniform(-0.5, 0.5), self._chance.uniform(-1.0, 1.0)
            if self._robots > 1:  # small circles, in which they do not meet
                speed, turn = 0.1 * abs(turn), abs(turn)
            self._twist.linear.x, self._twist.angular.z = speed, turn
        for publisher in self._publishers if self._driving else ():
            publisher.publish(self._twist)
        if (passed := now - self._polled) > _POLL:
            waited, self._waited = waited_for_processor() - self._waited, waited_for_processor()
            busy = waited > _BUSY * passed
            self.machine_busy += passed if busy and self._polled else 0.0
            self._polled = now
            self.watch.poll(now, busy=busy)

    def _sample(self) -> None:
        if self._bringup is None or self.bringup.ended:
            if self.nodes - self.missing:
                self.find("the bringup has ended")
                self.missing |= self.nodes
            return
        nodes = self.bringup.nodes()
        for name in self.nodes - self.missing - set(nodes):
            self.find(f"{name} has ended")
            self.missing.add(name)
        for name, pid in {**nodes, "launcher": self.bringup.process.pid}.items():
            if used := usage(pid):
                self.watch.process(name, pid, self.now, **used)
                self._segments |= segments(pid)

    # The bringup

    def start(self, **environment: str) -> None:
        """Start one, and wait until it runs.

        Raises:
            OneBotError: it does not.
        """
        self.report("starting onebot_bringup ...")
        if self._bringup is not None:
            self._bringup.process.kill()  # where it should have ended, but has not
        self.over_network, self.missing = bool(environment), set(self.nodes)
        for drive in self._drives:
            drive.restart()
        began = self.now
        words = [f"model:={self.files['model']}", f"view:={self.files['view']}"]
        words += ["steer:=true", "port:=0", *self._words]
        words += [f"robots:={self._robots}"] if self._robots > 1 else []
        words += ["--ros-args", "-p", f"rerun_viewer:memory_limit:={_MEMORY_LIMIT}"]
        with self.excused(""):
            bringup = self._bringup = BringupProcess(words, self._log, environment)
            self.starts += 1
            self.session.spin(
                lambda: bringup.ended or self._has_started(bringup, began),
                _STARTED * self._patience,
            )
            if bringup.ended or not self._has_started(bringup, began):
                raise OneBotError(f"onebot_bringup does not start:\n{bringup.output[-2000:]}")
            self.run_for(_SETTLED)
            self.nodes = self.nodes or set(bringup.nodes())
        self.missing.clear()
        self._judge_segments(began)

    def _has_started(self, bringup: BringupProcess, began: float) -> bool:
        streams = self.watch.streams.values()
        there = self.nodes <= set(bringup.nodes())
        return there and bool(streams) and all(stream.stamp > began for stream in streams)

    def _judge_segments(self, began: float) -> None:
        """What killed processes left in shared memory is to be gone after the next start."""
        left = self._segments & set(find_segments().stale)
        old = [s for s in left if s.exists() and s.stat().st_mtime < self._began + began - YOUNG]
        if old:
            amount = f"{len(old)} segments"
            self.find("shared memory of killed processes is left", amount, len(old))

    def restart(self, **environment: str) -> None:
        """End it with Ctrl-C, and start another."""
        with self.excused(""):
            self.stop(STOPPED * self._patience)
            self.start(**environment)

    def stop(self, within: float = _LAST) -> None:
        """Press Ctrl-C; kill it if it does not end within some seconds."""
        if self._bringup is None:
            return
        bringup = self._bringup
        if not bringup.ended:
            expected = 1 if self.missing else 0  # nodes that were killed, which have failed
            self.missing |= self.nodes
            began = self.now
            bringup.process.send_signal(signal.SIGINT)
            try:
                self.session.spin(lambda: bringup.ended, within)
            finally:  # also after another Ctrl-C
                killed = not bringup.ended
                bringup.process.kill()
                bringup.process.wait()
            self.watch.stops.append(self.now - began)
            if killed:
                self.find("the bringup does not end after Ctrl-C", f"in {within:g} s")
            elif (code := bringup.process.returncode) != expected:
                self.find("after Ctrl-C", f"exit code {code} instead of {expected}")
        if "Traceback" in bringup.output:
            where = bringup.output.partition("Traceback")[2].splitlines()
            self.find("a traceback in the output", " / ".join(map(str.strip, where[-8:])))

    # What faults use

    def run_for(self, seconds: float) -> None:
        """Drive and watch for some time."""
        self.session.spin_until(time.monotonic() + seconds)

    def expect(self, condition: Callable[[], Any], timeout: float, what: str) -> bool:
        """Wait for something; that it does not come is a finding."""
        timeout *= self._patience
        came = bool(self.session.spin(condition, timeout))
        if not came:
            self.find(f"missing: {what}", f"waited for {timeout:g} s")
        return came

    def find(self, what: str, amount: str = "", size: float = 0.0) -> None:
        """Add a finding of now."""
        self.watch.find(self.now, what, amount, size)

    def report(self, text: str) -> None:
        """Print a line of progress."""
        print(f"{clock(self.now)}  {text}", flush=True)

    def is_alive(self) -> bool:
        """Whether all topics are being received."""
        return self.watch.is_alive(self.now)

    @contextmanager
    def excused(self, *topics: str) -> Iterator[None]:
        """Explain gaps of topics with these parts in their names, for this time; "": of all."""
        excuse = self.watch.excuse(self.now, *topics) if topics else None
        try:
            yield
        finally:
            if excuse is not None:
                excuse.end = self.now + _LATE

    @contextmanager
    def other_driver(self) -> Iterator[None]:
        """Leave the driving to another process."""
        self._driving = False
        try:
            yield
        finally:
            self._driving = True

    def require(self, name: str) -> int:
        """Return the process id of a node; start another bringup if the node was killed."""
        if name not in self.bringup.nodes():
            self.restart()
        return self.bringup.nodes()[name]

    def kill(self, pid: int) -> None:
        """Kill a process."""
        self.remember_segments(pid)
        send(pid, signal.SIGKILL)

    def remember_segments(self, pid: int) -> None:
        """Note what shared memory a process uses, which is to be removed after it."""
        self._segments |= segments(pid)


def _copied_files(folder: Path) -> dict[str, Path]:
    """Copy the files that are broken and edited, with what they include; return them."""
    share = package_share("onebot_description")
    shutil.copytree(share / "urdf", folder / "urdf")
    shutil.copy(share / "config/view.yaml", folder)
    return {"model": folder / "urdf/onebot.urdf.xacro", "view": folder / "view.yaml"}
