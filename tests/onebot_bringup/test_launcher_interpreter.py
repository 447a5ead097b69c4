"""How a module of a node is run: it ends as by itself."""

import sys
from pathlib import Path

import pytest

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
