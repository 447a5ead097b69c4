"""Runs the commands that the READMEs show, as a reader would; only the standard library.

``python tests/readme.py run N`` runs the N-th shell block of README.md to its end; ``until-up N``
runs it until the robot that it brings up is up, then presses Ctrl-C.
"""

import os
import re
import selectors
import signal
import subprocess
import sys
import time
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parent.parent
README = CHECKOUT / "README.md"
UP = "Ctrl-C stops everything"
_SOME_MESSAGES = 50_000  # bytes
BRINGUP = re.compile(
    r"\b(mrm_bringup|onebot_bringup|onebot view|onebot replay(?!.*viewer:=none))\b"
    r"(?!.*(--help|--show-args))"
)


def blocks() -> list[str]:
    """Return the shell blocks of the README, in order."""
    return re.findall(r"```sh\n(.*?)```", README.read_text(), re.DOTALL)


def documents() -> list[Path]:
    """Return the documentation of the packages: each README, and what it links to."""
    return sorted([*CHECKOUT.glob("*_*/README.md"), *CHECKOUT.glob("*_*/docs/*.md")])


def run(command: str, cwd: Path = CHECKOUT) -> int:
    """Run a command to its end; its exit code."""
    return subprocess.run(["bash", "-c", command], cwd=cwd).returncode


def run_until_up(command: str, cwd: Path = CHECKOUT, timeout: float = 900.0) -> tuple[int, str]:
    """Run a command until it says that the robot is up, press Ctrl-C, and wait for its end.

    Returns:
        The exit code, and all that was printed.

    Raises:
        TimeoutError: it did not come up, or did not stop.
    """
    process = subprocess.Popen(
        ["bash", "-c", command],
        cwd=cwd,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        start_new_session=True,
    )
    deadline = time.monotonic() + timeout
    output = b""
    interrupted = False
    assert process.stdout is not None
    os.set_blocking(process.stdout.fileno(), False)
    with selectors.DefaultSelector() as selector:
        selector.register(process.stdout, selectors.EVENT_READ)
        while True:
            if selector.select(0.1):
                piece = process.stdout.read()
                if piece == b"":
                    break
                output += piece or b""
                sys.stdout.write((piece or b"").decode(errors="replace"))
                sys.stdout.flush()
            text = output.decode(errors="replace")
            if not interrupted and is_up(command, text) and _has_recorded(command, cwd):
                interrupted = True
                os.killpg(process.pid, signal.SIGINT)
            if time.monotonic() > deadline:
                os.killpg(process.pid, signal.SIGKILL)
                raise TimeoutError(f"{'did not stop' if interrupted else 'did not come up'}")
    return process.wait(180), output.decode(errors="replace")


def is_up(command: str, text: str) -> bool:
    """Whether the robot that a command brings up is up, by what it has printed."""
    if "onebot replay" in command:
        return "open http://" in text
    shown = "showing " in text or not re.search(r"starting .*rerun_viewer", text)
    moving = re.search("robot description applied|(driving|moving) robot", text)
    return bool(UP in text and moving and shown)


def _has_recorded(command: str, cwd: Path) -> bool:
    """Whether there is more than its beginning in what a command records, if it does."""
    folder = re.search(r"record:=(\S+)", command)
    if folder is None:
        return True
    return any(file.stat().st_size > _SOME_MESSAGES for file in (cwd / folder[1]).glob("*.mcap"))


def main() -> int:
    """Run what the command line asks for."""
    verb, number = sys.argv[1], int(sys.argv[2])
    command = blocks()[number - 1]
    print(f"$ {command}", flush=True)
    if verb == "run":
        return run(command)
    code, output = run_until_up(command)
    if "Traceback" in output:
        print("the output holds a traceback")
        return 1
    return code


if __name__ == "__main__":
    sys.exit(main())
