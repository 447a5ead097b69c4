"""Whatever a xacro file asks for, expanding it ends, in one line that names the place."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from onebot_description.description import (
    DescriptionError,
    bounded_process,
    load_description,
    xacro,
)
from onebot_description.description.bounded_process import BoundExceeded, Bounds, Place, run_bounded

SMALL = Bounds(memory=150_000_000, processor=300)
SHORT = Bounds(memory=4_000_000_000, processor=1)
HEAD = '<robot name="a" xmlns:xacro="http://www.ros.org/wiki/xacro">'


def problem_of(folder: Path, inside: str) -> str:
    """The one problem of a xacro file that holds ``inside``, without its folder."""
    if not (folder / "pipe").exists():
        os.mkfifo(folder / "pipe")
    (folder / "zero.xacro").unlink(missing_ok=True)
    (folder / "zero.xacro").symlink_to("/dev/zero")
    file = folder / "robot.xacro"
    file.write_text(f"{HEAD}\n{inside}</robot>")
    with pytest.raises(DescriptionError) as error:
        load_description(file).raise_problems()
    (problem,) = error.value.problems
    return problem.replace(f"{folder}/", "")


STOPPED = "expansion was stopped here: it takes more than "
MEMORY, PROCESSOR = f"{STOPPED}0.15 GB of memory", f"{STOPPED}1 s of processor time"
HOSTILE = {
    "ljust": ("<link name=\"${''.ljust(10**10)}\"/>", MEMORY),
    "power": (
        '<xacro:macro name="m"><link name="${10**10**10}"/></xacro:macro>\n<xacro:m/>',
        PROCESSOR,
    ),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_what_would_not_end_is_stopped(tmp_path: Path, monkeypatch, name: str) -> None:
    inside, ending = HOSTILE[name]
    # One of the two is never met first, however slow the machine is.
    monkeypatch.setattr(xacro, "_BOUNDS", SMALL if ending == MEMORY else SHORT)
    problem = problem_of(tmp_path, inside)
    place, _, text = problem.partition(": ")
    assert text == ending
    assert place == "robot.xacro:2"
    (tmp_path / "robot.xacro").write_text(f'{HEAD}<link name="${{1 + 1}}"/></robot>')
    assert load_description(tmp_path / "robot.xacro").link_names == ("2",)


@pytest.mark.parametrize(
    ("inside", "problem"),
    [
        ('<xacro:include filename="pipe"/>', "pipe: is a device or pipe, not a file"),
        ('<xacro:include filename="zero.xacro"/>', "zero.xacro: is a device or pipe, not a file"),
        ("${xacro.load_yaml('pipe')}", "robot.xacro:1: pipe: is a device or pipe, not a file"),
        (
            '<link name="l"><visual><geometry><mesh filename="/dev/zero"/></geometry></visual>'
            "</link>",
            "<mesh>: /dev/zero: is not a file",
        ),
    ],
)
def test_what_is_no_file_is_not_read(tmp_path: Path, inside: str, problem: str) -> None:
    assert problem_of(tmp_path, inside).endswith(problem)


def test_no_process_can_be_started(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bounded_process, "_spawn", unstartable)
    monkeypatch.setattr(bounded_process, "_fork", unstartable)
    problem = problem_of(tmp_path, "<link name='a'/>")
    assert problem == "robot.xacro: cannot be expanded: [Errno 11] no more processes"


def unstartable(*_: object) -> None:
    raise BlockingIOError(11, "no more processes")


def work(request: str, place: Place) -> object:
    """What the tests below run in a process of its own."""
    place.note(f"{request}:1")
    while request == "work for ever":
        pass
    if request == "be killed":
        assert Path("/proc/self/oom_score_adj").read_text() == "1000\n"
        os.kill(os.getpid(), 9)
    if request == "answer too much":
        return "a" * 100_000_000
    if request == "die":
        os._exit(3)
    if request == "fail":
        raise ValueError(request)
    threads = len(os.listdir("/proc/self/task"))
    return [request, os.getpid(), threads, "a" * 10**6, sys.prefix]


@pytest.mark.parametrize("threads", [False, True])
def test_a_function_in_a_process_of_its_own(threads: bool, tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(f"""
import sys, threading
sys.path[:] = {sys.path!r}
from tests.onebot_description import test_bounded_process as test
if {threads}:
    threading.Thread(target=threading.Event().wait, daemon=True).start()
test.check_processes(forked={not threads})
print("done")
""")
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, cwd=tmp_path)
    assert done.stdout == "done\n", done.stderr
    assert done.stderr.count("ValueError: fail") == 1


@pytest.mark.skipif(sys.platform == "win32", reason="a pipe that is closed is another error")
def test_an_interpreter_ends_quietly_when_what_waits_for_it_was_killed() -> None:
    command = [sys.executable, "-ISc", bounded_process._START, "\n".join(sys.path), sys.prefix]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe, text=True) as process:
        process.stdout.close()
        request = json.dumps([f"{__name__}:work", "answer", Bounds()])
        assert process.communicate(request)[1] == ""
    assert process.returncode == 0


def check_processes(*, forked: bool) -> None:
    """Checked in a process whose threads are known."""
    import importlib

    module = "tests.onebot_description.test_bounded_process"
    importlib.import_module(module).__dict__["parent"] = os.getpid()
    function = f"{module}:work"
    files = os.listdir("/proc/self/fd")
    request, child, threads, text, prefix = run_bounded(function, "answer", Bounds())
    assert prefix == sys.prefix
    assert (request, threads, len(text)) == ("answer", 1, 10**6) and child != os.getpid()
    inherited = run_bounded(f"{module}:is_fork", os.getpid(), Bounds())
    assert inherited is forked
    with pytest.raises(BoundExceeded, match="^1 s of processor time$") as met:
        run_bounded(function, "work for ever", Bounds(processor=1))
    assert met.value.place == "work for ever:1"
    if forked:  # a started interpreter forks, too
        with pytest.raises(BoundExceeded, match="^the memory of this computer$"):
            run_bounded(function, "be killed", Bounds())
        with pytest.raises(BoundExceeded, match="^0.15 GB of memory$"):
            run_bounded(function, "answer too much", Bounds(memory=150_000_000))
    for request in ("die", "fail") if forked else ("fail",):
        with pytest.raises(RuntimeError, match=f"{request}:1 ended with [31]"):
            run_bounded(function, request, Bounds())
    assert os.listdir("/proc/self/fd") == files
    with pytest.raises(ChildProcessError):
        os.waitpid(-1, os.WNOHANG)


def is_fork(request: int, place: Place) -> bool:
    """Whether this process has the memory of the process ``request``."""
    return globals().get("parent") == request
