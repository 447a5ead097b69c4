"""Helpers shared by the tests."""

import os
import shutil
import subprocess
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar

import pytest

T = TypeVar("T")

# Seconds that a failing test waits: with a load of 20 a process is ten times as slow.
PATIENCE = 180.0


def wait_for(condition: Callable[[], T], what: str, timeout: float = PATIENCE) -> T:
    """Poll ``condition`` until it is truthy and return its value.

    Args:
        condition: called about every 20 ms. An IndexError counts as false: the last message of a
            list is asked for before one has come.
        what: what is awaited, for the failure message.
        timeout: seconds; generous, because it only matters when the test fails.

    Raises:
        AssertionError: the condition stayed false.
    """
    deadline = time.monotonic() + timeout
    while True:
        with suppress(IndexError):
            if value := condition():
                return value
        if time.monotonic() > deadline:
            raise AssertionError(f"waited {timeout:g} s in vain for {what}")
        time.sleep(0.02)


def assert_time_grows_with_size(seconds: Callable[[int], float], size: int) -> None:
    """Ten times the size takes about ten times as long; its square would take a hundred times.

    The least of up to five runs of each, so that what else the machine does hardly matters.

    Args:
        seconds: does work of a size, and returns the processor time that it took.
        size: the larger one.

    Raises:
        AssertionError: it always took more than 40 times as long.
    """
    small, large = float("inf"), float("inf")
    for _ in range(5):
        small = min(small, seconds(size // 10))
        large = min(large, seconds(size))
        if large < 40 * small:
            return
    raise AssertionError(f"{size // 10} took {small:.4f} s, {size} took {large:.4f} s")


def run_to_end(
    command: Sequence[str | bytes | Path], *, timeout: float = PATIENCE, **options: Any
) -> subprocess.CompletedProcess[str]:
    """Run a command, with the options of ``subprocess.run``; its exit code and what it printed."""
    return subprocess.run(command, capture_output=True, text=True, timeout=timeout, **options)


def lines_of_ours(output: str) -> list[str]:
    """The lines of a process but those of Fast DDS, such as errors of shared memory."""
    return [line for line in output.splitlines() if " -> Function " not in line]


def require_program(name: str, package: str = "") -> str:
    """Return the path of a program; skip where it is missing, but fail in CI, which installs it."""
    path = shutil.which(name)
    require(path is not None, f'the program "{name}"', package or name)
    return str(path)


def require(there: bool, what: str, package: str) -> None:
    """Skip where something of a Debian package is missing, but fail in CI, which installs it."""
    if not there:
        skip_for(f"{what}: apt-get install {package}")


def skip_for(missing: str) -> None:
    """Skip for what is missing, but fail in CI, where nothing may be."""
    reason = f"this test needs {missing}"
    if os.environ.get("CI"):
        pytest.fail(reason)
    pytest.skip(reason, allow_module_level=True)
