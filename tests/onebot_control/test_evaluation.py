"""A study: many episodes of an ordinary function, and the table of what they return."""

import functools
import math
import os
import re
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from uuid import UUID

import numpy as np
import psutil
import pyarrow as pa
import pytest
from pyarrow import csv

from onebot_control import Simulation
from onebot_control.evaluation import Case, evaluate, grid, summary
from onebot_control.evaluation.report import share, write_table
from onebot_control.evaluation.rows import fact_of
from onebot_description.errors import OneBotError
from tests.support import PATIENCE, RunningProcess, run_to_end, wait_for

DIED = "its worker died twice: killed, out of memory, or a crash in compiled code"
LONG = "it took longer than 2 s, and was ended"
ENDS: dict[str, tuple[Callable[[Case], object], str | None]] = {
    "raises": (lambda case: {}["it went\nwrong"], "KeyError: 'it went\\nwrong'"),
    "raises a riddle": (lambda case: int(Riddle()), "ValueError"),
    "exits": (lambda case: sys.exit("gone"), "SystemExit: gone"),
    "is interrupted": (lambda case: signal.default_int_handler(2, None), "KeyboardInterrupt"),
    "hangs": (lambda case: time.sleep(1e6), LONG),
    "stops": (lambda case: os.kill(os.getpid(), signal.SIGSTOP), LONG),
    "dies": (lambda case: os.kill(os.getpid(), signal.SIGKILL), DIED),
    "leaves": (lambda case: os._exit(0), DIED),
    "dies once": (lambda case: _exists(case) or os._exit(3), None),
}
"""What episodes may do, and their errors."""


class Riddle(BaseException):
    """An error whose text cannot be made."""

    def __int__(self) -> int:
        raise self

    def __str__(self) -> str:
        raise ValueError


def _exists(case: Case) -> bool:
    exists = Path(case["file"]).exists()
    Path(case["file"]).touch()
    return exists


def simple(case: Case) -> dict[str, Any]:
    """An episode without a simulation; it ends as the case says."""
    if kind := case.get("kind"):
        ENDS[kind][0](case)
    return {"reached": case["seed"] % 3 > 0, "half": case["seed"] / 2, "ranges": [1.0, math.inf]}


def drive(case: Case) -> dict[str, Any]:
    """A drive in the maze; its simulation is kept for the next episode."""
    global kept
    kept = kept or Simulation(sensors=True)
    kept.reset(case["seed"], world=case["world"], y=case["y"])
    kept.robot.drive(0.5)
    kept.run(1.0)
    return {"reached": kept.robot.pose.x > 0.1, "ahead": kept.robot.scan().ahead}


kept: Simulation | None = None


def test_nothing_that_goes_wrong_ends_a_study(tmp_path: Path) -> None:
    """A row for each case, in order; what killed a worker once is a row like any other."""
    cases = [{"seed": 1, "kind": kind, "file": tmp_path / "died"} for kind in ("", *ENDS, "")]
    table = evaluate(simple, cases, workers=2, timeout=2.0)
    errors = [None, *(error for _, error in ENDS.values()), None]
    assert table["error"].to_pylist() == errors
    assert table["reached"].to_pylist() == [None if error else True for error in errors]
    assert table.column_names == ["seed", "kind", "file", "reached", "half", "ranges", "error"]
    assert table["ranges"].type == pa.list_(pa.float64())
    assert fact_of(table, "factors") == ["kind"] and fact_of(table, "numpy") == np.__version__
    assert fact_of(table, "processor")
    assert table["file"].to_pylist() == [str(tmp_path / "died")] * len(errors)
    text = summary(table)
    assert "11 episodes, 8 with an error" in text and "reached: 3 of 11, 27.3 %" in text
    assert "cases without success: 1, 2, 3, 4, 5, 6, 7, 8" in text
    assert "case 1: KeyError: 'it went" in text


class Late:
    """An episode that takes longer to import than it may run."""

    def __call__(self, case: Case) -> None: ...

    def __reduce__(self) -> tuple[Callable[[], "Late"], tuple[()]]:
        return _late, ()


def _late() -> Late:
    time.sleep(2.5)
    return Late()


@pytest.mark.slow
def test_imports_do_not_count_as_an_episodes_time() -> None:
    table = evaluate(Late(), [{"seed": 1}], workers=1, timeout=2.0)
    assert table["error"].to_pylist() == [None]


