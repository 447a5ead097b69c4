"""Compiles the library of this package; needs a C compiler or the ``ziglang`` wheel.

``python -m onebot_description.compiled.build_library [TARGET]`` builds it in place, or as
``TARGET``.
The build hook of the wheel loads this file by its path, before the package can be imported: only
the standard library may be used here.
"""

import os
import sys
import zlib
from pathlib import Path

# Each node loads this module to compare digests, so the functions of a build import what they need.

_PACKAGE = Path(__file__).parents[1]
_WIRE, _MODEL = _PACKAGE / "ros" / "wire", _PACKAGE / "model"
SOURCES = (
    _WIRE / "_type_support.c",
    _WIRE / "_schema.c",
    _WIRE / "_state_converter.c",
    _MODEL / "_kinematics.c",
    _PACKAGE / "ros" / "_transform_buffer.c",
)
_HEADERS = (_WIRE / "_program.h", _MODEL / "_joint.h")
LIBRARY = Path(__file__).with_name("_library.so")

# The oldest C library that the ROS 2 wheels themselves run on.
_ZIG_TARGETS = {
    "x86_64": "x86_64-linux-gnu.2.28",
    "aarch64": "aarch64-linux-gnu.2.28",
}
# -fexceptions: Fast CDR, which is C++, throws through our functions.
_FLAGS = (
    "-std=c11 -O3 -ffp-contract=off -g0 -s -fPIC -shared -fexceptions -fvisibility=hidden".split()
)
if sys.platform == "darwin":  # its linker would look up Python's functions at build time
    _FLAGS += ["-undefined", "dynamic_lookup"]


class BuildError(Exception):
    """The library cannot be compiled; ``str(error)`` says why and what to do."""


def source_digest() -> str:
    """Return a hash of the sources; the library contains it, so that an outdated one is noticed.

    A checksum is enough; hashlib would load OpenSSL into each node, which takes 3 MB and 3 ms.
    """
    texts = b"\0".join(source.read_bytes() for source in (*SOURCES, *_HEADERS))
    return f"{len(texts):x}-{zlib.crc32(texts):08x}"


def find_system_compilers() -> list[list[str]]:
    """Return the commands of the C compilers on this machine, the preferred one first.

    The environment variable ``CC`` (which may hold arguments) overrides the usual names.
    """
    import shlex
    import shutil

    if os.environ.get("CC", "").strip():
        candidates = [shlex.split(os.environ["CC"])]
    else:
        candidates = [["cc"], ["gcc"], ["clang"]]
    return [command for command in candidates if shutil.which(command[0])]


def find_zig() -> list[list[str]]:
    """Return the command of the C compiler in the ``ziglang`` wheel; empty if not installed."""
    import importlib.util
    import platform

    target = _ZIG_TARGETS.get(platform.machine())
    if target is None or importlib.util.find_spec("ziglang") is None:
        return []
    return [[sys.executable, "-m", "ziglang", "cc", "-target", target]]


def build(target: Path) -> None:
    """Compile the library with the first compiler that succeeds.

    ``target`` is replaced atomically: a process that has loaded the old library keeps it.
    """
    import shlex
    import tempfile

    commands = [*find_system_compilers(), *find_zig()]
    failures: list[str] = []
    try:
        with tempfile.TemporaryDirectory(dir=target.parent, prefix=".build-") as folder:
            for command in commands:
                library = Path(folder) / LIBRARY.name
                failure = _compile(command, library)
                if failure is None:
                    os.replace(library, target)
                    return
                failures.append(f"`{shlex.join(command)}` {failure}")
    except OSError as error:
        raise BuildError(f"cannot write {target}: {error.strerror or error}") from error
    raise BuildError(_explain(failures))


def _compile(command: list[str], library: Path) -> str | None:
    """Run one compiler; return what went wrong, None if nothing."""
    import subprocess

    digest = f'-DONEBOT_SOURCE_DIGEST="{source_digest()}"'
    arguments = [*command, *_FLAGS, digest, "-o", str(library), *map(str, SOURCES), "-lm"]
    # Zig's default cache folder may be read-only, and would stay behind.
    caches = {name: str(library.parent) for name in ("ZIG_GLOBAL_CACHE_DIR", "ZIG_LOCAL_CACHE_DIR")}
    environment = {**os.environ, **caches}
    try:
        result = subprocess.run(
            arguments, capture_output=True, text=True, errors="replace", env=environment
        )
    except OSError as error:
        return f"cannot be run: {error.strerror}"
    if result.returncode != 0:
        output = (result.stderr or result.stdout).strip()
        return f"failed with exit code {result.returncode}: {output[-2000:]}"
    return None


def _explain(failures: list[str]) -> str:
    lines = [f"cannot compile {LIBRARY.name}, which publishing transforms needs."]
    if failures:
        lines += ["Tried:", *(f"  {failure}" for failure in failures)]
    else:
        names = os.environ.get("CC", "").strip() or "cc, gcc and clang"
        lines.append(f"There is no C compiler: none of {names} is on the PATH.")
    lines.append("Install gcc or clang, or run `pip install ziglang`, then try again.")
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> int:
    """Build the library in place or as the one argument; return the exit code."""
    import argparse

    parser = argparse.ArgumentParser(prog="python -m onebot_description.compiled.build_library")
    parser.add_argument("target", nargs="?", type=Path, default=LIBRARY, metavar="TARGET")
    target = parser.parse_args(arguments).target
    try:
        build(target)
    except BuildError as error:
        print(error, file=sys.stderr)
        return 1
    print(target)
    return 0


if __name__ == "__main__":
    sys.exit(main())
