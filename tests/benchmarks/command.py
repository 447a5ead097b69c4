"""``onebot bench``: run benchmarks, print their tables, and write them where they are asked for."""

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

from onebot_bringup.launch.arguments import UsageError
from onebot_description.errors import OneBotError
from onebot_description.signals import KeyboardInterrupts
from tests.benchmarks import machine
from tests.benchmarks.plot import svg
from tests.benchmarks.registry import BENCHMARKS, Options, chosen, run, say_on_stderr
from tests.benchmarks.report import plain
from tests.benchmarks.saving import Results, load, markdown, save, write_section

_DESCRIPTION = """\
Measures OneBot's parts, each against a floor that is measured in the same run. Every benchmark
checks the answers it gets, and reports nothing (exit code 1) when one is wrong. A goal that is
missed is said so, and is no error: times are the machine's."""


class _Parser(argparse.ArgumentParser):
    """Reports errors as all ``onebot`` commands do."""

    def error(self, message: str) -> NoReturn:
        raise UsageError(f"onebot bench: {message}")


def main(argv: Sequence[str]) -> int:
    """Run the command.

    Returns:
        The exit code.

    Raises:
        WrongAnswer: what was measured gave wrong answers.
        OneBotError: a benchmark cannot be run, or a file cannot be read or written.
        UsageError: the command line is not understood.
    """
    arguments = _parse(argv)
    if arguments.list:
        _list()
        return 0
    _check_files(arguments)
    if arguments.results:
        results = _pick(load(arguments.results), arguments.names)
        _print(results)
    else:
        results = _run(arguments)
    if arguments.plot:
        _write_plot(arguments.plot, results)
    if arguments.write:
        plot = arguments.plot
        address = os.path.relpath(plot.resolve(), arguments.write.resolve().parent) if plot else ""
        write_section(arguments.write, markdown(results, address))
    return 0


def _parse(argv: Sequence[str]) -> argparse.Namespace:
    parser = _Parser(prog="onebot bench", description=_DESCRIPTION)
    parser.add_argument("names", nargs="*", metavar="NAME", help="what to measure; default: all")
    parser.add_argument("--list", action="store_true", help="say what there is, and run nothing")
    parser.add_argument(
        "--quick", action="store_true", help="a little of everything: checks the answers only"
    )
    parser.add_argument("--output", type=Path, metavar="FILE.json", help="write the results there")
    parser.add_argument("--plot", type=Path, metavar="FILE.svg", help="plot how cost grows")
    parser.add_argument(
        "--write",
        type=Path,
        metavar="README.md",
        help="put tables and plot into a file, between the lines <!-- benchmarks --> and "
        "<!-- /benchmarks -->",
    )
    parser.add_argument(
        "--results", type=Path, metavar="FILE.json", help="run nothing, take an earlier --output"
    )
    parser.add_argument(
        "--peer",
        metavar="CMD",
        help="measure this node, too, in state_publisher; in CMD {urdf} stands for a parameter "
        "file with the robot_description, {file} for the URDF",
    )
    arguments = parser.parse_args(argv)
    if arguments.peer and arguments.results:
        raise UsageError("onebot bench: --peer needs a run, --results makes none")
    return arguments


def _check_files(arguments: argparse.Namespace) -> None:
    """Find out before the run, and not after, what could not be written."""
    if arguments.plot and arguments.plot.suffix != ".svg":
        raise UsageError(f"onebot bench: --plot writes an SVG, so not {arguments.plot}")
    if arguments.quick and (arguments.plot or arguments.write):
        raise UsageError("onebot bench: the times of --quick mean nothing, so nothing is plotted")
    for file in (arguments.output, arguments.plot, arguments.write):
        if file and not file.resolve().parent.is_dir():
            raise OneBotError(f"{file}: there is no folder {file.resolve().parent}")
    if arguments.write:
        write_section(arguments.write, _section(arguments.write))


def _section(file: Path) -> str:
    """What stands between the marks, so that writing it again shows that it can be written."""
    from tests.benchmarks.saving import BEGIN, END

    try:
        old = file.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise OneBotError(f"{file}: {error}") from None
    return old.partition(BEGIN)[2].partition(END)[0].lstrip("\n")


def _list() -> None:
    width = max(map(len, BENCHMARKS))
    for name, summary in BENCHMARKS.items():
        print(f"{name:{width}}  {summary}")


def _run(arguments: argparse.Namespace) -> Results:
    names = chosen(arguments.names)
    if arguments.peer and "state_publisher" not in names:
        raise UsageError("onebot bench: --peer is for state_publisher")
    options = Options(quick=arguments.quick, peer=arguments.peer)
    results = Results(machine.describe(), arguments.quick, [])
    print(machine.sentence(results.machine), end="\n\n", flush=True)
    with KeyboardInterrupts():  # whatever a benchmark has started is stopped
        for name in names:
            say_on_stderr(f"{name}: {BENCHMARKS[name]}")
            report = run(name, options)
            results = Results(results.machine, results.quick, [*results.reports, report])
            print(plain(report, verdict=not arguments.quick), flush=True)
            if arguments.output:
                save(arguments.output, results)
    if arguments.quick:
        print("all answers were right; the times of a quick run mean nothing")
    return results


def _pick(results: Results, names: Sequence[str]) -> Results:
    wanted = chosen(names)
    reports = [report for report in results.reports if report.name in wanted]
    return Results(results.machine, results.quick, reports)


def _print(results: Results) -> None:
    print(machine.sentence(results.machine), end="\n\n")
    for report in results.reports:
        print(plain(report, verdict=not results.quick))


def _write_plot(file: Path, results: Results) -> None:
    plots = [plot for report in results.reports for plot in report.growth]
    if not plots:
        print(f"nothing to plot, {file} is not written", file=sys.stderr)
        return
    try:
        file.write_text(svg(plots), encoding="utf-8")
    except OSError as error:
        raise OneBotError(f"{file}: {error}") from None