@pytest.mark.slow
def test_killed_workers_lose_no_run(tmp_path: Path) -> None:
    """Whatever they are doing: starting, waiting, running an episode, or sending its row."""
    script = tmp_path / "study.py"
    script.write_text(
        "import time\n"
        "from pathlib import Path\n"
        "from onebot_control.evaluation import evaluate, grid\n"
        "def episode(case):\n"
        "    time.sleep(0.02)\n"
        "    Path(f'ran-{case[\"seed\"]}').touch()\n"
        "    return {'twice': 2 * case['seed']}\n"
        "table = evaluate(episode, grid(seed=range(500)), 3)\n"
        "assert table['twice'].to_pylist() == [*range(0, 1000, 2)], table['error'].to_pylist()\n"
    )

    def done() -> int:
        return len([*tmp_path.glob("ran-*")])

    def is_worker(process: psutil.Process) -> bool:
        try:
            return "spawn_main" in str(process.cmdline())
        except psutil.NoSuchProcess:  # also of the killed, until its parent has noticed
            return False

    killed = 0
    with RunningProcess([sys.executable, str(script)], tmp_path) as study:
        parent = psutil.Process(study.process.pid)
        while study.process.poll() is None and killed < 12:
            workers = [child for child in parent.children() if is_worker(child)]
            if workers:
                workers[killed % len(workers)].kill()
                killed += 1
                # Until then a case that was interrupted has run again: it comes first.
                until = min(done() + 12, 500)
                wait_for(lambda until=until: done() >= until, "further episodes")
        assert study.wait(2 * PATIENCE) == 0, study.output
    assert killed == 12


def test_the_table_is_the_same_however_many_workers_there_are() -> None:
    """Bit by bit, also in one process, where the simulation was another's before."""
    cases = grid(world=["maze", ""], y=[0.0, 0.8], seed=range(2))
    one = evaluate(drive, cases, workers=1)
    assert one["error"].null_count == 8 and len(set(one["ahead"].to_pylist())) > 4
    assert evaluate(drive, cases, workers=3).equals(one, check_metadata=True)
    backwards = evaluate(drive, [*reversed(cases)], workers=0)  # here: last, as it sets ``kept``
    assert backwards.take([*range(7, -1, -1)]) == one


def test_types_do_not_depend_on_which_row_came_first() -> None:
    rows = [
        {"a": 1},
        {"a": 0.5, "b": None},
        {"c": "x", "d": 1},
        {"d": "y", "f": object()},
        {"g": np.eye(2), "seed": 4},
        {"e": np.int64(4), "f": 2**70},
    ]
    table = evaluate(lambda case: rows[case["seed"]], grid(seed=range(6)), workers=0)
    types = dict(zip(table.column_names, map(str, table.schema.types), strict=True))
    assert types == {
        **{"seed": "int64", "a": "double", "b": "null", "c": "string", "d": "string"},
        **{"f": "string", "g": "list<item: list<item: double>>", "e": "int64", "error": "string"},
    }
    assert table["d"].to_pylist() == [None, None, "1", "y", None, None]
    assert table["f"].to_pylist()[3::2] == ["<object object>", str(2**70)]


@pytest.mark.parametrize(
    ("returned", "words"),
    [
        (3, "the returned value: 3 is not a mapping; write a mapping"),
        ({"seed": 8}, 'returned "seed", which is a column of the case'),
        ({"error": "x"}, "'error' cannot be the name of a column"),
    ],
)
def test_what_cannot_be_a_row_is_an_error(returned: Any, words: str) -> None:
    table = evaluate(lambda case: returned, [{"seed": 7}], workers=0)
    assert words in table["error"][0].as_py()


def test_values_of_a_case_may_be_anything(tmp_path: Path) -> None:
    """What is not a number or a text is shown as text, without addresses."""
    cases = [{"by": simple, "of": [1, 2]}, {"by": print, "of": lambda: 0}]
    table = evaluate(lambda case: {"name": case["by"].__name__}, cases, workers=1)
    assert table["by"].to_pylist() == ["simple", "print"]
    assert table["of"].to_pylist()[0] == "[1, 2]" and "0x" not in table["of"].to_pylist()[1]
    write_table(table, tmp_path / "table.csv")
    with pytest.raises(OneBotError, match="case 1 cannot be sent to workers: TypeError: "):
        evaluate(simple, [{"seed": 1}, {"seed": threading.Lock()}], workers=1)
    partly = functools.partial(lambda case, kind: {"kind": kind}, kind="made")
    assert evaluate(partly, [{"seed": 1}], workers=1)["kind"].to_pylist() == ["made"]


