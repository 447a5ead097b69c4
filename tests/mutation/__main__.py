"""``python -m tests.mutation``: do the tests of the pure cores notice faults put into the code?

Takes a sample of all mutants of the modules, puts one after another into a copy of the checkout,
and runs the tests of its module there. Needs the extra "mutation".
"""

import argparse
import contextlib
import os
import queue
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import islice
from pathlib import Path

from tests.mutation.mutants import Mutant, mutants
from tests.mutation.targets import CHECKOUT, TESTS, missing

GOAL = 0.9  # of the mutants; a few in a hundred behave as the code does
_MEMORY = 8 << 30  # bytes of addresses: for a mutant that collects something without end
_OPTIONS = ("-n0", "-p", "no:cacheprovider", "-p", "tests.mutation.profile")
_SKIPPED = shutil.ignore_patterns(".*", "__pycache__", "build", "dist", "install", "log")


class Copies:
    """Copies of the checkout, one for each worker, in which the tests of a mutant run."""

    def __init__(self, folder: Path, count: int) -> None:
        self._free: queue.SimpleQueue[Path] = queue.SimpleQueue()
        self._limits: dict[tuple[str, ...], float] = {}  # s, a run of these tests may take
        self._running: set[subprocess.Popen[bytes]] = set()
        for number in range(count):
            self._free.put(shutil.copytree(CHECKOUT, folder / str(number), ignore=_SKIPPED))

    def measure(self, tests: tuple[str, ...]) -> None:
        """Run the tests without a mutant.

        Raises:
            SystemExit: they fail.
        """
        copy = self._free.get()
        started = time.monotonic()
        failed = self._fails(copy, tests, None)
        self._limits[tests] = 60 + 10 * (time.monotonic() - started)
        self._free.put(copy)
        if failed:
            raise SystemExit(f"without a mutant, too, these tests fail: {' '.join(tests)}")

    def catches(self, mutant: Mutant) -> bool:
        """Return whether a test fails, or does not end, with this mutant."""
        copy = self._free.get()
        file = copy / mutant.module
        original = file.read_bytes()
        try:
            file.write_text(mutant.source(), encoding="utf-8")
            tests = TESTS[mutant.module]
            return self._fails(copy, tests, self._limits[tests])
        finally:
            file.write_bytes(original)
            self._free.put(copy)

    def stop(self) -> None:
        """End the tests that run."""
        for process in list(self._running):
            _kill(process)

    def _fails(self, copy: Path, tests: tuple[str, ...], limit: float | None) -> bool:
        process = subprocess.Popen(
            [sys.executable, "-m", "pytest", "-qx", *_OPTIONS, *tests],
            cwd=copy,
            # Bytecode of the last mutant could be taken for this one's: same size, same second.
            env={**os.environ, "PYTHONPATH": str(copy), "PYTHONDONTWRITEBYTECODE": "1"},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        self._running.add(process)
        resource.prlimit(process.pid, resource.RLIMIT_AS, (_MEMORY, _MEMORY))
        try:
            return process.wait(limit) != 0
        except subprocess.TimeoutExpired:
            return True
        finally:
            _kill(process)
            process.wait()
            self._running.discard(process)


def _kill(process: subprocess.Popen[bytes]) -> None:
    """Kill the tests, and what a mutant left running in their session."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)


def _sample(modules: Iterable[str], size: int, seed: int) -> list[Mutant]:
    """Return ``size`` mutants, or all if there are fewer."""
    every = [mutant for module in modules for mutant in mutants(module)]
    random.Random(seed).shuffle(every)
    sample = [*islice((mutant for mutant in every if mutant.is_python()), size)]
    print(f"{len(sample)} of {len(every)} mutants, seed {seed}", flush=True)
    return sample


def _run(sample: Sequence[Mutant]) -> list[bool]:
    workers = len(os.sched_getaffinity(0))
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(workers) as pool:
        copies = Copies(Path(folder), workers)
        try:
            list(pool.map(copies.measure, {TESTS[mutant.module] for mutant in sample}))
            return list(map(_report, sample, pool.map(copies.catches, sample)))
        finally:
            pool.shutdown(wait=False, cancel_futures=True)
            copies.stop()


def _report(mutant: Mutant, caught: bool) -> bool:
    print(".", end="", file=sys.stderr, flush=True)
    if not caught:
        print(f"\nsurvived: {mutant.diff()}", flush=True)
    return caught


def _print(sample: Sequence[Mutant], caught: Sequence[bool]) -> None:
    print()
    for module in sorted({mutant.module for mutant in sample}):
        hits = [hit for mutant, hit in zip(sample, caught, strict=True) if mutant.module == module]
        print(f"{module:55} {sum(hits):4}/{len(hits)}")
    print(f"{sum(caught)} of {len(caught)} caught: {sum(caught) / len(caught):.1%}")


def main() -> int:
    """Run the command; the exit code is 1 if fewer than nine in ten are caught."""
    parser = argparse.ArgumentParser(prog="python -m tests.mutation", description=__doc__)
    parser.add_argument("modules", nargs="*", metavar="MODULE", help="paths; default: all")
    parser.add_argument("--sample", type=int, default=200, metavar="N", help="mutants to run")
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="of the sample")
    arguments = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))
    if lost := missing():
        parser.error(f"tests/mutation/targets.py names what does not exist: {', '.join(lost)}")
    if unknown := sorted(set(arguments.modules) - set(TESTS)):
        parser.error(f"not in tests/mutation/targets.py: {', '.join(unknown)}")
    sample = _sample(arguments.modules or TESTS, arguments.sample, arguments.seed)
    if not sample:
        parser.error("nothing to mutate")
    caught = _run(sample)
    _print(sample, caught)
    return int(sum(caught) < GOAL * len(caught))


if __name__ == "__main__":
    sys.exit(main())
