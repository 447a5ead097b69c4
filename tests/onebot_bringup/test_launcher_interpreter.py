"""How a module of a node is run: it ends as by itself."""

import os
import sys
from pathlib import Path

import pytest

from onebot_bringup.launch.bringup import Bringup, bring_up
from onebot_description.errors import UsageError
from tests.onebot_bringup.bringup_support import MARK
from tests.orphans import marked
from tests.support import run_to_end

BEGIN = """
import atexit, sys, threading, time
atexit.register(lambda: print("at exit", end=""))
threading.Thread(target=lambda: (time.sleep(0.1), print("thread"))).start()
"""


@pytest.mark.parametrize(
    ("end", "code", "complaint"),
    [
        ("", 0, ""),
        ("sys.exit()", 0, ""),
        ("sys.exit(3)", 3, ""),
        ("sys.exit('no such file')", 1, "no such file\n"),
        ("raise ValueError('a fault')", 1, "ValueError: a fault\n"),
    ],
)
def test_a_module_ends_as_by_itself(tmp_path: Path, end: str, code: int, complaint: str) -> None:
    """Its threads are awaited, its exit functions called and its output is whole."""
    (tmp_path / "ending.py").write_text(BEGIN + end)
    for runner in ([], ["onebot_bringup.launcher.interpreter"]):
        ended = run_to_end([sys.executable, "-m", *runner, "ending"], cwd=tmp_path)
        assert ended.returncode == code
        assert ended.stdout == "thread\nat exit"
        assert ended.stderr.endswith(complaint) and bool(ended.stderr) == bool(complaint)


@pytest.mark.parametrize("words", [["--help"], ["viewer:=nowhere"]])
def test_a_bringup_that_starts_nothing_leaves_no_process(
    words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Neither one that answers a question, nor one that is called wrongly."""
    monkeypatch.setenv(MARK, str(tmp_path))
    command = Bringup("test", "a test", model=str(tmp_path / "none.urdf"), control="x.yaml")
    try:
        assert bring_up(command, words) == 0
    except UsageError:
        assert words != ["--help"]
    assert set(marked(str(tmp_path))) <= {os.getpid()}
