"""The benchmarks check what they measure, and refuse to report when it is wrong."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from onebot_description.errors import OneBotError
from tests.benchmarks import displays, report, state_publisher
from tests.benchmarks.__main__ import BENCHMARKS, main
from tests.benchmarks.measuring import (
    CHECKOUT,
    Running,
    WrongAnswer,
    cpu_ns,
    in_turn,
    process_tree,
    rss_bytes,
)
from tests.benchmarks.report import Options, Report, at_least, at_most, plain, text
from tests.support import PATIENCE, wait_for

REPORT = Report(
    "some",
    [{"Node": "a | b", "us": 1.23456}, {"Node": "c", "MB": 12}],
    [at_most("cost", 1.5, 1.25), at_least("speed", 12.0, 10.0, "Hz")],
    ["A note."],
)

# A node that answers as robot_state_publisher does, but for what is put in place of LIE.
LIAR = """
import sys
from onebot_description.node import run_node
from tests.benchmarks.naive_publisher import NaivePublisher

class Liar(NaivePublisher):
    def _on_joint_state(self, state):
        publisher, self._tf = self._tf, self
        super()._on_joint_state(state)
        self._tf = publisher
        message = self.message
        LIE
        publisher.publish(message)

    def publish(self, message):
        self.message = message

sys.exit(run_node(lambda: Liar(sys.argv[1]), []))
"""
LIES = {
    "a transform is off by": "message.transforms[3].transform.rotation.z += 1e-6",
    "is off by": "message.transforms[3].transform.translation.x = float('nan')",
    "is not stamped": "message.transforms[3].header.stamp = type(state.header.stamp)()",
    "not asked for: link_3 -> x": "message.transforms[3].child_frame_id = 'x'",
    "9 transforms instead of 10": "message.transforms.pop()",
}


@pytest.mark.slow
@pytest.mark.parametrize("name", BENCHMARKS)
def test_quick_run(name, capsys):
    """Every answer is right; there are results, no verdict on times, and no process is left."""
    before = set(process_tree(os.getpid()))
    assert main([name, "--quick"]) == 0
    printed = capsys.readouterr().out
    assert f"== {name}" in printed and "cores" in printed and "goal" not in printed
    assert set(process_tree(os.getpid())) <= before


@pytest.mark.slow
@pytest.mark.parametrize(("complaint", "lie"), LIES.items())
def test_node_with_wrong_answers_is_refused(complaint, lie, tmp_path):
    """The error says which node it was, and what was wrong."""
    script = tmp_path / "liar.py"
    script.write_text(LIAR.replace("LIE", lie))
    peer = f"env PYTHONPATH={CHECKOUT} {sys.executable} {script} {{file}}"
    nodes = {"peer": peer}
    effort = state_publisher.Effort(1, 10, 1.0)
    with pytest.raises(WrongAnswer) as error:
        state_publisher.measure(10, nodes, effort, Options(quick=True))
    assert str(error.value).startswith("peer, 10 joints: ")
    assert complaint in str(error.value)


@pytest.mark.slow
def test_peer_that_dies_is_an_error():
    """What it said is in the message."""
    nodes = {"peer": f"{sys.executable} -c 'import sys; sys.exit(\"no robot\")'"}
    effort = state_publisher.Effort(1, 10, 1.0)
    with pytest.raises(OneBotError, match="(?s)peer ended with exit code 1.*no robot"):
        state_publisher.measure(10, nodes, effort, Options(quick=True))


def test_display_with_wrong_answers_is_refused():
    """The error says which of the two it was, and in what."""
    case = displays.CASES[0]

    def moved(arrays):
        return case.columns(
            {name: values + (values.dtype.kind == "f") for name, values in arrays.items()}
        )

    with pytest.raises(WrongAnswer, match="bare.*1000 rays: Points3D:positions of message 0"):
        displays.measure(case._replace(columns=moved), Options(quick=True))


@pytest.mark.slow
def test_interrupted_run_leaves_no_process():
    """Ctrl-C ends it and all that it has started, in the background of a shell, too."""
    for number in (signal.SIGINT, signal.SIGTERM):
        with Running(
            [sys.executable, "-m", "tests.benchmarks", "state_publisher", "--quick"],
            os.environ,
            name="bench",
        ) as run:
            run.wait_for(lambda run=run: "closed loop, 1 rounds" in run.output, "the nodes")
            started = process_tree(run.process.pid)
            assert len(started) > 4
            os.kill(run.process.pid, number)
            run.process.wait(PATIENCE)
        wait_for(lambda pids=started: not any(map(_lives, pids)), "all processes to end")


def _lives(pid: int) -> bool:
    try:
        status = Path(f"/proc/{pid}/stat").read_text()
    except OSError:
        return False
    return status.rpartition(")")[2].split()[0] != "Z"


def test_child_ends_with_a_killed_benchmark(tmp_path):
    """A run that is killed leaves nothing either."""
    file = tmp_path / "pid"
    script = (
        "import os, sys, pathlib, time; from tests.benchmarks.measuring import Running\n"
        "with Running([sys.executable, '-c', 'import time; time.sleep(600)'], os.environ) as r:\n"
        f"    pathlib.Path({str(file)!r}).write_text(str(r.process.pid))\n"
        "    time.sleep(600)"
    )
    parent = subprocess.Popen([sys.executable, "-c", script], cwd=CHECKOUT)
    try:
        pid = int(wait_for(lambda: file.exists() and file.read_text(), "the child"))
    finally:
        parent.kill()
        parent.wait()
    wait_for(lambda: not _lives(pid), "the child to end")


def test_cpu_time_is_the_kernels():
    """Of a process that works, it agrees with the process's own clock; and it has memory."""
    code = "import time\nwhile time.process_time() < 0.5: pass\nprint('done', flush=True)\ninput()"
    with Running([sys.executable, "-c", code], os.environ, pipes=True) as worker:
        assert worker.process.stdout.readline() == "done\n"
        clock = time.clock_gettime_ns((~worker.process.pid << 3) | 2)
        assert cpu_ns(worker.process.pid) == pytest.approx(clock, rel=0.05)
        assert 1e6 < rss_bytes(worker.process.pid) < 1e9


