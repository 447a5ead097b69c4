"""Every command of the README does what the README says."""

import os
import re
import subprocess
from pathlib import Path

import pytest

from tests import readme

CHECKOUT = readme.README.parent
TEXT = readme.README.read_text()
LINES = [line for block in readme.blocks()[2:] for line in block.splitlines() if line.strip()]


def test_first_two_commands_are_what_ci_runs():
    """Installing and testing are shown by .ci/run itself, which takes them from the README."""
    first, second = readme.blocks()[:2]
    assert "pip install" in first and "mrm_bringup" in first
    assert "[test]" in second and "pytest" in second
    script = (CHECKOUT / ".ci/run").read_text()
    assert "tests/readme.py until-up 1" in script and "tests/readme.py run 2" in script


@pytest.mark.parametrize("command", LINES)
def test_command(command, ros_domain, tmp_path):
    """It runs as written, in a folder with the checkout's files, and ends with exit code 0."""
    for entry in CHECKOUT.iterdir():
        if not entry.name.startswith("."):
            (tmp_path / entry.name).symlink_to(entry)
    if readme.BRINGUP.search(command):
        code, output = readme.run_until_up(command, tmp_path, timeout=120)
        assert "Traceback" not in output
        assert code == 0
        return
    done = subprocess.run(
        ["bash", "-c", command], cwd=tmp_path, capture_output=True, text=True, env=dict(os.environ)
    )
    assert done.returncode == 0, done.stdout + done.stderr


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
