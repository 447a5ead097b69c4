"""Ctrl-C from the first moment on: quiet, and with the exit code that the command has for it."""

import os
import subprocess
import sys

import pytest
import zstandard

from tests.onebot_bringup.bag_support import write_words
from tests.support import run_to_end

COMMANDS = {
    "onebot": "onebot_bringup.cli.main",
    "onebot_bringup": "onebot_bringup.launch.onebot_bringup",
    "mrm_bringup": "mrm_description.launch.mrm_bringup",
}
# What the command imports once it runs comes with a SIGINT.
INTERRUPTED = """
import os, signal, sys
from {module} import main

class Interrupting:
    def find_spec(self, name, path=None, target=None):
        os.kill(os.getpid(), signal.SIGINT)

sys.meta_path.insert(0, Interrupting())
sys.argv[1:] = {words}
sys.exit(main())
"""
# A SIGINT comes as soon as ROS is imported while there is a temporary folder of ours.
WITH_FOLDER = """
import glob, os, signal, sys
from onebot_bringup.cli.main import main

class Interrupting:
    def find_spec(self, name, path=None, target=None):
        if name.startswith("rclpy") and (folders := glob.glob(os.environ["TMPDIR"] + "/onebot-*")):
            print(len(folders), flush=True)
            sys.meta_path.remove(self)
            os.kill(os.getpid(), signal.SIGINT)

sys.meta_path.insert(0, Interrupting())
sys.argv[1:] = ["bag", "play", "words.mcap.zstd"]
sys.exit(main())
"""
EARLY = """
import sys
from onebot_bringup.cli.main import main
for words in {commands}:
    code = main(words)
    slow = {{"rclpy", "rerun", "pybullet", "scipy", "yourdfpy"}} & set(sys.modules)
    print("code", code, *words, *slow)
"""


def python(program: str) -> subprocess.CompletedProcess[str]:
    return run_to_end([sys.executable, "-c", program])


@pytest.mark.parametrize("module", COMMANDS.values())
def test_hardly_anything_is_imported_before_ctrl_c_is_answered(module):
    """Until then Python answers it, with a traceback; only what is ours and small may come."""
    done = python(
        f"import sys; before = set(sys.modules); import {module}; "
        "print(*(set(sys.modules) - before))"
    )
    names = done.stdout.split()
    ours = [name for name in names if name.partition(".")[0].startswith(("onebot", "mrm"))]
    assert module in ours and len(ours) < 12
    assert set(names) - set(ours) <= {"collections", "collections.abc"}


def test_a_mistake_is_reported_before_anything_slow_is_imported(tmp_path):
    """Such as ROS and Rerun, which take seconds; a check needs neither."""
    robot = str(tmp_path / "robot.urdf")
    (tmp_path / "robot.urdf").write_text('<robot name="r"><link name="base"/></robot>')
    png = str(tmp_path / "a.png")
    commands = {
        ("snapshot", "--nope"): 2,
        ("snapshot", "a.jpg"): 1,
        ("snapshot", png, "absent.urdf"): 1,
        ("snapshot", png, "absent.rrd"): 1,
        ("snapshot", png, "absent.mcap"): 1,
        ("replay", "absent.mcap"): 1,
        ("replay", "absent.rrd"): 1,
        ("view", "absent.urdf"): 1,
        ("check", "absent.urdf"): 1,
        ("check", robot): 0,
        ("topic", "echo"): 2,
        ("teleop", "--nope"): 2,
        ("steer", "nope:=1"): 2,
        ("trajectory", "elbow=fast"): 2,
    }
    done = python(EARLY.format(commands=[list(words) for words in commands]))
    expected = [" ".join(map(str, ("code", code, *words))) for words, code in commands.items()]
    reported = [line for line in done.stdout.splitlines() if line.startswith("code ")]
    assert reported == expected
    assert "Traceback" not in done.stderr


def test_ctrl_c_leaves_no_temporary_folder(ros_domain, tmp_path):
    """Such as an unpacked recording, which may be large."""
    write_words(tmp_path / "bag")
    [recording] = (tmp_path / "bag").glob("*.mcap")
    data = zstandard.ZstdCompressor().compress(recording.read_bytes())
    (tmp_path / "words.mcap.zstd").write_bytes(data)
    (tmp_path / "tmp").mkdir()
    environment = {**os.environ, "TMPDIR": str(tmp_path / "tmp")}
    done = run_to_end([sys.executable, "-c", WITH_FOLDER], cwd=tmp_path, env=environment)
    assert (done.returncode, done.stdout.split()) == (130, ["1"]), done.stderr
    assert "Traceback" not in done.stderr
    assert [*(tmp_path / "tmp").glob("onebot-*")] == []


@pytest.mark.parametrize(
    ("program", "words", "code"),
    [
        ("onebot", ["check", "a.urdf"], 130),
        ("onebot", ["steer"], 0),
        ("onebot", ["help", "topic"], 130),
        ("onebot_bringup", ["--show-args"], 0),
    ],
)
def test_ctrl_c_while_it_imports(program, words, code):
    """No traceback, and nothing else that would have to be understood."""
    done = python(INTERRUPTED.format(module=COMMANDS[program], words=words))
    assert (done.returncode, done.stdout, done.stderr) == (code, "", "")
