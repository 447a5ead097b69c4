"""What machine and which versions a run of the benchmarks was on."""

import datetime
import os
import platform
import subprocess
from importlib import metadata
from pathlib import Path

from tests.benchmarks.measuring import CHECKOUT

_PACKAGES = ("onebot-robots", "ros-jazzy-rclpy", "numpy", "rerun-sdk", "pybullet", "yourdfpy")


def describe() -> dict[str, str | int]:
    """Return a description of this machine and its software; call it before anything is run.

    ``load before`` is the average number of processes that wanted a core in the minute before: on
    an idle machine it is near 0.
    """
    described: dict[str, str | int] = {
        "date": datetime.datetime.now(datetime.timezone.utc).strftime("%Y-%m-%d %H:%M UTC"),
        "cpu": _cpu(),
        "cores": len(os.sched_getaffinity(0)),
        "memory": f"{_memory_gb():.0f} GB",
        "kernel": f"{platform.system()} {platform.release()}",
        "load before": f"{os.getloadavg()[0]:.2f}",
        "commit": _commit(),
        "python": platform.python_version(),
    }
    for package in _PACKAGES:
        try:
            described[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            described[package] = "not installed"
    return described


def sentence(machine: dict[str, str | int]) -> str:
    """Return the description in one line."""
    return ", ".join(f"{name} {value}" for name, value in machine.items())


def _cpu() -> str:
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return models[0] if models else platform.machine()


def _memory_gb() -> float:
    return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 1e9


def _commit() -> str:
    """The checkout's commit, with a + where files differ from it."""
    try:
        done = subprocess.run(
            ["git", "describe", "--always", "--dirty=+", "--exclude=*"],
            cwd=CHECKOUT,
            capture_output=True,
            text=True,
        )
    except OSError:
        return "unknown"
    return done.stdout.strip() or "unknown"
