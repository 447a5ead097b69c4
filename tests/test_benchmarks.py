"""The benchmarks check what they measure, and refuse to report when it is wrong."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from onebot_bringup.cli import bench
from onebot_bringup.launch.arguments import UsageError
from onebot_description.errors import OneBotError
from tests.benchmarks import (
    command,
    discovery,
    displays,
    hosts,
    machine,
    model,
    saving,
    state_publisher,
)
from tests.benchmarks.chains import Chain
from tests.benchmarks.measuring import (
    CHECKOUT,
    Running,
    WrongAnswer,
    cpu_ns,
    in_turn,
    process_tree,
    rss_bytes,
)
from tests.benchmarks.model_libraries import LINK_POSES, TRANSFORMS, OneBot
from tests.benchmarks.plot import svg
from tests.benchmarks.registry import BENCHMARKS, Options
from tests.benchmarks.report import Plot, Report, at_least, at_most, plain, text
from tests.support import PATIENCE, skip_for, wait_for

MAIN = "import sys; from tests.benchmarks.command import main; sys.exit(main(sys.argv[1:]))"
REPORT = Report(
    "some",
    [{"Node": "a | b", "us": 1.23456}, {"Node": "c", "MB": 12}],
    [at_most("cost", 1.5, 1.25), at_least("speed", 12.0, 10.0, "Hz")],
    ["A note."],
    [Plot("cost <by> size", "size", "us", {"one & two": [(10, 1.0), (1000, 40.0)]}, "It bends.")],
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
def test_quick_run(name, tmp_path, capsys):
    """Every answer is right; there are results, no verdict on times, and no process is left."""
    before = set(process_tree(os.getpid()))
    output = tmp_path / "results.json"
    assert command.main([name, "--quick", "--output", str(output)]) == 0
    printed = capsys.readouterr().out
    assert f"== {name}" in printed and "goal" not in printed
    results = saving.load(output)
    assert results.quick and results.machine["cores"]
    assert [report.name for report in results.reports] == [name]
    assert results.reports[0].rows
    assert set(process_tree(os.getpid())) <= before


@pytest.mark.slow
@pytest.mark.parametrize(("complaint", "lie"), LIES.items())
def test_node_with_wrong_answers_is_refused(complaint, lie, tmp_path):
    """The error says which node it was, and what was wrong."""
    script = tmp_path / "liar.py"
    script.write_text(LIAR.replace("LIE", lie))
    peer = f"env PYTHONPATH={CHECKOUT} {sys.executable} {script} {{file}}"
    nodes = {state_publisher.PEER: peer}
    effort = state_publisher.Effort(1, 10, 1.0)
    with pytest.raises(WrongAnswer) as error:
        state_publisher.measure(10, nodes, effort, Options(quick=True))
    assert str(error.value).startswith("peer, 10 joints: ")
    assert complaint in str(error.value)


@pytest.mark.slow
def test_peer_that_dies_is_an_error():
    """What it said is in the message."""
    nodes = {state_publisher.PEER: f"{sys.executable} -c 'import sys; sys.exit(\"no robot\")'"}
    effort = state_publisher.Effort(1, 10, 1.0)
    with pytest.raises(OneBotError, match="(?s)peer ended with exit code 1.*no robot"):
        state_publisher.measure(10, nodes, effort, Options(quick=True))


@pytest.mark.slow
def test_peer_reads_a_parameter_file(tmp_path):
    """``{urdf}`` in the command of --peer is a file that any node takes its URDF from."""
    node = "onebot_description.robot_state_publisher"
    peer = f"{sys.executable} -m {node} --ros-args --params-file {{urdf}}"
    effort = state_publisher.Effort(1, 10, 1.0)
    results = state_publisher.measure(
        10, {state_publisher.PEER: peer}, effort, Options(quick=True), [state_publisher.CLOSED_LOOP]
    )
    [window] = results[state_publisher.CLOSED_LOOP][state_publisher.PEER].windows
    assert window.answers == 10 and window.lost == 0
    assert window.cpu_us > 0.0 and window.p50_us > 0.0


@pytest.mark.parametrize("task", [TRANSFORMS, LINK_POSES])
def test_library_with_wrong_answers_is_refused(task):
    """The error says which library it was."""

    class Liar(OneBot):
        name = "liar"

        def run(self, task, positions):
            return super().run(task, np.roll(positions, 1, axis=-1))

    chain = Chain(5)
    model._check(OneBot(chain), task, chain)
    with pytest.raises(WrongAnswer, match="liar"):
        model._check(Liar(chain), task, chain)


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
            [sys.executable, "-c", MAIN, "state_publisher", "--quick"], os.environ, name="bench"
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
    assert "1.23" in printed and "A note." in printed and "It bends." in printed
    assert "cost: 1.50 (goal: at most 1.25): MISSED" in printed
    assert "speed: 12.0 Hz (goal: at least 10 Hz): met" in printed
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


def test_results_as_json_and_in_the_readme(tmp_path, capsys):
    """What was saved can be shown, plotted and put into a README later, as often as one likes."""
    output, plot, readme = (tmp_path / name for name in ("a.json", "a.svg", "README.md"))
    saving.save(output, saving.Results(machine.describe(), False, [REPORT]))
    assert json.loads(output.read_text())["reports"][0]["goals"][0]["met"] is False
    readme.write_text(f"before\n{saving.BEGIN}\nold\n{saving.END}\nafter\n")
    for _ in range(2):
        arguments = ["--results", output, "--plot", plot, "--write", readme]
        # It picks by the names of benchmarks, and this one is none.
        results = saving.load(output)
        command._write_plot(plot, results)
        saving.write_section(readme, saving.markdown(results, "a.svg"))
        section = readme.read_text()
        assert section.startswith("before\n") and section.endswith(f"{saving.END}\nafter\n")
        assert "old" not in section and "![" in section and "a \\| b" in section
        assert command.main([str(word) for word in arguments]) == 0
    assert "cores" in capsys.readouterr().out


def test_plot_is_a_picture(tmp_path):
    """Well-formed SVG without a background, with every curve and name."""
    root = ElementTree.fromstring(svg([REPORT.growth[0]] * 3))
    names = [element.text for element in root.iter("{http://www.w3.org/2000/svg}text")]
    assert names.count("one & two") == 3 and names.count("cost <by> size") == 3
    assert len(list(root.iter("{http://www.w3.org/2000/svg}polyline"))) == 3
    assert svg([Plot("empty", "x", "y", {"none": [(0.0, 1.0)]})])


def test_mistakes_are_explained(tmp_path):
    """Before anything is run."""
    readme = tmp_path / "README.md"
    readme.write_text("no marks\n")
    for arguments, kind, message in (
        (["modle"], OneBotError, 'did you mean "model"'),
        (["model", "--plot", "x.png"], UsageError, "SVG"),
        (["model", "--quick", "--plot", "x.svg"], UsageError, "mean nothing"),
        (["model", "--write", str(readme)], OneBotError, "has no lines <!-- benchmarks -->"),
        (["model", "--output", str(tmp_path / "no" / "x.json")], OneBotError, "there is no folder"),
        (["model", "--peer", "x"], UsageError, "--peer is for state_publisher"),
        (["--results", str(readme)], OneBotError, "holds no results"),
        (["--fast"], UsageError, "--fast"),
    ):
        with pytest.raises(kind, match=message):
            command.main(arguments)


def test_command_lists_all(capsys):
    """`onebot bench --list` says in a line each what there is."""
    assert bench.run(["--list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == list(BENCHMARKS)


@pytest.mark.slow
def test_discovery_is_measured_between_hosts():
    """Both ways: two robots on hosts of their own are discovered, and their packets counted."""
    if problem := hosts.missing():
        skip_for(problem)
    rows = discovery.run([2], steady=1.0)
    assert [row["discovery"] for row in rows] == [discovery.SUBNET, discovery.SERVER]
    for row in rows:
        assert row["start: packets"] > 10 and row["start: MB"] > 0.001 and row["start: CPU s"] > 0