def test_variants_run_in_turn():
    """Each as often as the others, and none always after the same one."""
    order = []
    results = in_turn({name: lambda name=name: order.append(name) or name for name in "abc"}, 2)
    assert order == list("abccba")
    assert results == {name: [name, name] for name in "abc"}


def test_report_as_text():
    """It shows every number, what is missing, and which goals were met."""
    printed = plain(REPORT)
    assert "1.23" in printed and "A note." in printed
    assert "cost: 1.50 (MISSED) (goal: at most 1.25)" in printed
    assert "speed: 12.0 Hz (goal: at least 10 Hz)" in printed
    assert "goal" not in plain(REPORT, verdict=False)
    assert not at_most("x", float("nan"), 1.0).met and not at_least("x", float("nan"), 1.0).met


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        (0.0, "0"),
        (1234.5, "1234"),
        (0.001234, "0.00123"),
        (1e-12, "1.00e-12"),
        (None, "-"),
        (7, "7"),
    ],
)
def test_numbers_to_three_digits(value, shown):
    """Small and large ones stay readable."""
    assert text(value) == shown


def test_tables_in_a_readme(tmp_path):
    """Whatever stood between the marks is replaced, as often as one likes."""
    readme = tmp_path / "README.md"
    readme.write_text(f"before\n{report.BEGIN}\nold\n{report.END}\nafter\n")
    for _ in range(2):
        report.write_section(readme, report.markdown("a machine", [REPORT]))
        section = readme.read_text()
        assert section.startswith("before\n") and section.endswith(f"{report.END}\nafter\n")
        assert "old" not in section and "| some | speed | 12.0 Hz | at least 10 Hz |" in section


def test_mistakes_are_explained(tmp_path):
    """Before anything is run, and where the tables cannot be written."""
    readme = tmp_path / "README.md"
    readme.write_text("no marks\n")
    with pytest.raises(OneBotError, match='did you mean "displays"'):
        main(["display"])
    with pytest.raises(OneBotError, match="mean nothing"):
        main(["displays", "--quick", "--write", str(readme)])
    with pytest.raises(OneBotError, match="has no lines <!-- benchmarks -->"):
        report.write_section(readme, "")
