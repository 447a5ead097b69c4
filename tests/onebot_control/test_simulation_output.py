"""C code's output is caught, without losing what others print."""

import ctypes
import os
import subprocess
import sys
import threading
from pathlib import Path

from onebot_control.physics.engine import captured, log

_LIBC = ctypes.CDLL(None)
CHECKOUT = Path(__file__).resolve().parents[2]


def test_catches_what_c_prints(capfd, caplog):
    """In lines; what is buffered before passes."""
    _LIBC.printf(b"of C;")
    sys.stdout.write("of Python;")
    with captured() as lines:
        _LIBC.puts(b"no inertia for link\n")
        _LIBC.puts(b"b3Printf: second")
    print("after")
    assert lines == ["no inertia for link", "b3Printf: second"]
    assert {*capfd.readouterr().out.split(";")} == {"of C", "of Python", "after\n"}
    log(["100 % sure"])
    assert caplog.messages == ["PyBullet: 100 % sure"]


def test_two_threads_do_not_mix_up_each_others_stdout(capfd):
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


def test_import_is_silent_even_with_stdout_closed():
    """PyBullet announces itself on import; a daemon may have no stdout at all."""
    code = "import onebot_control.physics.spawning"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=CHECKOUT, check=True
    )
    assert (done.stdout, done.stderr) == ("", "")
    shell = f'"{sys.executable}" -c "{code}" >&- 2>&-'
    assert subprocess.run(shell, shell=True, cwd=CHECKOUT).returncode == 0
