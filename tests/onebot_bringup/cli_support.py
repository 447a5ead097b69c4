"""``onebot`` in this process, or in one of its own where Ctrl-C is to end it."""

import io
import os
import subprocess
import sys
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from unittest.mock import patch

from onebot_bringup.cli.main import main
from tests.support import RunningProcess

MODULE = "onebot_bringup.cli.main"


def onebot(*words: str) -> subprocess.CompletedProcess[str]:
    """Run a command to its end, in this process: an interpreter and its imports take a second."""
    out, err = io.StringIO(), io.StringIO()
    # A command may set variables for the processes that it starts.
    with patch.dict(os.environ), redirect_stdout(out), redirect_stderr(err):
        try:
            code = main(words)
        except SystemExit as end:  # of argparse, for --help
            code = end.code
    return subprocess.CompletedProcess(words, code, out.getvalue(), err.getvalue())


def output_of(*words: str) -> str:
    """Run a command to its end, which is to be a good one, and return what it printed."""
    done = onebot(*words)
    assert done.returncode == 0, f"exit code {done.returncode}: {done.stderr}"
    return done.stdout


def running(folder: Path, *words: str) -> RunningProcess:
    """Run a command until the end of the context, if it has not ended by then."""
    return RunningProcess([sys.executable, "-m", MODULE, *words], folder, check=False)
