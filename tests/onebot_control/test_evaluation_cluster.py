"""A study on a cluster of Ray: two hosts of this computer, the second with an installed wheel."""

import os
import platform
import signal
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory
from types import ModuleType

import pyarrow as pa
import pytest
from pyarrow import parquet

from onebot_control.evaluation import evaluate
from onebot_description.errors import OneBotError
from tests.environments import build, copy_of_checkout, fresh_environment, install
from tests.hosts import Host, connected_hosts, missing
from tests.support import PATIENCE, RunningProcess, run_to_end, skip_for, wait_for

pytestmark = pytest.mark.slow

ONEBOT = [sys.executable, "-m", "onebot_bringup.cli.main"]
RAY = "ray.scripts.scripts"
PORT = 6379
# A node gives its agents 15 s to start; on a busy computer they take longer.
_STARTED, _ATTEMPTS = "Ray runtime started", 6
# The helper is beside the study; both come to the nodes by value.
STUDY = """
import os, platform, time
from pathlib import Path
from onebot_control import Simulation
from onebot_control.evaluation import grid
import helper

def episode(case):
    Path(case["folder"], f"{platform.node()}-{os.getpid()}").touch()
    if case["y"] and case["seed"] == 3:
        os._exit(3)
    with Simulation(world="maze", seed=case["seed"], y=case["y"], sensors=True) as simulation:
        helper.drive(simulation.robot)
        simulation.run(1.5)
        scan = simulation.robot.scan()
        return {"reached": scan.ahead > 0.7, "x": simulation.robot.pose.x, "scan": scan.ranges}

cases = grid(folder=FOLDER, y=[0.0, 0.8], seed=range(4))
"""


HELPER = "def drive(robot):\n    robot.drive(0.4)\n"


