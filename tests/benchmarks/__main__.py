"""``python -m tests.benchmarks``: runs benchmarks and prints their tables."""

import argparse
import importlib
import os
import sys
import time
from pathlib import Path

from onebot_description.errors import OneBotError, did_you_mean
from onebot_description.ros.signals import KeyboardInterrupts
from tests.benchmarks.report import Report, machine, table, write_section
from tests.orphans import end_with_this_process

# Each benchmark is a module of this package with ``run(quick: bool) -> Report``. It raises
# ``WrongAnswer`` where an answer is wrong, and stops all that it has started however it ends.
BENCHMARKS = (
    *("state_publisher", "simulation", "drives", "arms", "from_python", "lockstep", "stepping"),
    *("fleet", "startup", "control_loop", "viewer", "sensing", "tf2", "evaluation"),
    "navigation",
)


def main(argv: list[str]) -> int:
    """Run the command and return its exit code.

    Raises:
        WrongAnswer: what was measured gave wrong answers.
        OneBotError: there is no such benchmark, or the README cannot be written.
    """
    parser = argparse.ArgumentParser(
        prog="python -m tests.benchmarks",
        description="Measures OneBot's parts, each against a floor that is measured in the same "
        "run. A wrong answer is an error; a missed goal is reported, and is none: times are the "
        "machine's. tests/benchmarks/README.md says what each of them measures.",
        epilog=f"benchmarks: {', '.join(BENCHMARKS)}",
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help="what to measure; default: all")
    parser.add_argument(
        "--quick", action="store_true", help="a little of everything: checks the answers only"
    )
    parser.add_argument(
        "--write", type=Path, metavar="README.md", help="also write the table between its marks"
    )
    arguments = parser.parse_args(argv)
    for name in arguments.names:
        if name not in BENCHMARKS:
            raise OneBotError(
                f'no benchmark "{name}"{did_you_mean(name, BENCHMARKS, "benchmarks")}'
            )
    if arguments.quick and arguments.write:
        raise OneBotError("the times of --quick mean nothing, so they are not written")
    # As a bringup has it, before a benchmark imports numpy: threads that spin are no work of ours.
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    with KeyboardInterrupts():  # whatever a benchmark has started is stopped
        _run(arguments.names or [*BENCHMARKS], arguments.quick, arguments.write)
    return 0


def _run(names: list[str], quick: bool, readme: Path | None) -> None:
    described = machine()
    print(described, end="\n\n", flush=True)
    reports: dict[str, Report] = {}
    for name in names:
        print(f"{time.strftime('%H:%M:%S')} {name}", file=sys.stderr)
        reports[name] = importlib.import_module(f"{__package__}.{name}").run(quick)
        if quick:
            print(f"{name}: all answers were right; the times of a quick run mean nothing")
            continue
        print(table({name: reports[name]}), flush=True)
        if readme:
            write_section(readme, described, reports)


if __name__ == "__main__":
    end_with_this_process()
    try:
        sys.exit(main(sys.argv[1:]))
    except OneBotError as error:
        sys.exit(f"benchmarks: {error}")
    except KeyboardInterrupt:
        sys.exit(130)
