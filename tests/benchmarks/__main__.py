"""``python -m tests.benchmarks``: runs benchmarks and prints their tables."""

import argparse
import importlib
import sys
from pathlib import Path

from onebot_description.errors import OneBotError, did_you_mean
from onebot_description.signals import KeyboardInterrupts
from tests.benchmarks import machine
from tests.benchmarks.report import Options, Report, markdown, plain, say_on_stderr, write_section

# Each benchmark is a module of this package with ``run(options: Options) -> Report``. It reports
# progress with ``options.say``, raises ``WrongAnswer`` where an answer is wrong, and stops all that
# it has started however it ends.
BENCHMARKS = {
    "state_publisher": "CPU, latency and memory of robot_state_publisher against a relay of bytes",
    "simulation": "real-time factor of 1 to 100 OneBots with controllers against bare PyBullet",
    "fleet": "processor time and memory of robots:=1 to 50 in one world against bare PyBullet",
    "startup": "command to first /tf, /odom and frame logged, and memory, against an empty node",
    "control_loop": "jitter at 100 Hz and latency of commands, with the viewer and without",
    "viewer": "CPU of the viewer for each robot state against bare send_columns",
    "sensing": "CPU of ranges and pictures against bare Embree; jitter with sensors subscribed to",
    "displays": "CPU of displays of scans, clouds, images, maps, markers against bare send_columns",
}


def main(argv: list[str]) -> int:
    """Run the command and return its exit code.

    Raises:
        WrongAnswer: what was measured gave wrong answers.
        OneBotError: a benchmark cannot be run, or the README cannot be written.
    """
    parser = argparse.ArgumentParser(
        prog="python -m tests.benchmarks",
        description="Measures OneBot's parts, each against a floor that is measured in the same "
        "run. A wrong answer is an error; a missed goal is reported, and is none: times are the "
        "machine's.",
        epilog="\n".join(f"{name:16}{text}" for name, text in BENCHMARKS.items()),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help="what to measure; default: all")
    parser.add_argument(
        "--quick", action="store_true", help="a little of everything: checks the answers only"
    )
    parser.add_argument(
        "--write", type=Path, metavar="README.md", help="also write the goals between its marks"
    )
    arguments = parser.parse_args(argv)
    for name in arguments.names:
        if name not in BENCHMARKS:
            known = did_you_mean(name, BENCHMARKS, "benchmarks")
            raise OneBotError(f'no benchmark "{name}"{known}')
    if arguments.quick and arguments.write:
        raise OneBotError("the times of --quick mean nothing, so they are not written")
    _run(arguments.names or [*BENCHMARKS], Options(quick=arguments.quick), arguments.write)
    return 0


def _run(names: list[str], options: Options, readme: Path | None) -> None:
    described = machine.describe()
    print(machine.sentence(described), end="\n\n", flush=True)
    reports: list[Report] = []
    with KeyboardInterrupts():  # whatever a benchmark has started is stopped
        for name in names:
            say_on_stderr(f"{name}: {BENCHMARKS[name]}")
            module = importlib.import_module(f"{__package__}.{name}")
            reports.append(module.run(options))
            print(plain(reports[-1], verdict=not options.quick), flush=True)
            if readme:
                write_section(readme, markdown(machine.sentence(described), reports))
    if options.quick:
        print("all answers were right; the times of a quick run mean nothing")


if __name__ == "__main__":
    try:
        sys.exit(main(sys.argv[1:]))
    except OneBotError as error:
        sys.exit(f"benchmarks: {error}")
    except KeyboardInterrupt:
        sys.exit(130)
