"""``onebot soak``: its judge with series that must pass or fail, and a robot that is disturbed."""

import math
import os
import random
import re
from itertools import islice
from pathlib import Path

import numpy as np
import psutil
import pytest

from onebot_bringup.soak.faults import FAULTS, NETWORK, possible, shuffled
from onebot_bringup.soak.watch import OdometryCheck, Tolerances, Watch, growth
from onebot_control.poses import PlanarPose
from tests.onebot_bringup.cli_support import onebot, running
from tests.readme import CHECKOUT
from tests.support import wait_for

HZ = 50.0
ORIGIN = PlanarPose(0.0, 0.0, 0.0)
NODES = ("velocity_controller", "robot_state_publisher", "steering_page", "description_watcher")


def feed(watch: Watch, begin: float, end: float, rate: float = HZ, late: float = 0.0) -> None:
    """Messages of a topic between two times, with a poll each second."""
    for n in range(round(begin * rate), round(end * rate)):
        watch.message("/odom", HZ, n / rate + late, n / rate)
        if n % round(rate) == 0:
            watch.poll(n / rate)


def found(watch: Watch) -> list[str]:
    return [str(finding) for finding in watch.findings.values()]


def test_regular_messages_pass() -> None:
    """Also late by some milliseconds, and where a fault explains a gap."""
    watch = Watch()
    feed(watch, 0.0, 20.0, late=0.005)
    excuse = watch.excuse(20.0)
    watch.poll(25.0)
    excuse.end = 25.0
    feed(watch, 25.0, 60.0)
    assert not found(watch) and watch.is_alive(60.0)
    assert watch.streams["/odom"].slowest == pytest.approx(HZ, rel=0.05)


def test_a_gap_is_found_while_it_lasts_and_once() -> None:
    """What, when and how long; a fault of another topic, or a shorter one, explains nothing."""
    for explained in (0.0, 2.0):
        watch = Watch()
        feed(watch, 0.0, 20.0)
        watch.excuse(20.0, "/tf")
        watch.excuse(20.0).end = 20.0 + explained
        watch.poll(25.0)
        assert not watch.is_alive(25.0)
        assert "00:25  /odom: silent: for" in found(watch)[0]
        feed(watch, 25.0, 30.0)
        assert len(found(watch)) == 1 and watch.count == 1
        assert watch.findings["/odom: silent"].size == pytest.approx(5.0 - explained, abs=0.1)


def test_longer_gaps_are_found_where_no_processor_is_free() -> None:
    """Up to three times the limit messages may wait, or be lost, because nobody could read them."""
    for gap, count in ((2.5, 0), (3.5, 1)):
        watch = Watch()
        feed(watch, 0.0, 20.0)
        watch.poll(20.5, busy=True)
        watch.message("/odom", HZ, 20.0 + gap, 20.0 + gap)
        assert watch.count == count


def test_rates() -> None:
    """Half the rate is found, but not while the machine is busy or a fault goes on."""
    watch = Watch()
    feed(watch, 0.0, 20.0, rate=25.0)
    assert "/odom: slow: 25 Hz instead of 50 Hz" in found(watch)[0]
    busy = Watch()
    for second in range(20):
        feed(busy, second, second + 1, rate=25.0)
        busy.poll(second + 1.0, busy=True)
    assert not found(busy)
    disturbed = Watch()
    disturbed.excuse(0.0)
    feed(disturbed, 0.0, 20.0, rate=25.0)
    assert not found(disturbed)


def test_stamps_and_numbers() -> None:
    """Stamps that go back or lie in the future, and NaN; the same stamp twice is none of these."""
    watch = Watch()
    for received, stamp in ((1.0, 1.0), (1.1, 1.0), (1.2, 0.9), (1.3, 1.5)):
        watch.message("/odom", HZ, received, stamp)
    watch.values("/tf", 2.0, np.array([1.0, 2.0]), np.array([]))
    watch.values("/tf", 3.0, np.array([1.0]), np.array([0.0, math.nan]))
    watch.values("/tf", 4.0, np.array([math.inf]))
    assert found(watch) == [
        "00:01  /odom: stamps go back: by 0.100 s",
        "00:01  /odom: stamps in the future: by 0.200 s",
        "00:03  /tf: NaN or infinite (2 times until 00:04)",
    ]


