"""The bringup under test as processes: started, stopped, and looked at through /proc."""

import os
import re
import signal
import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from onebot_description.shared_memory import FOLDER

_PROC = Path("/proc")
_INTERPRETER = b"onebot_bringup.launcher.interpreter"
_SEGMENT = re.compile(rf"{FOLDER}/fastrtps_[0-9a-f]{{16}}$", re.MULTILINE)


class BringupProcess:
    """``onebot_bringup`` with its output in a file."""

    def __init__(self, words: Sequence[str], log: Path, environment: dict[str, str]) -> None:
        """Start it."""
        self._log = log
        self._begin = log.stat().st_size if log.exists() else 0
        with log.open("ab") as output:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "onebot_bringup.launch.onebot_bringup", *words],
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=output,
                env={**os.environ, **environment},
                start_new_session=True,  # a Ctrl-C of the terminal is for the soak
            )

    @property
    def output(self) -> str:
        """What it has printed."""
        with self._log.open("rb") as file:
            file.seek(self._begin)
            return file.read().decode(errors="replace")

    @property
    def ended(self) -> bool:
        """Whether it runs no more."""
        return self.process.poll() is not None

    def nodes(self) -> dict[str, int]:
        """Return the process ids of its nodes by name: that of the module they are run from."""
        found = {}
        for pid in children(self.process.pid):
            with suppress(OSError, ValueError, IndexError):  # it has just ended
                words = (_PROC / f"{pid}/cmdline").read_bytes().split(b"\0")
                module = words[words.index(_INTERPRETER) + 1].decode()
                found[module.rpartition(".")[2]] = pid
        return found


def children(pid: int) -> list[int]:
    """Return the processes that a process has started."""
    found: list[int] = []
    for file in (_PROC / str(pid)).glob("task/*/children"):
        with suppress(OSError):
            found += map(int, file.read_text().split())
    return found


def usage(pid: int) -> dict[str, float] | None:
    """Return ``memory`` (PSS, MB), ``handles`` and ``threads`` of a process; None: it has ended."""
    folder = _PROC / str(pid)
    try:
        memory = _field(folder / "smaps_rollup", "Pss") / 1024
        threads = _field(folder / "status", "Threads")
        return {"memory": memory, "handles": len(os.listdir(folder / "fd")), "threads": threads}
    except (OSError, LookupError):
        return None


def _field(file: Path, name: str) -> float:
    match = re.search(rf"^{name}:\s*(\d+)", file.read_text(), re.MULTILINE)
    if match is None:  # of a zombie
        raise LookupError(name)
    return float(match[1])


def segments(pid: int) -> set[Path]:
    """Return the shared-memory segments that a process uses, its own and those of others."""
    with suppress(OSError):
        return set(map(Path, _SEGMENT.findall((_PROC / f"{pid}/maps").read_text())))
    return set()


def waited_for_processor() -> float:
    """Return how many seconds this thread was ready to run, and others ran; 0.0 if unknown."""
    with suppress(OSError, IndexError):
        return int((_PROC / "thread-self/schedstat").read_text().split()[1]) * 1e-9
    return 0.0


def send(pid: int, number: signal.Signals) -> None:
    """Send a signal to a process, which may have ended."""
    with suppress(ProcessLookupError):
        os.kill(pid, number)