def test_every_value_is_written_to_every_file(tmp_path: Path) -> None:
    """Those that Parquet, CSV or UTF-8 do not have are text."""
    values = {
        "empty": {},
        "in a list": [{}],
        "bytes": b"\xff",
        "uuid": UUID(int=7),
        "name": "\ud800",
    }
    table = evaluate(lambda case: values, [{"file": "\udcff"}], workers=0)
    assert table.to_pylist()[0]["error"] is None and table["file"][0].as_py() == r"\udcff"
    for suffix in (".parquet", ".csv", ".xml"):
        write_table(table, tmp_path / f"table{suffix}")
    [row] = csv.read_csv(tmp_path / "table.csv").to_pylist()
    assert row["empty"] == "{}" and row["bytes"] == r"b'\xff'" and row["uuid"].endswith("0007")
    assert row["name"] == r"\ud800" and row["in a list"] == "[{}]"


def test_grids() -> None:
    assert grid(a=[1, 2], b="xy", c=np.array([0.5])) == [
        {"a": 1, "b": "xy", "c": 0.5},
        {"a": 2, "b": "xy", "c": 0.5},
    ]
    assert [*grid(a=(n for n in range(3)), b=7)] == [{"a": n, "b": 7} for n in range(3)]


def _endless() -> Iterator[dict[str, int]]:
    while True:
        yield {"seed": 1}


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: grid(a=range(10**9)), "a study has 1 to 1,000,000 cases"),
        (lambda: grid(a=range(2000), b=range(2000)), "these are more"),
        (lambda: evaluate(simple, _endless()), "these are more"),
        (lambda: evaluate(simple, []), "such as grid(seed=range(9)); these are none"),
        (lambda: evaluate(simple, [{"seed": 1}, 7]), "case 1: 7 is not a mapping; write a mapping"),
        (lambda: evaluate(simple, {"seed": 1}), "case 0: 'seed' is not a mapping"),
        (lambda: evaluate(simple, 7), "cases: 7 is a number; write a list"),
        (lambda: evaluate(simple, [{1: 2}]), "case 0: 1 cannot be the name of a column"),
        (lambda: evaluate(simple, [{"error": 2}]), "'error' cannot be the name of a column"),
        (lambda: evaluate(7, [{"seed": 1}]), "function: 7 is a number; write a function"),
        (lambda: evaluate(simple, [{"seed": 1}], workers=-1), "workers: -1 is below 0"),
        (lambda: evaluate(simple, [{"seed": 1}], on="slurm"), 'on: no "slurm"'),
        (lambda: evaluate(simple, [{"seed": 1}], resume=True), "write journal=FILE"),
        (lambda: evaluate(_unpicklable(), [{"seed": 1}]), "cannot be sent to workers: TypeError"),
        (lambda: evaluate(_simulating(), [{"seed": 1}]), "workers: a simulation can neither be"),
    ],
)
def test_bad_input_is_one_sentence(call: Callable[[], object], words: str) -> None:
    with pytest.raises(OneBotError, match=re.escape(words)) as caught:
        call()
    assert len(str(caught.value).splitlines()) == 1


def _unpicklable() -> Callable[[Case], dict[str, Any]]:
    lock = threading.Lock()
    return lambda case: {"locked": lock.locked()}


def _simulating() -> Callable[[Case], dict[str, Any]]:
    with Simulation() as simulation:
        return lambda case: {"seconds": simulation.time}


def test_a_script_runs_once_and_needs_no_guard(tmp_path: Path) -> None:
    """Its functions, and those of modules beside it, reach the workers by value."""
    (tmp_path / "helper.py").write_text("def double(x):\n    return 2 * x\n")
    (tmp_path / "script.py").write_text(
        "from helper import double\n"
        "from onebot_control.evaluation import evaluate, grid\n"
        "print('begins')\n"
        "def episode(case):\n"
        "    import os, sys\n"
        "    threads = os.environ['OPENBLAS_NUM_THREADS'], os.environ['ROS_DOMAIN_ID'].isdigit()\n"
        "    return {'twice': double(case['x']), 'threads': str(threads)}\n"
        "table = evaluate(episode, grid(x=range(3)), 2)\n"
        "print(table['twice'].to_pylist(), *{*table['threads'].to_pylist()})\n"
    )
    variables = {name: value for name, value in os.environ.items() if "THREADS" not in name}
    done = run_to_end([sys.executable, "script.py"], cwd=tmp_path, env=variables)
    assert done.stdout.splitlines() == ["begins", "[0, 2, 4] ('1', True)"], done.stderr
    assert done.stderr == ""


