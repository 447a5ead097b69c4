"""How the launcher stops: everything, in time, and with nothing left behind."""

import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.onebot_bringup.launcher_support import IDLE, Start, alive, launchers, number_in
from tests.support import wait_for

IMPORTS = """
import os, signal, subprocess, sys, time
from pathlib import Path
"""
# How each script begins.
SCRIPTS = {
    "polite": """
def stop(number, frame):
    print("goodbye")
    sys.exit(0)
signal.signal(signal.SIGINT, stop)
""",
    "stubborn": """
signal.signal(signal.SIGINT, signal.SIG_IGN)
signal.signal(signal.SIGTERM, signal.SIG_IGN)
""",
    "hanging": """
signal.signal(signal.SIGINT, lambda *_: signal.raise_signal(signal.SIGALRM))
""",
    "parent": """
child = subprocess.Popen([sys.executable, "stubborn.py"], stdout=subprocess.DEVNULL)
while not Path("stubborn.pid").is_file():
    time.sleep(0.01)
""",
}
READY = f"""
Path(sys.argv[0]).with_suffix(".pid").write_text(f"{{os.getpid()}}\\n")
print("ready")
{IDLE}"""


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Start]:
    scripts = {name: IMPORTS + begin + READY for name, begin in SCRIPTS.items()}
    with launchers(tmp_path, scripts) as make:
        yield make


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_stops_all_nodes_with_exit_code_zero(
    start: Start, tmp_path: Path, number: int
) -> None:
    """Whatever asks the launcher to stop, nodes get SIGINT, and their last line is shown."""
    launcher = start("[Node('a', 'polite'), Node('b', 'polite')]")
    wait_for(lambda: launcher.out.count("ready") == 2, "both nodes")
    launcher.process.send_signal(number)
    assert launcher.wait() == 0
    assert "[a] goodbye" in launcher.out and "[b] goodbye" in launcher.out
    assert launcher.err == ""
    assert not alive(number_in(tmp_path / "polite.pid"))


def test_a_node_that_hangs_while_it_stops_has_stopped(start: Start) -> None:
    """``run_node`` ends it by SIGALRM."""
    launcher = start("[Node('a', 'hanging')]")
    launcher.says("ready")
    assert launcher.interrupt() == 0


def test_a_node_that_ignores_all_signals_is_killed(start: Start, tmp_path: Path) -> None:
    """Ctrl-C ends even a node that ignores SIGINT and SIGTERM; the exit code says so."""
    nodes = "[Node('mule', 'stubborn'), Node('a', 'polite')]"
    launcher = start(nodes, patient=False)
    wait_for(lambda: launcher.out.count("ready") == 2, "both nodes")
    assert launcher.interrupt() == 1
    assert not alive(number_in(tmp_path / "stubborn.pid"))
    assert "mule has not stopped yet: SIGTERM" in launcher.err
    assert "mule has not stopped yet: SIGKILL" in launcher.err
    assert launcher.err.endswith("failed: mule (had to be killed)\n")


def test_a_second_interrupt_kills_at_once(start: Start, tmp_path: Path) -> None:
    """Who presses Ctrl-C again does not wait for the grace period."""
    launcher = start("[Node('mule', 'stubborn')]")
    launcher.says("ready")
    launcher.process.send_signal(signal.SIGINT)
    launcher.says("SIGINT: stopping")
    begin = time.monotonic()
    wait_for(lambda: time.monotonic() - begin > 0.5, "a second key press")
    assert launcher.interrupt() == 0
    assert "SIGTERM" not in launcher.err and "SIGKILL" in launcher.err
    assert not alive(number_in(tmp_path / "stubborn.pid"))


def test_what_a_dead_node_started_is_killed(start: Start, tmp_path: Path) -> None:
    """When a node dies, what it started goes with it, though the launcher runs on."""
    launcher = start("[Node('parent', 'parent', on_exit='ignore'), Node('a', 'polite')]")
    wait_for(lambda: launcher.out.count("ready") == 2, "both nodes")
    os.kill(number_in(tmp_path / "parent.pid"), signal.SIGKILL)
    grandchild = number_in(tmp_path / "stubborn.pid")
    wait_for(lambda: not alive(grandchild), "the end of the grandchild")
    assert alive(number_in(tmp_path / "polite.pid"))


def test_a_killed_launcher_leaves_no_orphan(start: Start, tmp_path: Path) -> None:
    """After SIGKILL of the launcher its nodes end, even those that ignore all other signals."""
    launcher = start("[Node('mule', 'stubborn'), Node('a', 'polite')]")
    wait_for(lambda: launcher.out.count("ready") == 2, "both nodes")
    pids = [number_in(tmp_path / f"{name}.pid") for name in ("stubborn", "polite")]
    launcher.process.kill()
    wait_for(lambda: not any(alive(pid) for pid in pids), "the end of all of them")


def test_interrupt_while_a_module_is_importing_shows_no_traceback(
    start: Start, tmp_path: Path
) -> None:
    """Ctrl-C in the first moment ends a node silently, not with KeyboardInterrupt in an import."""
    (tmp_path / "slow_import.py").write_text(
        "from pathlib import Path\nimport os, time\n"
        "Path('slow.pid').write_text(f'{os.getpid()}\\n')\ntime.sleep(600)\n"
    )
    launcher = start("[Node('slow', 'slow_import')]")
    pid = number_in(tmp_path / "slow.pid")
    assert launcher.interrupt() == 0
    assert launcher.err == "" and not alive(pid)
