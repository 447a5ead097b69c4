"""``onebot doctor``: each check by itself, and all of them in a broken environment."""

import fcntl
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import rclpy

from onebot_bringup.cli import doctor
from onebot_bringup.cli.doctor import (
    NOTE,
    OK,
    PROBLEM,
    dependencies,
    domain,
    pybullet,
    shared_memory,
)
from onebot_bringup.viewer.rendering import NO_RENDERER, TOO_OLD
from onebot_description.ros.shared_memory import (
    FOLDER,
    find_segments,
    remove_stale_in_background,
)
from tests.onebot_bringup.cli_support import onebot
from tests.support import wait_for

PROBLEMS = NO_RENDERER, TOO_OLD


def test_dependencies(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is missing, without extras; versions by pip."""
    required = ["numpy>=2.0", "rerun-sdk[notebook]<9; extra == 'x'", "absent[y]>=1", "lost==1.*"]
    missing = dependencies(required)
    assert (missing.level, missing.remedy) == (PROBLEM, "pip install absent lost")
    assert missing.text == "missing: absent, lost"
    folder = tmp_path / "onebot_robots-9.dist-info"
    folder.mkdir()
    metadata = "Metadata-Version: 2.1\nName: onebot-robots\nVersion: 9\nRequires-Dist: numpy<1\n"
    (folder / "METADATA").write_text(metadata)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    verdict = dependencies(required[:1])
    assert verdict.level == PROBLEM and "onebot-robots 9 has requirement numpy<1" in verdict.text


def test_two_builds_of_pybullet(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One is as it should be; the fork beside it overwrites its files."""
    assert pybullet().level == OK
    for name in ("pybullet", "pybullet_arm64"):
        folder = tmp_path / f"{name}-9.dist-info"
        folder.mkdir()
        text = f"Metadata-Version: 2.1\nName: {name.replace('_', '-')}\nVersion: 9\n"
        (folder / "METADATA").write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    both = pybullet()
    assert both.level == PROBLEM and "both installed" in both.text
    assert both.remedy.startswith("pip uninstall -y pybullet pybullet-arm64 && pip install ")
    monkeypatch.setattr(sys, "path", [])
    neither = pybullet()
    assert (neither.level, "neither" in neither.text) == (PROBLEM, True)


@pytest.mark.parametrize(
    ("variables", "level", "part"),
    [
        ({}, OK, "ROS_DOMAIN_ID=0, discovery by SUBNET"),
        ({"ROS_DOMAIN_ID": "233"}, PROBLEM, "not a number from 0 to 232"),
        ({"ROS_DOMAIN_ID": "one"}, PROBLEM, "not a number"),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "OFF"}, PROBLEM, "=OFF discovers no other nodes"),
        ({"ROS_DISCOVERY_SERVER": "10.0.0.1:11811"}, OK, "discovery by 10.0.0.1:11811"),
    ],
)
def test_domain(variables: dict[str, str], level: str, part: str) -> None:
    found = domain(variables)
    assert found.level == level and part in found.text


def test_shared_memory(tmp_path: Path) -> None:
    """What nobody has locked is of a killed process, unless it is young; it goes with a start."""
    names = [f"fastrtps_{index:016x}" for index in range(3)]
    for name in (*names, "fastrtps_port7410", "other"):
        for suffix in ("", "_el"):
            file = tmp_path / f"{name}{suffix}"
            file.write_bytes(bytes(2**20))
            os.utime(file, (0, 0))
    os.utime(tmp_path / names[2])  # has just been made
    with (tmp_path / f"{names[0]}_el").open() as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        segments = find_segments(tmp_path)
        assert [path.name for path in segments.used] == [names[0], names[2]]
        assert [path.name for path in segments.stale] == [names[1]]
        found = shared_memory(tmp_path)
        assert found.level == NOTE and "the next bringup removes" in found.remedy
        assert found.text.endswith("2 segments in use, 1 (1 MiB) of killed processes")
        os.utime(tmp_path / names[2], (0, 0))
        remove_stale_in_background(tmp_path).join()
        assert shared_memory(tmp_path).level == OK
        assert [path.name for path in find_segments(tmp_path).used] == names[:1]
    left = sorted(path.name for path in tmp_path.iterdir() if not path.name.endswith("_el"))
    assert left == [names[0], "fastrtps_port7410", "other"]
    assert not (tmp_path / f"{names[1]}_el").exists()
    assert shared_memory(tmp_path / "none").level == PROBLEM


def test_segment_of_a_killed_node(ros_domain: int) -> None:
    """The segment of a living process is in use; of one that was killed it is not any more."""
    code = (
        "import rclpy, time; rclpy.init(); node = rclpy.create_node('n'); "
        "print(flush=True); time.sleep(600)"
    )
    node = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE)
    try:
        assert node.stdout is not None and node.stdout.readline()
        memory = Path(f"/proc/{node.pid}/maps").read_text()
        mine = Path(re.findall(rf"{FOLDER}/fastrtps_[0-9a-f]{{16}}", memory)[0])
        os.utime(mine, (0, 0))
        assert mine in find_segments().used
    finally:
        node.kill()
        node.wait()
    # A bringup that another test starts may remove it first.
    wait_for(lambda: mine in find_segments().stale or not mine.exists(), "the segment to be stale")
    mine.unlink(missing_ok=True)
    mine.with_name(f"{mine.name}_el").unlink(missing_ok=True)


def test_report(ros_domain: int) -> None:
    """All checks run; here nothing is broken, and a message comes from another process."""
    done = onebot("doctor", "--timeout", "120")
    assert done.returncode == 0, done.stdout + done.stderr
    lines = done.stdout.splitlines()
    assert lines[0].startswith("onebot ") and len(lines) == 10
    assert all(re.match(r"(ok  |note)     [\w ]+: ", line) for line in lines[1:]), done.stdout
    assert "ok       messages: discovered and received from another process" in lines
    verdicts = ["draws pictures", *(f"onebot snapshot does not work: {p}" for p in PROBLEMS)]
    assert lines[-1].partition(" renderer: ")[2] in verdicts
    assert f"from {rclpy.__path__[0]}" in done.stdout


def test_broken_environment(ros_domain: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """A middleware that is not installed: what to do, no traceback, exit code 1."""
    monkeypatch.setattr(doctor, "_required", list)  # pip takes its time, and has no part in it,
    monkeypatch.setattr(doctor, "_renderer", lambda: doctor.Verdict(OK, ""))  # nor has a picture
    monkeypatch.setenv("RMW_IMPLEMENTATION", "rmw_connextdds")
    done = onebot("doctor", "--timeout", "1")
    assert done.returncode == 1 and "Traceback" not in done.stderr
    assert (
        "problem  rclpy: it does not run with rmw_connextdds; unset RMW_IMPLEMENTATION\n"
        in done.stdout
    )
    assert "\nproblem  messages: none from another process: " in done.stdout
