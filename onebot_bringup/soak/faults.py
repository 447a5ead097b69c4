"""The faults that a soak injects: what each does to the bringup, and what is to happen then.

A fault is a function that returns when the robot is well again, or when what was to happen has not
happened in time, which is a finding.
"""

import random
import signal
import subprocess
import sys
from collections.abc import Callable, Collection, Iterator
from functools import partial
from pathlib import Path
from typing import NamedTuple

from onebot_bringup.soak.network import set_link
from onebot_bringup.soak.processes import send, usage
from onebot_bringup.soak.watched_bringup import STOPPED, WatchedBringup

_STALLED, _CUT = 4.0, 5.0  # seconds
_PATIENCE = 20.0  # until what is to happen has not
_BRAKES = 6.0  # after the last command: the timeout, and 1 m/s at 0.5 m/s^2, with some more
_MOVING, _AT_REST = 0.1, 0.01  # m/s

# What stalls, and the topics that are silent meanwhile.
_STALLS = {
    "velocity_controller": ("",),
    "robot_state_publisher": ("robot_state_publisher/tf",),
    "rerun_viewer": (),
    "steering_page": (),
}
_RESTARTED = ("steering_page",)
_HELPERS = (*_RESTARTED, "rerun_viewer", "description_watcher")
_NEEDED = ("robot_state_publisher", "velocity_controller")
_FILES = {  # that are broken: who reads it, what it logs then, and when it is whole again
    "model": ("description_watcher", "The robot stays as it was", "mended, the robot is"),
    "view": ("rerun_viewer", "keeping the view shown so far", "is right again"),
}
_PAYLOAD = """  <link name="payload"><inertial><mass value="0.1"/>
    <inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="payload_joint" type="fixed"><parent link="base_link"/><child link="payload"/></joint>
"""


def stall(name: str, robot: WatchedBringup) -> None:
    """A process stands still for some seconds, with all that it has open."""
    pid = robot.require(name)
    with robot.excused(*_STALLS[name]):
        send(pid, signal.SIGSTOP)
        try:
            robot.run_for(_STALLED)
        finally:
            send(pid, signal.SIGCONT)
        robot.expect(robot.is_alive, _PATIENCE, f"messages after {name} stood still")


