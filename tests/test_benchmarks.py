"""The benchmarks check what they measure, and refuse to report when it is wrong."""

import signal
import subprocess
import sys
import time
from contextlib import suppress

import psutil
import pytest
from builtin_interfaces.msg import Time
from rclpy.serialization import deserialize_message, serialize_message

from onebot_description.errors import OneBotError
from onebot_description.ros.wire.interfaces import TFMessage
from onebot_description.ros.wire.messages import transforms_message
from tests.benchmarks import cases, report, viewer
from tests.benchmarks.__main__ import BENCHMARKS, main
from tests.benchmarks.chains import Chain
from tests.benchmarks.load import Answers
from tests.benchmarks.measuring import WrongAnswer, cpu_ns, in_turn, rss_mb
from tests.benchmarks.report import Result
from tests.support import PATIENCE, wait_for

REPORTS = {"some": [Result("cost", 1.5, 1.25), Result("speed", 12.0, at_least=10.0, unit="Hz")]}
STAMP = 1_700_000_000_000_000_123


def turn(transform):
    transform.rotation.z += 1e-6


def lose(transform):
    transform.translation.x = float("nan")


LIES = {
    "is off by 1e-06": lambda each: turn(each[3].transform),
    "is off by nan": lambda each: lose(each[3].transform),
    "is not stamped": lambda each: setattr(each[3].header, "stamp", Time()),
    "'x'.*not": lambda each: setattr(each[3], "child_frame_id", "x"),
    "'link_4'.*not": lambda each: each.pop(),
}


@pytest.mark.slow
def test_quick_run(capfd):
    """Every answer is right; there is no verdict on times, and no process is left."""
    before = set(psutil.Process().children(recursive=True))
    names = [name for name in BENCHMARKS if name != "state_publisher"]  # the README's test runs it
    assert main([*names, "--quick"]) == 0
    printed = capfd.readouterr().out
    assert "cores" in printed and "MISSED" not in printed
    assert all(f"{name}: all answers were right" in printed for name in names)
    assert set(psutil.Process().children(recursive=True)) <= before


@pytest.mark.parametrize(("complaint", "lie"), LIES.items())
def test_wrong_transforms_are_refused(complaint, lie):
    """Also after right ones, which are compared by their bytes only."""
    chain = Chain(5)
    answers = Answers(chain, chain.positions(2))
    poses = chain.transforms(chain.positions(2))[1]
    poses[2, 3:] *= -1  # the same rotation
    sec, nanosec = divmod(STAMP, 10**9)
    right = bytes(
        serialize_message(
            transforms_message(
                Time(sec=sec, nanosec=nanosec), *zip(*chain.frames, strict=True), poses
            )
        )
    )
    for _ in range(2):
        answers.check(right, 1, STAMP)
    message = deserialize_message(right, TFMessage)
    lie(message.transforms)
    with pytest.raises(WrongAnswer, match=complaint):
        answers.check(bytes(serialize_message(message)), 1, STAMP)


def test_display_with_wrong_answers_is_refused():
    """The error says which of the two it was, and in what."""
    case = cases.CASES[2]
    (drawn,) = case.drawn

    def moved(arrays, count):
        moved = {name: values + (values.dtype.kind == "f") for name, values in arrays.items()}
        return drawn.columns(moved, count)

    with pytest.raises(WrongAnswer, match="bare.*1000 rays.*Points3D:positions of message 0"):
        viewer.measure(case._replace(drawn=(drawn._replace(columns=moved),)), quick=True)


@pytest.mark.slow
def test_interrupted_run_leaves_no_process():
    """Ctrl-C ends it and all that it has started, in the background of a shell, too."""
    for number in (signal.SIGINT, signal.SIGTERM):
        run = subprocess.Popen(
            [sys.executable, "-m", "tests.benchmarks", "state_publisher"],
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_IGN),
        )
        try:
            process = psutil.Process(run.pid)
            started = wait_for(lambda p=process: _nodes(p), "the nodes")
            time.sleep(1.0)
            run.send_signal(number)
            assert run.wait(PATIENCE)
        finally:
            run.kill()
        wait_for(lambda nodes=started: not any(map(_lives, nodes)), "all processes to end")


def _nodes(process):
    children = process.children(recursive=True)
    with suppress(psutil.NoSuchProcess):  # one that ends meanwhile
        if any("relay" in " ".join(each.cmdline()) for each in children):
            return children
    return []


def _lives(process):
    return process.is_running() and process.status() != psutil.STATUS_ZOMBIE


def test_cpu_time_is_the_kernels():
    """Of a process that works, it agrees with the process's own clock; and it has memory."""
    code = "import time\nwhile time.process_time() < 0.5: pass\nprint('done', flush=True)\ninput()"
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen([sys.executable, "-c", code], text=True, **pipes) as worker:
        assert worker.stdout.readline() == "done\n"
        clock = time.clock_gettime_ns((~worker.pid << 3) | 2)
        assert cpu_ns(worker.pid) == pytest.approx(clock, rel=0.05)
        assert 1.0 < rss_mb(worker.pid) < 1e3
        worker.communicate("\n")


def test_variants_run_in_turn():
    """Each as often as the others, and none always after the same one."""
    order = []
    results = in_turn({name: lambda name=name: order.append(name) or name for name in "abc"}, 2)
    assert order == list("abccba")
    assert results == {name: [name, name] for name in "abc"}


@pytest.mark.parametrize(
    ("result", "cells"),
    [
        (Result("x", 1.5, 1.25), ["1.50 (MISSED)", "at most 1.25"]),
        (Result("x", 1.2, 1.25), ["1.20", "at most 1.25"]),
        (Result("x", 422.4, 1000, unit="MB"), ["422 MB", "at most 1000 MB"]),
        (Result("x", 0.98, at_least=0.99), ["0.980 (MISSED)", "at least 0.99"]),
        (Result("x", float("nan"), 1.0), ["nan (MISSED)", "at most 1"]),
        (Result("x", 1234.5, unit="us"), ["1234 us", ""]),
    ],
)
def test_numbers_and_goals(result, cells):
    """Three digits; NaN meets no goal."""
    assert result.row() == ["x", *cells]


def test_table_in_a_readme(tmp_path):
    """What stood between the marks is replaced, as often as one likes; other rows stay."""
    readme = tmp_path / "README.md"
    readme.write_text(f"before\n{report.BEGIN}\nold\n{report.END}\nafter\n")
    report.write_section(readme, "a machine", {"other": [Result("x", 1.0)]})
    for _ in range(2):
        report.write_section(readme, "a machine", REPORTS)
        section = readme.read_text()
        assert section.startswith("before\n") and section.endswith(f"{report.END}\nafter\n")
        assert "old\n" not in section and "Rows of other benchmarks are older" in section
        assert section.count("| some | speed | 12.0 Hz | at least 10 Hz |") == 1
        assert section.count("| other | x | 1.00 |  |") == 1


def test_mistakes_are_explained(tmp_path):
    """Before anything is run, and where the table cannot be written."""
    readme = tmp_path / "README.md"
    readme.write_text("no marks\n")
    with pytest.raises(OneBotError, match='did you mean "viewer"'):
        main(["viewr"])
    with pytest.raises(OneBotError, match="mean nothing"):
        main(["viewer", "--quick", "--write", str(readme)])
    with pytest.raises(OneBotError, match="has no lines <!-- benchmarks -->"):
        report.write_section(readme, "", REPORTS)
