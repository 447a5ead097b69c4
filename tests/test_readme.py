"""Every command of the README does what the README says."""

import os
import re
import signal
import subprocess
import tempfile
from pathlib import Path

import pytest

from tests import readme
from tests.support import wait_for
from tests.support_rendering import require_renderer

CHECKOUT = readme.README.parent
TEXT = readme.README.read_text()
BESIDE = re.compile(r"<!-- beside (.*?) -->\n```sh\n(.*?)```", re.DOTALL)
IN_TURN = re.compile(r"<!-- in turn -->\n```sh\n(.*?)```", re.DOTALL)
ALONE = [
    line
    for block in re.findall(r"```sh\n(.*?)```", IN_TURN.sub("", BESIDE.sub("", TEXT)), re.DOTALL)[
        2:
    ]
    for line in block.splitlines()
]
ENDLESS = re.compile(r"topic pub (?!.*(--once|--times))|topic hz")


def test_first_two_commands_are_what_ci_runs():
    """Installing and testing are shown by .ci/run itself, which takes them from the README."""
    first, second = readme.blocks()[:2]
    assert "pip install" in first and "onebot_bringup" in first
    assert "[test]" in second and "pytest" in second
    script = (CHECKOUT / ".ci/run").read_text()
    assert "tests/readme.py until-up 1" in script and "tests/readme.py run 2" in script


@pytest.mark.parametrize("command", ALONE)
def test_command(command, ros_domain, tmp_path):
    """It runs as written, in a folder with the checkout's files, and ends with exit code 0."""
    if "snapshot" in command:
        require_renderer()
    _lay_out_checkout(tmp_path)
    _run(command, tmp_path)


@pytest.mark.parametrize("block", IN_TURN.findall(TEXT))
def test_commands_in_turn(block, ros_domain, tmp_path):
    """Each finds what the one before has left."""
    _lay_out_checkout(tmp_path)
    for command in block.splitlines():
        _run(command, tmp_path)


def _lay_out_checkout(folder):
    for entry in CHECKOUT.iterdir():
        if not entry.name.startswith("."):
            (folder / entry.name).symlink_to(entry)


def _run(command, tmp_path):
    if readme.BRINGUP.search(command):
        code, output = readme.run_until_up(command, tmp_path, timeout=120)
        assert "Traceback" not in output
        assert code == 0
        return
    done = subprocess.run(
        ["bash", "-c", command], cwd=tmp_path, capture_output=True, text=True, env=dict(os.environ)
    )
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize(("robot", "block"), BESIDE.findall(TEXT))
def test_commands_beside_a_running_robot(robot, block, ros_domain, tmp_path, monkeypatch):
    """In a second terminal, each ends with exit code 0, or runs until Ctrl-C and then does."""
    _lay_out_checkout(tmp_path)
    monkeypatch.chdir(tmp_path)
    with RunningCommand(robot) as running:
        wait_for(lambda: "driving robot" in running.output, "the robot")
        for command in block.splitlines():
            if ENDLESS.search(command):
                with RunningCommand(command) as endless:
                    wait_for(lambda endless=endless: "#50" in endless.output, command)
                continue
            done = subprocess.run(["bash", "-c", command], capture_output=True, text=True)
            assert done.returncode == 0 and done.stdout, command + done.stdout + done.stderr


class RunningCommand:
    """A shell command that is running meanwhile; Ctrl-C ends it with exit code 0."""

    def __init__(self, command):
        self._log = tempfile.NamedTemporaryFile("r", suffix=".log")
        with open(self._log.name, "w") as log:
            self.process = subprocess.Popen(
                ["bash", "-c", f"exec {command}"],
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )

    @property
    def output(self):
        return Path(self._log.name).read_text()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        os.killpg(self.process.pid, signal.SIGINT)
        assert self.process.wait(30) == 0, self.output
        assert "Traceback" not in self.output


def test_pictures_and_links_exist():
    """Each file the README points to is in the repository."""
    for target in re.findall(r"\]\((?!https?:)([^)#]+)\)|src=\"([^\"]+)\"", TEXT):
        assert (CHECKOUT / (target[0] or target[1])).exists(), target


def test_shown_files_are_the_real_ones():
    """Where the README quotes a file, it quotes what the file says."""
    quoted = re.findall(r"<!-- file: (\S+) -->\n```\w*\n(.*?)```", TEXT, re.DOTALL)
    assert quoted
    for name, text in quoted:
        assert text in Path(CHECKOUT / name).read_text(), name


def test_python_example_runs(monkeypatch):
    """The notebook example gives arrays of the shapes it says."""
    [code] = re.findall(r"<!-- python -->\n```python\n(.*?)```", TEXT, re.DOTALL)
    monkeypatch.chdir(CHECKOUT)
    names: dict = {}
    exec(code, names)
    assert names["translations"].shape == (1, 3) and names["rotations"].shape == (1, 4)
    assert names["poses"].shape == (2, 7)
