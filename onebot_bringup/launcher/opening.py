"""Opening processes, Python modules among them."""

import os
import subprocess
import sys
from collections.abc import Mapping, Sequence

from onebot_bringup.launcher.groups import child_setup

_START_MODULE = "onebot_bringup.launcher.start_module"
_BLAS_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS")  # the first is OpenBLAS's own


def open_process(
    command: Sequence[str],
    environment: Mapping[str, str],
    hold_interrupt: bool,
    stdin: int = subprocess.DEVNULL,
) -> subprocess.Popen[bytes]:
    """Start a program that leads a session of its own, its output into pipes.

    Args:
        command: the program and its arguments.
        environment: all of its variables.
        hold_interrupt: start it with SIGINT blocked.
        stdin: ``subprocess.PIPE`` for one to write to.

    Raises:
        OSError: the program cannot be run.
    """
    return subprocess.Popen(
        command,
        stdin=stdin,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        bufsize=0,
        env=environment,
        start_new_session=True,
        preexec_fn=child_setup(hold_interrupt),
    )


def module_command(module: str) -> tuple[str, ...]:
    """Return what runs a Python module as a node, without its arguments."""
    return (sys.executable, "-m", _START_MODULE, module)


def python_environment() -> dict[str, str]:
    """Return the variables that the interpreter of a node needs from its start."""
    variables = {"PYTHONUNBUFFERED": "1", **_safe_path()}
    if not any(name in os.environ for name in _BLAS_THREADS):
        # No node multiplies matrices so large that it would pay, and to start the threads takes
        # longer than all of numpy's other modules.
        variables[_BLAS_THREADS[0]] = "1"
    return variables


def _safe_path() -> dict[str, str]:
    """Keep a stray ``yaml.py`` in the working directory from being imported by the nodes.

    Only where the launcher itself was not found through the working directory.
    """
    here = sys.path[0] in ("", os.getcwd()) if sys.path else False
    return {} if here else {"PYTHONSAFEPATH": "1"}