@pytest.mark.parametrize(
    ("shape", "least", "most"),
    [
        (lambda t: 100.0 + t / 60.0, 24.0, 26.0),  # a leak
        (lambda t: 100.0 + t // 180.0 * 3.0, 15.0, 30.0),  # one at each fault
        (lambda t: 100.0 + random.gauss(0.0, 5.0) + t / 60.0, 16.0, 27.0),
        (lambda t: 100.0, 0.0, 0.0),
        (lambda t: 100.0 + random.gauss(0.0, 5.0), -50.0, 5.0),
        (lambda t: 100.0 + (t > 700.0) * 50.0, 0.0, 1.0),  # the first edit of a file
        (lambda t: 100.0 + t % 300.0 / 10.0, -50.0, 5.0),  # collected again and again
        (lambda t: 100.0 - t / 60.0, -40.0, -24.0),
        (lambda t: 100.0 + 50.0 * (1.0 - math.exp(-t / 60.0)), 0.0, 8.0),  # warms up for long
    ],
)
def test_growth(shape, least: float, most: float) -> None:
    """Of 25 minutes: steady growth counts, also in steps; what grows once or twice does not."""
    random.seed(1)
    times = np.arange(0.0, 1500.0, 2.0)
    assert least <= growth(times, [shape(t) for t in times]) <= most


def test_leaks_of_processes() -> None:
    """Each process by itself: that of a restarted node does not go on from the one before."""
    watch = Watch(Tolerances(warm_up=60.0))
    for n in range(300):
        at = 2.0 * n
        pid = 1 + n // 100  # restarted: each grows while it starts
        memory = 50.0 + min(at % 200.0, 50.0)
        watch.process("well", pid, at, memory=memory, handles=20.0 + n % 3, threads=5.0)
        watch.process("leak", 9, at, memory=50.0 + at / 10.0, handles=20.0 + at / 20.0, threads=5.0)
    watch.judge_growth()
    assert found(watch) == [
        "09:58  leak (9): memory grow: 54 MB more in 538 s, now 110 MB",
        "09:58  leak (9): handles grow: 27 more in 538 s, now 50",
    ]
    assert watch.used_now()[-1]["threads"] == 5.0
    assert "  well, 3 processes, one for 198 s: memory 90 to 100" in "\n".join(watch.report())


def drive(watch: Watch, slip: float, *, start: PlanarPose = ORIGIN) -> OdometryCheck:
    """A circle by odometry, of which the truth, in another frame, falls short by a part."""
    robot = OdometryCheck(watch, "robot")
    for n in range(1000):
        angle = n * 0.01
        stamp = n * 0.02
        robot.odometry(stamp, PlanarPose(math.sin(angle), 1.0 - math.cos(angle), angle))
        angle *= 1.0 - slip
        x, y = math.sin(angle), 1.0 - math.cos(angle)
        cos, sin = math.cos(start.yaw), math.sin(start.yaw)
        robot.truth(
            stamp,
            PlanarPose(start.x + cos * x - sin * y, start.y + sin * x + cos * y, start.yaw + angle),
        )
    return robot


def test_odometry_against_the_truth() -> None:
    """From wherever it starts; slipping wheels and a jump are found."""
    watch = Watch()
    robot = drive(watch, 0.0, start=PlanarPose(3.0, -2.0, 1.0))
    assert (
        not found(watch) and robot.worst < 1e-9 and robot.distance == pytest.approx(10.0, rel=0.01)
    )
    slipping = Watch()
    drive(slipping, 0.05)
    assert {"robot: odometry error", "robot: heading error"} == set(slipping.findings)
    robot.truth(20.0, PlanarPose(9.0, 9.0, 1.0))
    assert list(watch.findings) == ["robot: jumps"]
    robot.restart()
    robot.truth(21.0, ORIGIN)
    assert watch.count == 1


def test_faults_are_chosen_by_seed() -> None:
    """Each once before any comes again, in an order that can be repeated."""
    names = possible(FAULTS, NODES)
    assert {"stall-velocity_controller", "kill-launcher", "restart", "lose-driver"} <= names
    assert not {"stall-rerun_viewer", "kill-rerun_viewer", "break-view", "cut-link"} & names
    assert "cut-link" in possible(FAULTS, [*NODES, NETWORK])
    drawn = [list(islice(shuffled(names, random.Random(seed)), 30)) for seed in (1, 1, 2)]
    assert drawn[0] == drawn[1] != drawn[2]
    assert set(drawn[0][: len(names)]) == names


DISTURBED = (
    "stall-robot_state_publisher", "break-model", "lose-driver", "kill-steering_page",
    "kill-velocity_controller", "cut-link",
)  # fmt: skip


@pytest.mark.slow
def test_a_robot_passes_one_fault_of_each_kind(tmp_path: Path) -> None:
    """Until Ctrl-C, which ends it with the verdict so far; nothing it started is left."""
    faults = [word for name in DISTURBED for word in ("--fault", name)]
    words = ("soak", "--minutes", "600", "--every", "0.5", "--patience", "20", *faults)
    with running(tmp_path, *words, "viewer:=none") as soak:
        soak.says("kill-velocity_controller (")
        for name in soak.out.partition("faults: ")[2].splitlines()[0].split(", "):
            soak.says(f"{name} (")
        children = psutil.Process(soak.process.pid).children(recursive=True)
        code = soak.interrupt()
        assert (code, soak.out.splitlines()[-1]) == (0, "PASS"), soak.out + soak.err
    wait_for(lambda: not any(map(psutil.Process.is_running, children)), "the end of all")
    assert "m driven, odometry within" in soak.out


@pytest.mark.slow
def test_a_leak_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of memory, of handles and of threads, in a node; and a traceback."""
    (tmp_path / "sitecustomize.py").write_text(LEAK)
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}:{os.environ.get('PYTHONPATH', CHECKOUT)}")
    words = (
        "--minutes",
        "0.4",
        "--every",
        "5",
        "--fault",
        "lose-driver",
        "--patience",
        "20",
        "viewer:=none",
    )
    done = onebot("soak", *words)
    assert done.returncode == 1, done.stdout + done.stderr
    for kind in ("memory", "handles", "threads"):
        assert re.search(rf"  robot_state_publisher \(\d+\): {kind} grow: ", done.stdout), kind
    assert "a traceback in the output: " in done.stdout
    assert done.stdout.endswith("FAIL: 4 findings\n")


LEAK = """
import os, sys, threading, time
def leak(kept=[]):
    while True:
        kept.append(b"x" * 1_000_000)
        os.dup(0)
        threading.Thread(target=time.sleep, args=(1e6,), daemon=True).start()
        time.sleep(0.1)
if "onebot_description.robot_state_publisher" in sys.orig_argv:
    threading.Thread(target=leak, daemon=True).start()
    threading.Thread(target=lambda: 1 / 0).start()
"""
