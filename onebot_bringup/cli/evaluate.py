"""``onebot evaluate``: runs the episodes of a study, on this computer or on a cluster."""

import sys
from argparse import Namespace
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from traceback import extract_tb
from types import ModuleType
from typing import Any

from onebot_bringup.cli.options import (
    Parser,
    assignment,
    count,
    flag,
    natural,
    option,
    positional,
    positive,
)
from onebot_bringup.launch.program import INTERRUPTED
from onebot_description.atomic_write import refuse_unwritable, writing
from onebot_description.errors import OneBotError, UsageError, did_you_mean
from onebot_description.ros.signals import KeyboardInterrupts

_SUMMARY = (
    "run the episode of a Python file for each of its cases, and write a table of the results"
)


_KEEP = ("all", "failed", "none")
_MANY = {"action": "append", "default": []}
OPTIONS = (
    positional("STUDY.py", "the file; STUDY.py:NAME for a function other than episode"),
    option("--workers", "N", "episodes at once (one on each processor)", count),
    option("--on", None, "where (processes)", default="processes", choices=("processes", "ray")),
    option("--out", "FILE", "table: .parquet, .csv or .xml (JUnit); repeatable", Path, **_MANY),
    option("--min", "NAME=NUMBER", "exit code 1 below this mean; repeatable", assignment, **_MANY),
    option("--timeout", "SECONDS", "time limit of an episode (600)", positive, 600.0),
    option("--keep", None, "episodes to record (failed)", default="failed", choices=_KEEP),
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
    with KeyboardInterrupts():
        _check_outs(args.out)
        study = _imported(Path(file))
        episode = _member(study, name or "episode")
        cases = _listed(_member(study, "cases"), Path(file))
        if args.case is not None:
            return _run_case(episode, cases, args)
        try:
            return _run_all(episode, cases, args, (args.out or [Path(file)])[0])
        except KeyboardInterrupt:
            again = [*argv, *(() if args.resume else ["--resume"])]
            text = f"\ninterrupted; continue with: onebot evaluate {' '.join(again)}"
            print(text, file=sys.stderr)
            return INTERRUPTED


def _check_outs(paths: Sequence[Path]) -> None:
    """Reject files that could not be written, before any episode runs."""
    from onebot_control.evaluation.report import WRITERS

    for path in paths:
        if path.suffix not in WRITERS:
            raise UsageError(f"--out {path}: the name must end in {', '.join(WRITERS)}")
        with writing(path):
            refuse_unwritable(path)


def _imported(file: Path) -> ModuleType:
    """Import the file of a study, with the modules beside it.

    Raises:
        OneBotError: there is none, or it cannot be imported.
    """
    name = f"onebot_study_{file.stem}"
    sys.path.append(str(file.resolve().parent))  # last: its modules hide no others
    sys.modules[name] = module = ModuleType(name)
    module.__file__ = str(file.resolve())
    with _located(file, "cannot be imported"):
        exec(compile(file.read_bytes(), module.__file__, "exec"), vars(module))
    return module


@contextmanager
def _located(file: Path, problem: str) -> Iterator[None]:
    """Turn an exception of a study's code into an OneBotError that names its line."""
    from onebot_control.evaluation.episode import sentence

    try:
        yield
    except (Exception, SystemExit) as error:
        frames = extract_tb(error.__traceback__)
        lines = [frame.lineno for frame in frames if frame.filename == str(file.resolve())]
        place = f"{file}:{lines[-1]}" if lines else file
        raise OneBotError(f"{place} {problem}: {sentence(error)}") from None


def _listed(cases: Any, file: Path) -> list[Any]:
    """Return the cases of a study, which may be a function or a generator."""
    from onebot_control.evaluation.cases import checked_cases

    with _located(file, "has no usable cases"):
        return checked_cases(cases() if callable(cases) else cases)


def _member(study: ModuleType, name: str) -> Any:
    if not hasattr(study, name):
        names = [each for each in vars(study) if not each.startswith("_")]
        hint = did_you_mean(name, names, "there are")
        raise OneBotError(f'{study.__file__} has no "{name}"{hint}')
    return getattr(study, name)


def _run_all(episode: Any, cases: list[Any], args: Namespace, base: Path) -> int:
    """Run all cases; write and print the results beside ``base``; return the exit code."""
    from onebot_bringup.testing.failed_run import record_run  # slower to import
    from onebot_control.evaluation.report import share, summary, write_table
    from onebot_control.evaluation.study import SUCCESS, evaluate

    journal = base.with_suffix(".journal")
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
    print(summary(table))
    means = {name: share(table, name) for name, _ in args.min}
    missed = [(name, least) for name, least in args.min if not means[name] >= least]
    for name, least in missed:
        print(f"{name}: {means[name]:g} is below {least:g}", file=sys.stderr)
    return 1 if missed else 0


def _run_case(episode: Any, cases: list[Any], args: Namespace) -> int:
    """Run one case in this process and print its row; show it if requested."""
    from onebot_bringup.cli import replay
    from onebot_bringup.testing.failed_run import record_run
    from onebot_control.evaluation.study import evaluate

    if args.case >= len(cases):
        raise OneBotError(f"there is no case {args.case}; the last one is {len(cases) - 1}")
    recorder, chosen = record_run if args.show else None, [cases[args.case]]
    with TemporaryDirectory(prefix="onebot-") as folder:
        table = evaluate(episode, chosen, 0, recorder=recorder, recordings=folder, keep="all")
        for name, value in table.to_pylist()[0].items():
            print(f"{name}: {value}")
        if not args.show:
            return 0
        if not (recording := Path(folder, "0.rrd")).exists():
            raise OneBotError("there is nothing to show: the episode has created no Simulation")
        return replay.run([str(recording)])
