"""Runs a function in its own process, with limited memory and processor time.

Forking takes some milliseconds, but is safe only in a process without other threads, whose locks
(such as the loader's) would never be released in the child. A process with threads (a node) starts
an interpreter instead, which forks; that takes a tenth of a second. The answer is passed as JSON.

macOS does not limit a process's memory. Windows can neither fork nor limit: there the new
interpreter runs the function itself, and is killed after that time on the wall clock.
"""

import importlib
import json
import math
import mmap
import os
import signal
import sys
import time
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

try:
    import resource
except ModuleNotFoundError:  # on Windows
    resource = None  # type: ignore[assignment]

# Isolated (-I), so that no file in the current folder is imported instead of a module. The prefix
# is set because without site (-S) it would be that of the environment's base interpreter.
_START = (
    "import sys; sys.path[:] = sys.argv[1].split('\\n'); sys.prefix = sys.argv[2];"
    "from onebot_description.description import bounded_process; bounded_process.main()"
)

_FORKS = hasattr(os, "fork")


class Bounds(NamedTuple):
    """Limits of memory and processor time for a function."""

    memory: int = 1_000_000_000  # bytes, beyond the process's own at the start
    processor: int = 10  # s of processor time


class BoundExceeded(Exception):
    """The function was stopped because it exceeded a bound, which the text names.

    Attributes:
        place: what the function was working on.
    """

    def __init__(self, bound: str, place: str) -> None:
        super().__init__(bound)
        self.place = place


class Place:
    """Shared note of what the function is working on; it outlives the function's process."""

    def __init__(self) -> None:
        self._page = mmap.mmap(-1, mmap.PAGESIZE)  # shared by forks

    def note(self, text: str) -> None:
        """Replace the text."""
        data = text.encode("utf-8", "replace")[: mmap.PAGESIZE - 1] + b"\0"
        self._page[: len(data)] = data

    def read(self) -> str:
        """Return the last noted text."""
        return self._page[:].partition(b"\0")[0].decode("utf-8", "replace")


def run_bounded(function: str, request: Any, bounds: Bounds) -> Any:
    """Run a function in its own process, and return its result.

    Args:
        function: ``module:name`` of a function that takes the request and a ``Place``.
        request: any JSON value; so is the result.
        bounds: bounds of memory and processor time.

    Raises:
        BoundExceeded: the function exceeded a bound.
        RuntimeError: the function failed; its traceback is on stderr.
    """
    start = _fork if _is_single_threaded() else _spawn
    answer = json.loads(start(function, request, bounds))
    if "met" in answer:
        raise BoundExceeded(*answer["met"])
    if "failed" in answer:
        raise RuntimeError(answer["failed"])
    return answer["result"]


def _is_single_threaded() -> bool:
    try:
        return len(os.listdir("/proc/self/task")) == 1
    except OSError:  # only Linux has it
        return False


def _spawn(function: str, request: Any, bounds: Bounds) -> bytes:
    """Return the answer of a new interpreter, whose ``main`` forks."""
    import subprocess  # only now: most processes fork

    path = "\n".join(filter(None, sys.path))
    with subprocess.Popen(
        [sys.executable, "-I", "-S", "-c", _START, path, sys.prefix],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        start_new_session=True,  # Ctrl-C in a terminal must only reach the waiting process
    ) as process:
        try:
            answer, _ = process.communicate(
                json.dumps([function, request, bounds]).encode(),
                None if _FORKS else bounds.processor,
            )
        except subprocess.TimeoutExpired:
            process.kill()
            return json.dumps({"met": [f"{bounds.processor} s", "the description"]}).encode()
        except BaseException:
            if _FORKS:
                os.killpg(process.pid, signal.SIGKILL)  # its fork, too
            else:
                process.kill()
            raise
    return answer or json.dumps({"failed": f"the interpreter ended with {process.wait()}"}).encode()


def main() -> None:
    """Run the request that ``_spawn`` writes on stdin; answer on stdout."""
    function, request, bounds = json.load(sys.stdin)
    out = os.dup(1)
    os.dup2(2, 1)  # the function's prints must not mix with the answer
    run = _fork if _FORKS else partial(_answer, place=Place())
    answer = run(function, request, Bounds(*bounds))
    # The process that waits may have been killed.
    with suppress(BrokenPipeError), open(out, "wb") as file:
        file.write(answer)


def _fork(function: str, request: Any, bounds: Bounds) -> bytes:
    """Run the function in a fork of this process; return its answer."""
    place = Place()
    answers, out = os.pipe()
    child = os.fork()
    if not child:
        _in_child(function, request, bounds, place, out)
    os.close(out)
    try:
        with open(answers, "rb") as file:
            answer = file.read()
    except BaseException:
        os.kill(child, signal.SIGKILL)
        raise
    finally:
        code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    if answer and code == 0:
        return answer
    met = {-signal.SIGXCPU: f"{bounds.processor} s of processor time"}
    met[-signal.SIGKILL] = "the memory of this computer"
    if code in met:
        return json.dumps({"met": [met[code], place.read()]}).encode()
    text = f"the process of {place.read() or 'a bounded function'} ended with {code}"
    return json.dumps({"failed": text}).encode()


def _in_child(function: str, request: Any, bounds: Bounds, place: Place, out: int) -> NoReturn:
    """Run the function, write its answer to the file ``out`` and end this process."""
    code = 1
    try:
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_DFL)
        _limit(bounds)
        answer = _answer(function, request, bounds, place)
        with suppress(BrokenPipeError), open(out, "wb") as file:  # the parent may have ended
            file.write(answer)
        code = 0
    except BaseException:
        sys.excepthook(*sys.exc_info())
    finally:
        os._exit(code)  # files of the parent are neither flushed nor closed


def _answer(function: str, request: Any, bounds: Bounds, place: Place) -> bytes:
    module, _, name = function.partition(":")
    try:
        result = getattr(importlib.import_module(module), name)(request, place)
        return json.dumps({"result": result}).encode()
    except MemoryError:
        met = f"{bounds.memory / 1e9:g} GB of memory"
    return json.dumps({"met": [met, place.read()]}).encode()


def _limit(bounds: Bounds) -> None:
    """Limit this process; memory that it already uses does not count."""
    with suppress(FileNotFoundError):  # only Linux has these files, and obeys RLIMIT_AS
        Path("/proc/self/oom_score_adj").write_text("1000")  # killed before the robot's processes
        pages = int(Path("/proc/self/statm").read_text().split()[0])
        _lower(resource.RLIMIT_AS, pages * resource.getpagesize() + bounds.memory)
    _lower(resource.RLIMIT_CPU, math.ceil(time.process_time()) + bounds.processor)
    _lower(resource.RLIMIT_CORE, 0)


def _lower(kind: int, limit: int) -> None:
    soft, hard = resource.getrlimit(kind)
    bounds = [bound for bound in (soft, hard) if bound != resource.RLIM_INFINITY]
    resource.setrlimit(kind, (min([limit, *bounds]), hard))
