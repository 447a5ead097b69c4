"""Runs a bringup for a test."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import AbstractContextManager
from tempfile import TemporaryFile
from unittest.mock import patch

from onebot_bringup.launch.bringup import UP
from onebot_bringup.launch.nodes import BRINGUPS
from onebot_bringup.launcher.orphans import die_with_this_thread
from onebot_description.errors import OneBotError, did_you_mean
from onebot_description.parameters.arguments import checked_methods
from onebot_description.ros.discovery import configure_discovery

_START = 60.0  # s for the robot to be up
_STOP = 30.0  # s; the launcher itself kills nodes that have not ended after 4 s
_POLL = 0.02  # s
_STEP = "simulation_interfaces/srv/StepSimulation"


@checked_methods()
class RunningBringup(AbstractContextManager["RunningBringup"]):
    """A bringup in separate processes, with real time and real discovery.

    It ends with the ``with`` block, and also if this process is killed or the thread that started
    it ends.
    """

    def __init__(self, command: str, words: Sequence[str]) -> None:
        """Start the bringup, and wait until its robots publish joint states, or are paused.

        Args:
            command: "onebot_bringup" or "mrm_bringup".
            words: its arguments, such as "world:=maze".

        Raises:
            OneBotError: there is no such command, or it ended, or was not up after a minute; the
                message has its output.
        """
        if command not in BRINGUPS:
            raise OneBotError(f'no bringup "{command}"{did_you_mean(command, BRINGUPS)}')
        self._log = TemporaryFile("w+")  # unnamed, so it goes even if this process is killed
        self._process = subprocess.Popen(
            [sys.executable, "-m", BRINGUPS[command], "viewer:=none", *words],
            stdin=subprocess.DEVNULL,
            stdout=self._log,
            stderr=subprocess.STDOUT,
            start_new_session=True,
            preexec_fn=die_with_this_thread(signal.SIGTERM),  # it removes its own folder
        )
        try:
            self._await_robots()
        except BaseException:
            self.stop()
            raise

    @property
    def output(self) -> str:
        """Everything it has printed so far."""
        size = os.fstat(self._log.fileno()).st_size
        # Do not seek: the bringup shares this file's position.
        return os.pread(self._log.fileno(), size, 0).decode(errors="replace")

    def stop(self) -> int:
        """Stop the bringup as Ctrl-C does, and wait for its end; return the exit code."""
        if self._process.poll() is None:
            self._process.send_signal(signal.SIGINT)
        try:
            return self._process.wait(_STOP)
        except subprocess.TimeoutExpired:
            self._process.kill()
            return self._process.wait()

    def __exit__(self, *_: object) -> None:
        self.stop()
        print(self.output)  # pytest shows it if the test has failed
        self._log.close()

    def _await_robots(self) -> None:
        """Wait until the bringup has reported that it is up, and so have its robots.

        They publish joint states, or, because they may be paused, offer the services that step.
        """
        import rclpy
        from rclpy.executors import SingleThreadedExecutor
        from sensor_msgs.msg import JointState

        context = rclpy.Context()
        with patch.dict(os.environ):
            configure_discovery()  # the same settings as the robots'
            rclpy.init(args=[], context=context)
        node = rclpy.create_node("bringup_test", context=context)
        executor = SingleThreadedExecutor(context=context)
        executor.add_node(node)
        received: list[JointState] = []
        try:
            deadline = time.monotonic() + _START
            services: dict[str, list[str]] = {}
            while not (UP in self.output and (received or [_STEP] in services.values())):
                if self._process.poll() is not None:
                    raise OneBotError(f"the bringup has ended:\n{self.output}")
                if time.monotonic() > deadline:
                    raise OneBotError(f"not up after {_START:g} s:\n{self.output}")
                topics = dict(node.get_topic_names_and_types())
                for topic in topics.keys() - {sub.topic_name for sub in node.subscriptions}:
                    if topic.endswith("joint_states"):
                        node.create_subscription(JointState, topic, received.append, 10)
                executor.spin_once(timeout_sec=_POLL)
                services = dict(node.get_service_names_and_types())
        finally:
            executor.shutdown()
            node.destroy_node()
            rclpy.shutdown(context=context)
