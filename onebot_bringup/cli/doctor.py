"""``onebot doctor``: finds problems of this computer and suggests fixes, like ``ros2 doctor``."""

import os
import platform
import re
import subprocess
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from importlib import metadata
from pathlib import Path
from typing import NamedTuple

import onebot_description
from onebot_bringup.cli.options import Parser, option, positive
from onebot_description.elements.packages import package_share
from onebot_description.errors import OneBotError, listing
from onebot_description.ros.discovery import MAX_DOMAIN, RANGE, SERVER, use_local_discovery
from onebot_description.ros.packages import origin, package_names
from onebot_description.ros.shared_memory import FOLDER, find_segments

OK, NOTE, PROBLEM = "ok", "note", "problem"

_RANGES = ("LOCALHOST", "SUBNET", "SYSTEM_DEFAULT")

_MIN_MEMORY = 16 * 2**20  # free bytes in /dev/shm that a bringup needs
_NAME = "onebot-robots"
_REQUIREMENT = re.compile(r"([\w.-]+)[^;]*")  # a requirement that has no marker (extra, platform)
_PROJECT = "pyproject.toml"
_BULLETS = ("pybullet", "pybullet-arm64")  # the second is a fork of the first
_IS_LINUX, _IS_X86 = sys.platform == "linux", platform.machine() == "x86_64"
# The distribution that pyproject.toml names for this Python.
_BULLET = _BULLETS[0 if _IS_LINUX and (sys.version_info < (3, 12) or not _IS_X86) else 1]
_ONEBOT = (sys.executable, "-m", "onebot_bringup.cli.main")


class Verdict(NamedTuple):
    """One line of the report."""

    level: str  # OK; NOTE: works, but something could be better; PROBLEM: something is broken
    text: str
    remedy: str = ""  # the command or change that helps


def run(argv: Sequence[str]) -> int:
    """Print the report; return 1 if something is broken."""
    timeout = option("--timeout", "S", "time limit of a message (20 s)", positive, 20.0)
    summary = "check that this computer has what ROS and this project need"
    args = Parser("onebot doctor", summary, [timeout]).parse(argv)
    use_local_discovery()
    python = f"Python {platform.python_version()} on {platform.platform()}"
    print(f"onebot {onebot_description.__version__}, {python}")
    checks: dict[str, Callable[[], Verdict]] = {
        "dependencies": lambda: dependencies(_required()),
        "pybullet": pybullet,
        "compiled library": _library,
        "rclpy": _rclpy,
        "packages": _packages,
        "domain": lambda: domain(os.environ),
        "messages": lambda: _messages(args.timeout),
        "shared memory": lambda: shared_memory(FOLDER),
        "renderer": _renderer,
    }
    code = 0
    for name, check in checks.items():
        level, text, remedy = check()
        print(f"{level:8} {name}: {text}{f'; {remedy}' if remedy else ''}", flush=True)
        code |= level == PROBLEM
    return code


def _required() -> list[str]:
    """Return the required packages, from the installed metadata or else from pyproject.toml."""
    with suppress(metadata.PackageNotFoundError):
        return metadata.requires(_NAME) or []
    if sys.version_info >= (3, 11):
        import tomllib

        file = Path(__file__).resolve().parents[2] / _PROJECT
        with suppress(OSError, OneBotError):
            file = file if file.is_file() else package_share("onebot_bringup") / _PROJECT
            return list(tomllib.loads(file.read_text(encoding="utf-8"))["project"]["dependencies"])
    return []


def dependencies(required: Iterable[str]) -> Verdict:
    """Check that the required packages are installed, and with pip their versions."""
    matches = map(_REQUIREMENT.fullmatch, required)
    names = [match[1] for match in matches if match]
    if missing := [name for name in names if not any(metadata.distributions(name=name))]:
        return Verdict(PROBLEM, f"missing: {listing(missing)}", f"pip install {' '.join(missing)}")
    if not names:
        return Verdict(NOTE, "not checked: not installed by pip, nor beside a pyproject.toml")
    lines = _python("-m", "pip", "check").stdout.splitlines()
    if problems := [line for line in lines if line.startswith(f"{_NAME} ")]:
        return Verdict(PROBLEM, "; ".join(problems), f"pip install --upgrade {_NAME}")
    return Verdict(OK, f"{len(names)} found")


def pybullet() -> Verdict:
    """Check that one distribution has installed the module pybullet, and only one."""
    installed = [name for name in _BULLETS if any(metadata.distributions(name=name))]
    if len(installed) == 1:
        return Verdict(OK, f"{installed[0]} {metadata.version(installed[0])}")
    repair = f"pip install --force-reinstall --no-deps {_BULLET}"
    if not installed:
        return Verdict(PROBLEM, f"neither {' nor '.join(_BULLETS)} is installed", repair)
    text = f"{' and '.join(_BULLETS)} are both installed, and overwrite each other's files"
    return Verdict(PROBLEM, text, f"pip uninstall -y {' '.join(_BULLETS)} && {repair}")


