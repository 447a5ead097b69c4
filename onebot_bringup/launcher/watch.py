"""The launcher's end of the guard (see ``guard.py``), which outlives a killed launcher."""

import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path


class Guard:
    """A process that kills the groups it was told of, should the launcher die without doing so."""

    def __init__(self, folders: Sequence[Path] = ()) -> None:
        """Start it; without it (no memory, no processes left) the launcher works all the same.

        Args:
            folders: temporary ones, which it removes should the launcher not live to do so.
        """
        script = Path(__file__).with_name("guard.py")
        try:
            self._process: subprocess.Popen[bytes] | None = subprocess.Popen(
                [sys.executable, "-I", "-S", str(script), *map(str, folders)],
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                start_new_session=True,
            )
        except OSError:
            self._process = None

    def add(self, group: int) -> None:
        """Answer for the process group ``group`` from now on."""
        self._tell(f"+{group}\n")

    def discard(self, group: int) -> None:
        """Forget ``group``: it is gone."""
        self._tell(f"-{group}\n")

    def close(self) -> None:
        """End it; it kills what it still answers for."""
        if self._process is None:
            return
        assert self._process.stdin is not None
        try:
            self._process.stdin.close()
            self._process.wait(timeout=1.0)
        except (OSError, subprocess.TimeoutExpired):
            self._process.kill()
            self._process.wait()

    def _tell(self, line: str) -> None:
        if self._process is None:
            return
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(line.encode())
            self._process.stdin.flush()
        except OSError:  # it was killed; the nodes still ask to die with the launcher
            self._process = None