def test_a_study_goes_on_from_its_journal(tmp_path: Path) -> None:
    """After a kill -9 of the whole study; of another study, or of other code, it is refused."""
    script, journal = tmp_path / "script.py", tmp_path / "journal"
    script.write_text(
        "import sys, time\n"
        "from pathlib import Path\n"
        "from onebot_control.evaluation import evaluate, grid\n"
        "def episode(case):\n"
        "    Path(f'ran-{case[\"x\"]}').touch(exist_ok=False)\n"
        "    while case['x'] == 3 and not Path('go').exists(): time.sleep(0.05)\n"
        "    return {'twice': 2 * case['x']}\n"
        "resume = 'resume' in sys.argv\n"
        "table = evaluate(episode, grid(x=range(6)), 1, journal='journal', resume=resume)\n"
        "print(table['twice'].to_pylist(), table['error'].to_pylist()[3:4])\n"
    )
    with RunningProcess([sys.executable, str(script)], tmp_path, check=False) as study:
        wait_for((tmp_path / "ran-3").exists, "the fourth case")
        workers = psutil.Process(study.process.pid).children(recursive=True)
        study.process.kill()
        _, alive = psutil.wait_procs(workers, timeout=PATIENCE)
        assert not alive
    with journal.open("ab") as file:
        file.write(b"\xff\xff\xff\xff\x10")  # the beginning of a row
    (tmp_path / "ran-3").unlink()
    (tmp_path / "go").touch()
    command = [sys.executable, str(script), "resume"]
    done = run_to_end(command, cwd=tmp_path)
    assert done.stdout == "[0, 2, 4, 6, 8, 10] [None]\n", done.stderr
    script.write_text(script.read_text().replace("2 *", "3 *"))
    done = run_to_end(command, cwd=tmp_path)
    assert "OneBotError: journal belongs to another study" in done.stderr
    for text in (b"", b"no journal"):
        journal.write_bytes(text)
        with pytest.raises(OneBotError, match="is not the journal of a study"):
            evaluate(simple, [{"seed": 1}], journal=journal, resume=True)
    with pytest.raises(OneBotError, match="cannot be written: Is a directory"):
        evaluate(simple, [{"seed": 1}], journal=tmp_path)


def test_a_recording_that_fails_leaves_the_row() -> None:
    def fail(*_: object) -> None:
        raise OSError("No space left on device")

    def episode(case: Case) -> dict[str, bool]:
        with Simulation() as simulation:
            return {"reached": simulation.time > 1.0}

    [row] = evaluate(episode, grid(seed=[3]), workers=0, recorder=fail).to_pylist()
    error = "its recording failed: OSError: No space left on device"
    assert row == {"seed": 3, "reached": False, "error": error}


def test_intervals_and_shares() -> None:
    """Wilson's, as published for 8 of 10; an episode without a value is not left out."""
    eight = evaluate(lambda case: {"reached": case["seed"] < 8}, grid(seed=range(10)), workers=0)
    assert "reached: 8 of 10, 80.0 % (49.0 to 94.3 %)" in summary(eight)
    rows = [{"ok": True, "n": 1.0}, {"ok": True, "n": 3.0}, {"ok": False, "n": 2.0}]
    table = evaluate(lambda case: rows[case["seed"]], grid(seed=range(3)), workers=0)
    assert share(table, "ok") == pytest.approx(2 / 3) and share(table, "n") == 2.0
    with_error = evaluate(lambda case: rows[case["seed"]], grid(seed=range(4)), workers=0)
    assert share(with_error, "ok") == 0.5 and math.isnan(share(with_error, "n"))
    with pytest.raises(OneBotError, match='return no "okay"'):
        share(table, "okay")


@pytest.mark.slow
def test_nodes_of_an_episode_have_the_domain_of_their_worker() -> None:
    """In lockstep; two at once do not meet, and an episode follows another in a worker."""
    table = evaluate(with_a_node, grid(speed=[0.1, 0.2, 0.3, 0.4]), workers=2)
    assert table["error"].null_count == 4, table["error"].to_pylist()
    assert table["x"].to_pylist() == pytest.approx([0.2, 0.4, 0.6, 0.8], abs=0.2)
    assert len(set(table["domain"].to_pylist())) == 2
    again = evaluate(with_a_node, grid(speed=[0.1, 0.2, 0.3, 0.4]), workers=1)
    assert again["x"].to_pylist() == table["x"].to_pylist()


def with_a_node(case: Case) -> dict[str, Any]:
    """A ROS node drives; it waits until the other worker has begun, too."""
    from geometry_msgs.msg import Twist
    from nav_msgs.msg import Odometry
    from rclpy.node import Node

    class Driver(Node):
        def __init__(self) -> None:
            super().__init__("driver")
            self.commands = self.create_publisher(Twist, "velocity_controller/cmd_vel", 10)
            self.create_subscription(Odometry, "velocity_controller/odom", self.drive, 10)

        def drive(self, _: Odometry) -> None:
            command = Twist()
            command.linear.x = case["speed"]
            self.commands.publish(command)

    with Simulation() as simulation, simulation.ros() as ros:
        ros.add(Driver())
        simulation.run(2.0)
        return {"x": simulation.robot.pose.x, "domain": os.environ["ROS_DOMAIN_ID"]}
