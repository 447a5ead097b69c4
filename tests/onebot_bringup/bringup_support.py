"""Listens to a bringup as another program would, and finds every process that it started."""

import math
import os
import signal
import sys
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import psutil
import pytest

from onebot_description.elements.packages import use_environment_prefix
from onebot_description.ros.wire.interfaces import TFMessage
from tests.onebot_bringup.launcher_support import RunningCommand, alive
from tests.orphans import marked
from tests.ros_support import LATCHED, Peer
from tests.support import wait_for

MARK = "ONEBOT_TEST_MARK"


class Transforms(Peer):
    """A program of the user's own that receives /tf and /tf_static."""

    def __init__(self, domain: int) -> None:
        use_environment_prefix()
        super().__init__(domain, "listener")
        self.latest: dict[str, tuple[float, float]] = {}
        for topic, qos in (("/tf", 10), ("/tf_static", LATCHED)):
            self.node.create_subscription(TFMessage, topic, self._on_tf, qos)

    def _on_tf(self, message: TFMessage) -> None:
        for stamped in message.transforms:
            transform = stamped.transform
            self.latest[stamped.child_frame_id] = (transform.translation.z, transform.rotation.z)

    def of(self, frame: str) -> tuple[float, float] | None:
        """Return the latest height (m) and rotation.z of ``frame``, None if never received."""
        return self.latest.get(frame)

    def turned_to(self, angle: float, frame: str) -> Callable[[], bool]:
        """Return a condition: ``frame`` stands at ``angle`` rad about z."""

        def condition() -> bool:
            found = self.of(frame)
            return found is not None and abs(found[1] - math.sin(angle / 2)) < 1e-3

        return condition


@contextmanager
def bringups(folder: Path, *command: str) -> Iterator[Callable[..., RunningCommand]]:
    """Start a command with arguments, in ``folder``; nothing may be left of it afterwards."""
    started: list[RunningCommand] = []

    def start(*arguments: str) -> RunningCommand:
        started.append(RunningCommand(folder, [sys.executable, "-m", *command, *arguments]))
        return started[-1]

    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(MARK, str(uuid.uuid4()))
        yield start
        for running in started:
            running.close()
        assert left_behind() == []


def left_behind() -> list[int]:
    """Return the processes that the bringups of a test have started, at whatever remove."""
    return marked(f"{MARK}={os.environ[MARK]}")


def wait_for_robot(
    running: RunningCommand, transforms: Transforms, frame: str
) -> tuple[float, float]:
    """Wait for the first transform, but not if the command has given up."""

    def condition() -> tuple[float, float] | None:
        assert running.process.poll() is None, running.err
        return transforms.of(frame)

    found = wait_for(condition, "the first transform")
    assert found is not None
    return found


def stop(running: RunningCommand) -> None:
    """Press Ctrl-C and check that the end is what was promised."""
    assert running.interrupt() == 0
    assert "Traceback" not in running.out + running.err


def stop_by_first_signal(running: RunningCommand) -> None:
    """Press Ctrl-C and check that every node heeds it, however long the machine takes.

    The launcher stands still meanwhile: on a slow machine it would go on to the next signal. When
    it goes on, it finds its own SIGINT waiting, and all nodes gone.
    """
    nodes = nodes_of(running.process.pid)
    running.send(signal.SIGSTOP)
    running.send(signal.SIGINT)
    for pid in nodes.values():
        os.kill(pid, signal.SIGINT)
    try:
        for name, pid in nodes.items():
            wait_for(lambda pid=pid: not alive(pid), f"{name} to heed SIGINT")
    finally:
        running.send(signal.SIGCONT)
    assert running.wait() == 0
    assert "Traceback" not in running.out + running.err
    assert "has not stopped yet" not in running.err
    assert "stopped with an error" not in running.err


def nodes_of(launcher: int) -> dict[str, int]:
    """Return the nodes that a launcher runs now: module to process id."""
    interpreter, found = "onebot_bringup.launcher.interpreter", {}
    for process in psutil.Process(launcher).children():
        with suppress(psutil.Error):  # it ended while we looked
            words = process.cmdline()
            if interpreter in words:
                found[words[words.index(interpreter) + 1]] = process.pid
    return found
