"""``onebot evaluate``: a study from its file, with reports, recordings, Ctrl-C and resumption."""

import re
import socket
import sys
from contextlib import closing
from pathlib import Path
from xml.etree import ElementTree

import pytest
from pyarrow import csv, parquet

from tests.onebot_bringup.cli_support import onebot, running
from tests.support import wait_for

STUDY = """
from pathlib import Path
from onebot_control import Simulation
from onebot_control.evaluation import grid

def episode(case):
    Path(f"began-{case['seed']}-{case['y']}").touch()
    while case["seed"] > 1 and not Path("go").exists():
        pass
    with Simulation(world="maze", y=case["y"], seed=case["seed"]) as simulation:
        simulation.robot.drive(0.5)
        simulation.run(0.5)
        if case["seed"] == 1:
            raise RuntimeError("by hand")
        return {"reached": case["y"] > 0.5, "x": simulation.robot.pose.x, "of": [case["seed"]]}

cases = grid(y=[0.0, 0.8], seed=range(SEEDS))
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The present folder, with a study of four cases: a success, a failure and two errors."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "study.py").write_text(STUDY.replace("SEEDS", "2"))
    return tmp_path


def test_a_study_is_written_reported_and_shown(folder: Path) -> None:
    outs = ("results.parquet", "results.csv", "results.xml")
    words = [word for out in outs for word in ("--out", out)]
    done = onebot("evaluate", "study.py", "--workers", "2", *words, "--min", "reached=0.25")
    assert done.returncode == 0, done.stderr
    assert "reached: 1 of 4, 25.0 %" in done.stdout and "  y 0.8  1 of 2, 50.0 %" in done.stdout
    assert "2 with an error" in done.stdout and "case 1: RuntimeError: by hand" in done.stdout
    assert "4 of 4, 3 failed" in done.stderr
    table = parquet.read_table("results.parquet")
    assert table["reached"].to_pylist() == [False, None, True, None]
    assert csv.read_csv("results.csv")["of"].to_pylist() == ["[0]", "", "[0]", ""]
    suite = ElementTree.parse("results.xml").getroot()
    assert [suite.get(name) for name in ("tests", "failures", "errors")] == ["4", "1", "2"]
    assert [child.tag for case in suite for child in case] == ["failure", "error", "error"]
    assert suite[3].get("name") == "3: y=0.8, seed=1"
    assert sorted(path.name for path in folder.glob("results_recordings/*")) == [
        *("0.rrd", "1.rrd", "3.rrd"),
    ]
    assert all(path.stat().st_size > 10_000 for path in folder.glob("results_recordings/*"))
    assert not [*folder.glob("*.journal")]
    words = ["--workers", "1", "--keep", "none", "--min", "reached=0.3"]
    done = onebot("evaluate", "study.py", *words)
    assert done.returncode == 1 and "reached: 0.25 is below 0.3" in done.stderr
    assert not (folder / "study_recordings").exists()


def test_one_case_again(folder: Path) -> None:
    done = onebot("evaluate", "study.py", "--case", "2")
    assert done.returncode == 0 and "seed: 0\nreached: True\nx: " in done.stdout
    done = onebot("evaluate", "study.py", "--case", "4")
    assert done.returncode == 1 and "no case 4; the last one is 3" in done.stderr


@pytest.mark.slow
def test_one_case_is_shown(folder: Path) -> None:
    """Also if it fails, and has closed its simulation."""
    with running(folder, "evaluate", "study.py", "--case", "1", "--show") as shown:
        shown.says("showing ")
        assert "error: RuntimeError: by hand" in shown.out
        assert shown.interrupt() == 0


@pytest.mark.slow
def test_ctrl_c_leaves_what_was_done(folder: Path) -> None:
    """A study says how to go on, and does."""
    (folder / "study.py").write_text(STUDY.replace("SEEDS", "3"))
    words = ("evaluate", "study.py", "--workers", "1", "--out", "r.parquet", "--keep", "all")
    with running(folder, *words) as study:
        wait_for((folder / "began-2-0.0").exists, "the third case")
        assert study.interrupt() == 130
    command = re.findall(r"continue with: onebot (.*)", study.err)
    assert command == [" ".join((*words, "--resume"))] and "Traceback" not in study.output
    for file in folder.glob("began-*"):
        file.unlink()
    (folder / "go").touch()
    done = onebot(*command[0].split())
    assert done.returncode == 0, done.stderr
    assert sorted(path.name for path in folder.glob("began-*")) == [
        *("began-0-0.8", "began-1-0.8", "began-2-0.0", "began-2-0.8")
    ]
    assert parquet.read_table("r.parquet")["error"].null_count == 4
    assert len([*folder.glob("r_recordings/*.rrd")]) == 6


@pytest.mark.parametrize(
    ("words", "code", "text"),
    [
        (["nowhere.py"], 1, "error: nowhere.py cannot be imported: FileNotFoundError: "),
        (["study.py:episod"], 1, 'study.py has no "episod" (did you mean "episode"?'),
        (["syntax.py"], 1, "(syntax.py, line 2)"),
        (["raises.py"], 1, "error: raises.py:2 cannot be imported: ModuleNotFoundError: No module"),
        (["exits.py"], 1, "error: exits.py:2 cannot be imported: SystemExit: 3"),
        (["numbers.py"], 1, "error: numbers.py has no usable cases: case 0: 1 is not a mapping"),
        (["numbers.py:one", "--case", "0"], 1, "numbers.py has no usable cases: case 0: 1 is"),
        (["reads.py"], 1, "reads.py:2 has no usable cases: FileNotFoundError: "),
        (["study.py", "--out", "none/r.csv"], 1, "error: none/r.csv cannot be written: No such"),
        (["study.py", "--out", "r.xlsx"], 2, "the name must end in .parquet, .csv, .xml"),
        (["study.py", "--resume"], 1, "error: study.journal is not the journal of a study: "),
        (["study.py", "--workers", "0"], 2, "argument --workers: 0 is not above zero"),
        (["study.py", "--show"], 2, "--show is for a single case"),
        (["study.py", "--case", "0", "--show"], 1, "the episode has created no Simulation"),
        (["study.py", "--min", "x=1e", "--on", "moon"], 2, 'argument --min: "x=1e" is not NAME='),
        (["study.py", "--keep", "none", "--min", "spped=1"], 1, 'no "spped" (did you mean'),
    ],
)
def test_bad_input_is_one_error(folder: Path, words: list[str], code: int, text: str) -> None:
    (folder / "syntax.py").write_text("a = 1\nb = = 2\n")
    (folder / "raises.py").write_text("a = 1\nimport no_such_module\n")
    (folder / "exits.py").write_text("import sys\nsys.exit(3)\n")
    (folder / "numbers.py").write_text("def episode(case): ...\n\n\none, cases = episode, [1]\n")
    (folder / "reads.py").write_text(
        "def episode(case): ...\ncases = ({'n': open(name)} for name in 'ab')\n"
    )
    if "spped" in str(words) or "--show" in words:
        (folder / "study.py").write_text("def episode(case): return {'speed': 1}\ncases = [{}]\n")
    done = onebot("evaluate", *words)
    assert done.returncode == code and text in done.stderr, done.stderr
    errors = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
    assert len(errors) == 1 and "Traceback" not in done.stderr


def test_ray_that_is_missing(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    monkeypatch.delitem(sys.modules, "onebot_control.evaluation.on_ray", raising=False)
    done = onebot("evaluate", "study.py", "--on", "ray")
    assert done.returncode == 1
    assert done.stderr.splitlines() == [
        "running 4 episodes on ray ...",
        "error: Ray is not installed: pip install 'onebot-robots[cluster]'",
    ]


@pytest.mark.slow
def test_a_cluster_that_does_not_answer(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without RAY_ADDRESS it is that of ``ray start``, which has been killed since."""
    with closing(socket.create_server(("127.0.0.1", 0))) as server:
        address = f"127.0.0.1:{server.getsockname()[1]}"
    (folder / "ray").mkdir()
    (folder / "ray/ray_current_cluster").write_text(address)
    monkeypatch.setenv("RAY_TMPDIR", str(folder))
    monkeypatch.setenv("RAY_ADDRESS", "")
    done = onebot("evaluate", "study.py", "--on", "ray")
    assert done.returncode == 1
    [_, error] = done.stderr.splitlines()
    assert error.startswith(f"error: Ray's cluster {address} does not respond: ")
