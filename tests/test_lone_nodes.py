"""A node that runs alone, in its first moments: Ctrl-C, and the threads of numpy."""

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from onebot_bringup.launch.nodes import NODES
from tests.support import PATIENCE, run_to_end, wait_for

MODULES = [row.module for row in NODES]
FIRST = "onebot_description.ros.packages"  # which each of them imports
# Python imports it at its start: something happens when a module of that name is imported.
SITECUSTOMIZE = """
import os, signal, sys

class Finder:
    def find_spec(self, name, path=None, target=None):
        if name == {name!r}:
            {action}

sys.meta_path.insert(0, Finder())
"""
INTERRUPT = "os.kill(os.getpid(), signal.SIGINT)"
THREADS = 'print(os.environ.get("OPENBLAS_NUM_THREADS"), "numpy" in sys.modules, flush=True)'
Run = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture
def at_import(tmp_path: Path, ros_domain: int) -> Run:
    """Runs ``python -m WORDS``, with an action at the import of ``name``."""

    def run(
        name: str,
        action: str,
        *words: str,
        handler: signal.Handlers = signal.SIG_DFL,
        **variables: str,
    ) -> subprocess.CompletedProcess[str]:
        environment = {key: value for key, value in os.environ.items() if "NUM_THREADS" not in key}
        environment["PYTHONPATH"] = f"{tmp_path}:{environment.get('PYTHONPATH', '')}"
        (tmp_path / "sitecustomize.py").write_text(SITECUSTOMIZE.format(name=name, action=action))
        return run_to_end(
            [sys.executable, "-m", *words],
            env={**environment, **variables},
            preexec_fn=lambda: signal.signal(signal.SIGINT, handler),
        )

    return run


@pytest.mark.parametrize("module", {name.partition(".")[0]: name for name in MODULES}.values())
def test_ctrl_c_at_the_first_import(at_import: Run, module: str) -> None:
    """The end is as silent as later, with the same exit code; one node of each package."""
    done = at_import(FIRST, INTERRUPT, module)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


@pytest.mark.parametrize("module", MODULES)
def test_ctrl_c_while_it_imports(at_import: Run, module: str) -> None:
    """By then numpy is told to start no threads, as under a bringup, and is not imported."""
    done = at_import("rclpy", f"{THREADS}; {INTERRUPT}", module)
    assert (done.returncode, done.stdout, done.stderr) == (0, "1 False\n", "")


def test_ctrl_c_as_it_loads_ros(ros_domain: int) -> None:
    with subprocess.Popen([sys.executable, "-m", MODULES[0]], stderr=-1, text=True) as process:
        maps = Path(f"/proc/{process.pid}/maps")
        wait_for(lambda: "_rclpy_pybind11" in maps.read_text(), "the library of rclpy")
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=PATIENCE)
    assert (process.returncode, "Traceback" in err, "Exception" in err) == (0, False, False), err


def test_a_background_job_ignores_ctrl_c(at_import: Run) -> None:
    """A shell starts it so."""
    action = f"{INTERRUPT}; print('goes on', flush=True); os._exit(7)"
    done = at_import(FIRST, action, MODULES[0], handler=signal.SIG_IGN)
    assert (done.returncode, done.stdout) == (7, "goes on\n")


def test_the_threads_of_numpy_that_the_user_has_set_stay(at_import: Run) -> None:
    done = at_import("rclpy", f"{THREADS}; os._exit(0)", MODULES[0], OMP_NUM_THREADS="4")
    assert done.stdout == "None False\n"
