"""Single keys from a terminal, which is afterwards as it was."""

import contextlib
import os
import select
import sys
import termios
from collections.abc import Iterator

from onebot_description.errors import OneBotError

ESCAPE = "\x1b"
_ARROWS = {"A": "up", "B": "down", "C": "right", "D": "left"}


@contextlib.contextmanager
def single_keys() -> Iterator["Keys"]:
    """Switch the terminal to single keys, not shown; Ctrl-C still interrupts.

    Raises:
        OneBotError: stdin is no terminal.
    """
    if sys.stdin is None or not sys.stdin.isatty():
        raise OneBotError("this reads keys from a terminal, but its standard input is none")
    fd = sys.stdin.fileno()
    before = termios.tcgetattr(fd)
    mode = termios.tcgetattr(fd)
    mode[3] &= ~(termios.ICANON | termios.ECHO)
    # Ctrl-S would stop the output, and with it whatever waits for it to be written.
    mode[0] &= ~(termios.IXON | termios.ICRNL)
    mode[6][termios.VMIN], mode[6][termios.VTIME] = 1, 0
    # Ctrl-Z would stop the process while the robot drives on.
    mode[6][termios.VSUSP] = os.fpathconf(fd, "PC_VDISABLE").to_bytes(1, "little")
    try:
        termios.tcsetattr(fd, termios.TCSADRAIN, mode)
        yield Keys(fd)
    finally:
        with contextlib.suppress(termios.error):  # the terminal's window is closed
            termios.tcsetattr(fd, termios.TCSADRAIN, before)


class Keys:
    """What is typed."""

    def __init__(self, fd: int) -> None:
        """Read from a file descriptor."""
        self._fd = fd

    def read(self, timeout: float) -> list[str] | None:
        """Return the keys pressed since the last call, waiting up to ``timeout`` seconds for one.

        Returns:
            Characters; arrow keys as ``up``, ``down``, ``left``, ``right``; ``ESCAPE`` for that
            key alone. None once the terminal is closed.
        """
        if not select.select([self._fd], [], [], max(timeout, 0.0))[0]:
            return []
        try:
            data = os.read(self._fd, 1024)
        except OSError:
            return None
        return split_keys(data.decode(errors="replace")) if data else None


def split_keys(text: str) -> list[str]:
    """Take apart what a terminal sends; other function keys than arrows come as "" each."""
    keys = []
    while text:
        if text[:2] in (f"{ESCAPE}[", f"{ESCAPE}O") and len(text) > 2:
            end = next((i for i, c in enumerate(text[2:], 2) if c.isalpha() or c == "~"), 2)
            keys.append(_ARROWS.get(text[end], "") if end == 2 else "")
            text = text[end + 1 :]
        else:
            keys.append(text[0])
            text = text[1:]
    return keys
