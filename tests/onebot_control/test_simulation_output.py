"""C code's output is caught, without losing what others print."""

import ctypes
import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from onebot_control.simulation.engine import captured

_LIBC = ctypes.CDLL(None)
CHECKOUT = Path(__file__).resolve().parents[2]


def test_catches_what_c_prints(capfd):
    """In lines, without the places in Bullet's sources; what comes before and after passes."""
    print("before")
    with captured() as lines:
        _LIBC.printf(b"b3Warning[examples/some/file.cpp,126]:\nno inertia for link")
        _LIBC.puts(b"b3Printf: second")
    print("after")
    assert lines == ["no inertia for link", "b3Printf: second"] or lines == [
        "no inertia for linkb3Printf: second"
    ]
    assert capfd.readouterr().out == "before\nafter\n"


def test_restores_after_an_error(capfd):
    """Stdout works again, and the lines are there."""
    with pytest.raises(RuntimeError), captured() as lines:
        os.write(1, b"lost otherwise\n")
        raise RuntimeError
    os.write(1, b"heard\n")
    assert lines == ["lost otherwise"]
    assert capfd.readouterr().out == "heard\n"


def test_two_threads_do_not_mix_up_each_others_stdout(capfd):
    """Each waits for the other, and afterwards stdout is the old one."""
    caught = []

    def work(name: bytes) -> None:
        for _ in range(50):
            with captured() as lines:
                os.write(1, name + b"\n")
            caught.append((name.decode(), lines))

    threads = [threading.Thread(target=work, args=(name,)) for name in (b"one", b"two")]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert all(lines == [name] for name, lines in caught)
    assert len(caught) == 100
    os.write(1, b"heard\n")
    assert capfd.readouterr().out == "heard\n"


def test_leaves_no_file_descriptors_behind():
    """However often it is used."""
    before = len(os.listdir("/proc/self/fd"))
    for _ in range(20):
        with captured(1, 2):
            pass
    assert len(os.listdir("/proc/self/fd")) == before


def test_import_is_silent_even_with_stdout_closed():
    """PyBullet announces itself on import; a daemon may have no stdout at all."""
    code = "import onebot_control.simulation.loading"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=CHECKOUT, check=True
    )
    assert (done.stdout, done.stderr) == ("", "")
    shell = f'"{sys.executable}" -c "{code}" >&- 2>&-'
    assert subprocess.run(shell, shell=True, cwd=CHECKOUT).returncode == 0
