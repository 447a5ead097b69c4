"""``onebot evaluate``: runs the episodes of a study, on this computer or on a cluster."""

import argparse
import importlib.util
import sys
from argparse import Namespace
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from traceback import extract_tb
from types import ModuleType
from typing import TYPE_CHECKING, Any

from onebot_bringup.cli.options import Parser, count, flag, natural, option, positional, positive
from onebot_bringup.launch.program import INTERRUPTED
from onebot_description.atomic_write import refuse_unwritable
from onebot_description.errors import OneBotError, UsageError, did_you_mean
from onebot_description.ros.signals import KeyboardInterrupts

if TYPE_CHECKING:
    import pyarrow as pa

_SUMMARY = """\
run the function episode of a Python file for each of its cases, a list of mappings or a function
that returns one, and write the table of what the episodes return"""
_EPISODE, _CASES = "episode", "cases"
_ENDINGS = (".parquet", ".csv", ".xml")


def _minimum(text: str) -> tuple[str, float]:
    name, _, number = text.partition("=")
    try:
        return name, float(number)
    except ValueError:
        form = "write NAME=NUMBER, such as reached=0.95"
        raise argparse.ArgumentTypeError(f'"{text}": {form}') from None


OPTIONS = (
    positional("STUDY.py", "the file; STUDY.py:NAME for a function other than episode"),
    option("--workers", "N", "episodes at once (one on each processor)", count),
    option("--on", None, "where (processes)", default="processes", choices=("processes", "ray")),
    option(
        "--out",
        "FILE",
        "the table: .parquet, .csv, or .xml for JUnit; may be repeated",
        Path,
        [],
        action="append",
    ),
    option(
        "--min",
        "NAME=NUMBER",
        "exit code 1 if the mean of a column is lower; may be repeated",
        _minimum,
        [],
        action="append",
    ),
    option("--timeout", "SECONDS", "time limit of an episode (600)", positive, 600.0),
    option(
        "--keep",
        None,
        "which episodes leave a recording beside the table (failed)",
        default="failed",
        choices=("all", "failed", "none"),
    ),
    flag("--resume", "continue an interrupted study"),
    option("--case", "N", "run only this case, in this process, and print its row", natural),
    flag("--show", "show its recording, with --case"),
)


def run(argv: Sequence[str]) -> int:
    """Run the command and return its exit code."""
    args = Parser("onebot evaluate", _SUMMARY, OPTIONS).parse(argv)
    if args.show and args.case is None:
        raise UsageError("--show is for a single case: --case N --show")
    file, _, name = getattr(args, "study.py").partition(":")
    outs = [_checked_out(path) for path in args.out]
    with KeyboardInterrupts():
        study = _imported(Path(file))
        episode, cases = _member(study, name or _EPISODE), _member(study, _CASES)
        cases = cases() if callable(cases) else cases
        if args.case is not None:
            return _run_case(episode, cases, args)
        base = outs[0] if outs else Path(file)
        try:
            table = _evaluated(episode, cases, args, base)
        except KeyboardInterrupt:
            again = [*argv, *(() if args.resume else ["--resume"])]
            print(f"interrupted; continue with: onebot evaluate {' '.join(again)}", file=sys.stderr)
            return INTERRUPTED
    return _reported(table, args, outs)


def _checked_out(path: Path) -> Path:
    if path.suffix not in _ENDINGS:
        raise UsageError(f"--out {path}: the name must end in {', '.join(_ENDINGS)}")
    _refuse_unwritable(path)
    return path


def _refuse_unwritable(path: Path) -> None:
    try:
        refuse_unwritable(path)
    except OSError as error:
        raise OneBotError(f"{path} cannot be written: {error.strerror}") from None


def _imported(file: Path) -> ModuleType:
    """Import the file of a study, with the modules beside it.

    Raises:
        OneBotError: there is none, or it cannot be imported.
    """
    if not file.is_file():
        raise OneBotError(f"there is no file {file}")
    name = f"onebot_study_{file.stem}"
    spec = importlib.util.spec_from_file_location(name, file)
    if spec is None or spec.loader is None:
        raise OneBotError(f"{file} is not a Python file, whose name ends in .py")
    sys.path.append(str(file.resolve().parent))  # last: its modules hide no others
    sys.modules[name] = module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        line = _line(error, file.resolve())
        text = f"{type(error).__name__}: {' '.join(str(error).split())}"
        raise OneBotError(f"{file}{line} cannot be imported: {text}") from None
    return module


def _line(error: Exception, file: Path) -> str:
    """Return where in a file an error was raised, such as ``:12``; empty if not there."""
    places = [(frame.filename, frame.lineno) for frame in extract_tb(error.__traceback__)]
    if isinstance(error, SyntaxError):
        places.append((error.filename or "", error.lineno))
    lines = [line for name, line in places if Path(name).resolve() == file]
    return f":{lines[-1]}" if lines else ""


def _member(study: ModuleType, name: str) -> Any:
    if not hasattr(study, name):
        names = [each for each in vars(study) if not each.startswith("_")]
        hint = did_you_mean(name, names, "there are")
        raise OneBotError(f'{study.__file__} has no "{name}"{hint}')
    return getattr(study, name)


def _evaluated(episode: Any, cases: Any, args: Namespace, base: Path) -> "pa.Table":
    from onebot_bringup.testing.failed_run import record_run  # slower to import
    from onebot_control.evaluation.report import write_table
    from onebot_control.evaluation.study import SUCCESS, evaluate

    journal = base.with_suffix(".journal")
    if not args.resume:
        _refuse_unwritable(journal)
    table = evaluate(
        episode,
        cases,
        args.workers,
        on=args.on,
        timeout=args.timeout,
        success=[*SUCCESS, *(name for name, _ in args.min)],
        journal=journal,
        resume=args.resume,
        recorder=None if args.keep == "none" else record_run,
        recordings=base.with_name(f"{base.stem}_recordings"),
        keep="all" if args.keep == "all" else "failed",
        progress=True,
    )
    for path in args.out:
        write_table(table, path)
    journal.unlink(missing_ok=True)
    return table


def _reported(table: "pa.Table", args: Namespace, outs: Sequence[Path]) -> int:
    """Print the success of a study; return the exit code."""
    from onebot_control.evaluation.report import share, summary

    print(summary(table))
    for path in outs:
        print(f"wrote {path}")
    code = 0
    for name, minimum in args.min:
        mean = share(table, name)
        if not mean >= minimum:
            print(f"{name}: {mean:g} is below {minimum:g}", file=sys.stderr)
            code = 1
    return code


def _run_case(episode: Any, cases: Any, args: Namespace) -> int:
    """Run one case in this process and print its row; show it if requested."""
    from onebot_bringup.cli import replay
    from onebot_bringup.testing.failed_run import record_run
    from onebot_control.evaluation.cases import checked_cases
    from onebot_control.evaluation.study import evaluate

    listed = checked_cases(cases)
    if args.case >= len(listed):
        raise OneBotError(f"there is no case {args.case}; the last one is {len(listed) - 1}")
    with TemporaryDirectory(prefix="onebot-") as folder:
        recorder = record_run if args.show else None
        chosen = [listed[args.case]]
        table = evaluate(
            episode, chosen, 0, recorder=recorder, recordings=folder, keep="all", progress=False
        )
        for name, value in table.to_pylist()[0].items():
            print(f"{name}: {value}")
        if args.show:
            recording = Path(folder) / "0.rrd"
            if not recording.is_file():
                raise OneBotError("there is nothing to show: the episode created no Simulation")
            return replay.run([str(recording)])
    return 0