def _library() -> Verdict:
    from onebot_description.compiled.library import load_library

    try:
        load_library()
    except OneBotError as error:
        return Verdict(PROBLEM, str(error))
    return Verdict(OK, "loaded")


def _rclpy() -> Verdict:
    """Check that rclpy can be imported with the middleware that the environment names."""
    code = (
        "import rclpy, rclpy.utilities as u; "
        "print(u.get_rmw_implementation_identifier(), 'from', rclpy.__path__[0])"
    )
    done = _python("-c", code)
    if not done.returncode:
        return Verdict(OK, done.stdout.strip())
    if name := os.environ.get("RMW_IMPLEMENTATION"):
        return Verdict(PROBLEM, f"it does not run with {name}", "unset RMW_IMPLEMENTATION")
    return Verdict(
        PROBLEM,
        f"it cannot be imported: {_last_line(done)}",
        "is another ROS sourced? use a new shell, or unset PYTHONPATH LD_LIBRARY_PATH "
        "AMENT_PREFIX_PATH",
    )


def _packages() -> Verdict:
    """List the sources of the packages that ROS's wheels lack."""
    places: dict[str, list[str]] = {}
    for name in package_names():
        places.setdefault(origin(name) or "nowhere", []).append(name)
    text = "; ".join(f"{', '.join(names)} from {place}" for place, names in places.items())
    code = "import sys; print(any(getattr(each, 'is_onebot', 0) for each in sys.meta_path))"
    if _python("-c", code).stdout.strip() == "True":
        return Verdict(OK, text)
    return Verdict(NOTE, f"{text}; other programs do not find them", f"pip install {_NAME}")


def domain(environment: Mapping[str, str]) -> Verdict:
    """Check ROS_DOMAIN_ID, and show what is discovered."""
    text = environment.get("ROS_DOMAIN_ID", "") or "0"
    scope = environment.get(SERVER) or environment.get(RANGE) or "SUBNET"
    if not text.isdecimal() or int(text) > MAX_DOMAIN:
        problem = f"ROS_DOMAIN_ID={text} is not a number from 0 to {MAX_DOMAIN}"
        return Verdict(PROBLEM, problem, "export ROS_DOMAIN_ID=0")
    if not environment.get(SERVER) and scope.upper() not in _RANGES:
        problem = f"{RANGE}={scope} discovers no other nodes"
        return Verdict(PROBLEM, problem, f"write one of {listing(_RANGES)}")
    return Verdict(OK, f"ROS_DOMAIN_ID={text}, discovery by {scope}")


def _messages(timeout: float) -> Verdict:
    """Check that messages from one process reach another with the current discovery settings."""
    topic, kind = f"/_onebot_doctor_{os.getpid()}", "std_msgs/msg/String"
    publisher = subprocess.Popen(
        [*_ONEBOT, "topic", "pub", "-r", "10", topic, kind],
        stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    try:
        received = subprocess.run(
            [*_ONEBOT, "topic", "echo", "--once", "--timeout", str(timeout), topic, kind],
            stdin=subprocess.DEVNULL, capture_output=True, text=True,
        )  # fmt: skip
    finally:
        publisher.kill()
        publisher.wait()
    if not received.returncode:
        return Verdict(OK, "discovered and received from another process")
    return Verdict(
        PROBLEM,
        f"none from another process: {_last_line(received)}",
        "see the lines above; a firewall may drop UDP to this computer's own ports from 7400 on, "
        "or the network multicast: export ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST",
    )


def shared_memory(folder: Path) -> Verdict:
    """Check free shared memory, and report remains of killed processes."""
    try:
        space = os.statvfs(folder)
    except OSError as error:
        return Verdict(
            PROBLEM, f"{folder}: {error.strerror}; DDS falls back to UDP", "mount a tmpfs there"
        )
    segments = find_segments(folder)
    free = space.f_bavail * space.f_frsize
    text = f"{free / 2**20:.0f} MiB free, {len(segments.used)} segments in use"
    if segments.stale:
        size = segments.stale_bytes / 2**20
        text += f", {len(segments.stale)} ({size:.0f} MiB) of killed processes"
    remedy = "the next bringup removes them" if segments.stale else ""
    if free < _MIN_MEMORY:
        room = "in a container: --shm-size=256m or --ipc host"
        return Verdict(PROBLEM, text, remedy or room)
    return Verdict(NOTE if segments.stale else OK, text, remedy)


def _renderer() -> Verdict:
    code = "from onebot_bringup.viewer import rendering; print(rendering.renderer_problem())"
    done = _python("-c", code)
    problem = _last_line(done) if done.returncode else done.stdout.strip()
    if problem:
        return Verdict(NOTE, f"onebot snapshot does not work: {problem}")
    return Verdict(OK, "draws pictures")


def _python(*words: str) -> "subprocess.CompletedProcess[str]":
    """Run Python code in a child process, as rcl ends the process if the middleware is wrong."""
    return subprocess.run([sys.executable, *words], capture_output=True, text=True)


def _last_line(done: "subprocess.CompletedProcess[str]") -> str:
    lines = done.stderr.strip().splitlines()
    return lines[-1].removeprefix("error: ") if lines else f"exit code {done.returncode}"