def break_file(name: str, robot: WatchedBringup) -> None:
    """A file that is followed is saved half, and then whole; the robot stays as it was."""
    reader, refused, mended = _FILES[name]
    robot.require(reader)
    file = robot.files[name]
    whole = file.read_text()
    _save(robot, file, whole[: len(whole) // 2] + "\n]<{", refused)
    _save(robot, file, whole, mended)


def _save(robot: WatchedBringup, file: Path, text: str, logged: str) -> None:
    before = len(robot.bringup.output)
    file.write_text(text)
    robot.expect(
        lambda: logged in robot.bringup.output[before:], _PATIENCE, f'"{logged}" in the output'
    )


def edit_model(robot: WatchedBringup) -> None:
    """The robot gets a payload, or loses it, as it drives."""
    robot.require("description_watcher")
    file, count = robot.files["model"], robot.descriptions
    text, end = file.read_text(), "</robot>"
    file.write_text(
        text.replace(_PAYLOAD, "") if _PAYLOAD in text else text.replace(end, _PAYLOAD + end)
    )
    robot.expect(lambda: robot.descriptions > count, _PATIENCE, "the edited robot_description")


def lose_driver(robot: WatchedBringup) -> None:
    """The process that drives is killed as it commands full speed: the robot brakes."""
    topic, kind = robot.command_topic, "geometry_msgs/msg/Twist"
    speed, turn = robot.fast
    command = f"{{linear: {{x: {speed}}}, angular: {{z: {turn}}}}}"

    def at_rest() -> bool:
        return robot.speed < _AT_REST

    words = ("topic", "pub", "-r", "20", topic, kind, command)
    with robot.other_driver():
        robot.expect(at_rest, _BRAKES, "the robot to stop without commands")
        driver = subprocess.Popen(
            [sys.executable, "-m", "onebot_bringup.cli.main", *words],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        try:
            robot.expect(lambda: robot.speed > _MOVING, _PATIENCE, "the robot to drive")
            robot.run_for(1.0)
            robot.remember_segments(driver.pid)
        finally:
            driver.kill()
            driver.wait()
        robot.expect(at_rest, _BRAKES, "the robot to stop when its driver is lost")


def kill_helper(name: str, robot: WatchedBringup) -> None:
    """A node is killed that the robot can do without: another starts, or all go on without it."""
    pid = robot.require(name)
    robot.missing.add(name)
    robot.kill(pid)
    if name not in _RESTARTED:
        robot.run_for(1.0)
    elif robot.expect(
        lambda: robot.bringup.nodes().get(name, pid) != pid, _PATIENCE, f"another {name}"
    ):
        robot.missing.discard(name)


def kill_needed(name: str, robot: WatchedBringup) -> None:
    """A node is killed that the robot needs: the bringup ends, and names it."""
    pid = robot.require(name)
    with robot.excused(""):
        robot.missing |= robot.nodes
        robot.kill(pid)
        robot.expect(lambda: robot.bringup.ended, STOPPED, f"the end without {name}")
        failed = robot.bringup.output.rpartition("failed: ")[2]
        if robot.bringup.process.returncode != 1 or f"{name} (" not in failed:
            robot.find(f"the end without {name}: not with exit code 1 and its name last")
        robot.start()


def kill_launcher(robot: WatchedBringup) -> None:
    """The launcher is killed: its guard ends all nodes."""
    with robot.excused(""):
        robot.missing |= robot.nodes
        left = robot.bringup.nodes().values()
        robot.kill(robot.bringup.process.pid)
        robot.expect(lambda: not any(map(usage, left)), STOPPED, "the end of all nodes")
        robot.start()


def cut_link(robot: WatchedBringup) -> None:
    """The network is away for some seconds, under processes that have nothing else to talk by."""
    if not robot.over_network:
        robot.restart(FASTDDS_BUILTIN_TRANSPORTS="UDPv4")
    with robot.excused(""):
        set_link(False)
        try:
            robot.run_for(_CUT)
        finally:
            set_link(True)
        robot.expect(robot.is_alive, _PATIENCE, "messages after the link was cut")
    robot.expect(lambda: robot.speed > _AT_REST, _PATIENCE, "the robot to drive again")


class Fault(NamedTuple):
    """One kind of fault."""

    inject: Callable[[WatchedBringup], None]
    needs: str = ""  # the node without which it cannot be injected


NETWORK = "a network of one's own"  # what is needed to cut it
# Those that leave all processes running come alone at first, so that leaks show.
GENTLE = {
    **{f"stall-{name}": Fault(partial(stall, name), name) for name in _STALLS},
    **{f"break-{name}": Fault(partial(break_file, name), _FILES[name][0]) for name in _FILES},
    "edit-model": Fault(edit_model, "description_watcher"),
    "lose-driver": Fault(lose_driver),
}
FAULTS = {
    **GENTLE,
    **{f"kill-{name}": Fault(partial(kill_helper, name), name) for name in _HELPERS},
    **{f"kill-{name}": Fault(partial(kill_needed, name), name) for name in _NEEDED},
    "kill-launcher": Fault(kill_launcher),
    "restart": Fault(WatchedBringup.restart),
    "cut-link": Fault(cut_link, NETWORK),
}


def possible(names: Collection[str], there: Collection[str]) -> set[str]:
    """Return the faults that can be injected where there are these nodes, or ``NETWORK``."""
    return {name for name in names if FAULTS[name].needs in ("", *there)}


def shuffled(names: Collection[str], chance: random.Random) -> Iterator[str]:
    """Yield names without end, if there are any; each once before any comes again."""
    while names:
        yield from chance.sample(sorted(names), len(names))