@pytest.fixture(scope="module")
def second(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A Python whose packages are installed, with no way to the checkout."""
    folder = tmp_path_factory.mktemp("second")
    python = fresh_environment(folder)
    wheel = build(copy_of_checkout(folder), "wheel", folder / "wheel")
    install(python, str(wheel))
    return python


class Cluster(ExitStack):
    """Two hosts, each with a node of Ray that runs one episode at a time."""

    def __init__(self, folder: Path, second: Path) -> None:
        super().__init__()
        self.folder = folder
        # Paths of sockets have to be short.
        short = self.enter_context(TemporaryDirectory(prefix="ray-"))
        self._variables = {"RAY_TMPDIR": short, "RAY_AUTH_MODE": "token"}
        self.head, self.other = self.enter_context(connected_hosts("head", "other"))
        self._address = f"{self.head.address}:{PORT}"
        self._start(self.head, sys.executable, "--head", f"--port={PORT}")
        self.node = self._start(self.other, str(second), f"--address={self._address}")

    def _start(self, host: Host, python: str, *words: str) -> RunningProcess:
        options = ["--num-cpus=1", f"--node-ip-address={host.address}", "--block"]
        if "--head" in words:
            options.append("--include-dashboard=false")
        command = [python, "-um", RAY, "start", *words, *options, "--disable-usage-stats"]
        away = ["env", "-C", str(self.folder), "-u", "PYTHONPATH", "nice", "-n", "-15", *command]
        for _ in range(_ATTEMPTS):
            node = RunningProcess(host.command(away), environment=self._variables, check=False)
            self.enter_context(node)
            wait_for(
                lambda n=node: _STARTED in n.out or n.process.poll() is not None,
                "the node",
                4 * PATIENCE,
            )
            if _STARTED in node.out:
                return node
        raise AssertionError(node.output)

    def evaluate(self, *words: str) -> RunningProcess:
        """Run the study from the first host."""
        command = ["env", "-C", str(self.folder), *ONEBOT, "evaluate", *words]
        environment = {**self._variables, "RAY_ADDRESS": self._address}
        return RunningProcess(self.head.command(command), environment=environment, check=False)

    def ran_on(self, name: str) -> bool:
        """Whether an episode has begun on a host."""
        return any((self.folder / "ran").glob(f"{name}-*"))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """With the study, a module beside it, and the folder that its episodes write to."""
    (tmp_path / "study").mkdir()
    (tmp_path / "ran").mkdir()
    text = STUDY.replace("FOLDER", repr(str(tmp_path / "ran")))
    (tmp_path / "study/study.py").write_text(text)
    (tmp_path / "study/helper.py").write_text(HELPER)
    return tmp_path


def test_a_cluster_makes_the_same_table(folder: Path, second: Path) -> None:
    """As one process, bit by bit: with a worker that dies, and if a node is killed on the way."""
    if gap := missing():
        skip_for(gap)
    words = ("study/study.py",)
    done = run_to_end(
        [*ONEBOT, "evaluate", *words, "--workers", "1", "--out", "one.parquet"],
        cwd=folder,
        timeout=5 * PATIENCE,
    )
    assert done.returncode == 0, done.stderr
    one = parquet.read_table(folder / "one.parquet")
    assert "its worker died twice" in one["error"][7].as_py()
    assert one["error"].null_count == 7 and len(one["scan"][0]) == 360
    with Cluster(folder, second) as cluster:
        with cluster.evaluate(*words, "--on", "ray", "--out", "two.parquet") as study:
            assert study.wait(5 * PATIENCE) == 0, study.output
        assert cluster.ran_on("head") and cluster.ran_on("other")
        _assert_equal(one, folder / "two.parquet")

        for file in (folder / "ran").iterdir():
            file.unlink()
        with cluster.evaluate(*words, "--on", "ray", "--out", "killed.parquet") as study:
            wait_for(lambda: cluster.ran_on("other"), "an episode on the other node")
            os.killpg(cluster.node.process.pid, signal.SIGKILL)
            assert study.wait(5 * PATIENCE) == 0, study.output
        _assert_equal(one, folder / "killed.parquet")


@pytest.fixture(scope="module")
def on_ray() -> Iterator[ModuleType]:
    """The module, in a process that is connected to a cluster of one node."""
    ray = pytest.importorskip("ray")
    from onebot_control.evaluation import on_ray

    for attempt in range(_ATTEMPTS):
        try:
            ray.init("local", num_cpus=1, include_dashboard=False, log_to_driver=False)
            break
        except Exception:  # Ray's own, of a busy computer
            ray.shutdown()
            if attempt == _ATTEMPTS - 1:
                raise
    yield on_ray
    ray.shutdown()


@pytest.mark.parametrize(
    ("facts", "words"),
    [
        ({"python": "2.7"}, f"has python {platform.python_version()}, but this computer 2.7"),
        ({"embreex": "0.1"}, r"has embreex \S+, but this computer 0.1; install the same version"),
        ({"abacus": "1.0"}, "has no abacus, but this computer 1.0; install the same version"),
    ],
)
def test_a_node_with_other_packages_is_named(
    on_ray: ModuleType, monkeypatch: pytest.MonkeyPatch, facts: dict[str, str], words: str
) -> None:
    """The node is what it is; this computer has other facts."""
    present = on_ray.machine_facts()
    monkeypatch.setattr(on_ray, "machine_facts", lambda: {**present, **facts})
    with pytest.raises(OneBotError, match=rf"^Ray's node \S+ {words}.*$"):
        evaluate(lambda case: None, [{"seed": 1}], on="ray")


def test_a_node_without_a_module_of_the_study_is_named(
    on_ray: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "only_here", module := ModuleType("only_here"))
    exec("def returned(case): return {}", vars(module))
    with pytest.raises(OneBotError, match="cannot run the study: .*No module named 'only_here'"):
        evaluate(vars(module)["returned"], [{"seed": 1}], on="ray")


def _assert_equal(one: pa.Table, file: Path) -> None:
    """Bit by bit, with the facts in its metadata."""
    other = parquet.read_table(file)
    assert other.equals(one, check_metadata=True), other.to_pylist()
    assert file.read_bytes() == (file.parent / "one.parquet").read_bytes()
