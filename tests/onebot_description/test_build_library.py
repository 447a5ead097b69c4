"""Compiling the type support: in the build hook, by hand, and what is said when it fails."""

import importlib.util
import json
import os
import platform
import shutil
import stat
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest
from packaging.tags import sys_tags
from packaging.utils import parse_wheel_filename

from onebot_description.compiled import build_library, library
from onebot_description.compiled.build_library import BuildError
from onebot_description.errors import OneBotError

pytestmark = pytest.mark.checkout

CHECKOUT = Path(__file__).parents[2]
FOLDER = "onebot_description/compiled"
HAS_ZIG = importlib.util.find_spec("ziglang") is not None
needs_compiler = pytest.mark.skipif(
    not (build_library.find_system_compilers() or HAS_ZIG), reason="no C compiler here"
)
LOAD = "from onebot_description.compiled import library; print(library.load_library()._name)"
PYPROJECT = """
[build-system]
requires = ["hatchling"]
build-backend = "hatchling.build"
[project]
name = "onebot"
version = "0.1.0"
[tool.hatch.build]
dev-mode-dirs = ["."]
[tool.hatch.build.targets.wheel]
packages = ["onebot_description"]
[tool.hatch.build.hooks.custom]
"""


def run(*command: str | Path, cwd: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run this Python with the arguments, importing from the folder ``cwd`` first."""
    return subprocess.run(
        [sys.executable, *map(str, command)],
        cwd=cwd,
        env={**os.environ, "PYTHONPATH": str(cwd), **environment},
        capture_output=True,
        text=True,
        timeout=300,
    )


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """A project with nothing compiled in it."""
    project = tmp_path / "project"
    unwanted = shutil.ignore_patterns("*.so", "__pycache__", ".build-*", "meshes")
    source = CHECKOUT / "onebot_description"
    shutil.copytree(source, project / source.name, ignore=unwanted)
    shutil.copy(CHECKOUT / "hatch_build.py", project)
    (project / ".gitignore").write_text("*.so\n__pycache__/\n")
    (project / "pyproject.toml").write_text(PYPROJECT)
    return project


def write_program(path: Path, text: str) -> Path:
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(path.stat().st_mode | stat.S_IXUSR)
    return path


def test_a_library_that_cannot_be_used(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    load = library.load_library.__wrapped__  # not cached
    remedy = "Build it with: python -m onebot_description.compiled.build_library"
    monkeypatch.setattr(build_library, "LIBRARY", tmp_path / "missing.so")
    with pytest.raises(OneBotError, match=f"missing.so cannot be loaded: .*{remedy}$"):
        load()
    (tmp_path / "missing.so").write_bytes(b"not a library")
    with pytest.raises(OneBotError, match="missing.so cannot be loaded"):
        load()
    monkeypatch.undo()
    monkeypatch.setattr(build_library, "SOURCES", build_library.SOURCES[:1])
    with pytest.raises(OneBotError, match=f"does not match the source. {remedy}$"):
        load()
    monkeypatch.setattr(build_library, "SOURCES", (tmp_path / "none.c",))
    assert load().onebot_link_poses  # an installation without sources


@pytest.mark.skipif(not build_library.find_system_compilers(), reason="no C compiler here")
def test_no_warnings(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capfd) -> None:
    compiler = build_library.find_system_compilers()[0][0]
    monkeypatch.setenv("CC", f"{compiler} -Wall -Wextra -Wpedantic -Wshadow -Werror")
    target = tmp_path / "library.so"
    assert build_library.main([str(target)]) == 0
    assert capfd.readouterr() == (f"{target}\n", "")
    assert list(tmp_path.iterdir()) == [target] and target.stat().st_size > 0


def test_failing_compiler(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    compiler = write_program(tmp_path / "mycc", "echo 'no such thing' >&2; exit 3")
    monkeypatch.setenv("CC", f"{compiler} -O3")
    assert build_library.find_system_compilers() == [[str(compiler), "-O3"]]
    if HAS_ZIG:
        return  # which then does it
    with pytest.raises(BuildError) as caught:
        build_library.build(tmp_path / "library.so")
    text = str(caught.value)
    assert f"`{compiler} -O3` failed with exit code 3: no such thing" in text
    assert "Install gcc or clang, or run `pip install ziglang`" in text
    assert list(tmp_path.iterdir()) == [compiler]


@pytest.mark.skipif(HAS_ZIG, reason="ziglang is a compiler")
@pytest.mark.parametrize(
    ("named", "words"),
    [
        ("", "There is no C compiler: none of cc, gcc and clang is on the PATH.\nInstall gcc"),
        ("mycc -m64", "There is no C compiler: none of mycc -m64 is on the PATH."),
    ],
)
def test_no_compiler(monkeypatch, tmp_path: Path, capsys, named: str, words: str) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setenv("CC", named)
    assert build_library.main([str(tmp_path / "library.so")]) == 1
    error = capsys.readouterr().err
    assert words in error and "run `pip install ziglang`" in error


@needs_compiler
def test_target_that_cannot_be_written(tmp_path: Path) -> None:
    with pytest.raises(BuildError, match=r"cannot write .*nowhere/library\.so: No such file"):
        build_library.build(tmp_path / "nowhere" / "library.so")


def build_backend(project: Path, call: str, **environment: str) -> str:
    """Call the build backend as pip does; return what it answers."""
    pytest.importorskip("hatchling")
    code = f"import hatchling.build as backend; print(backend.{call})"
    result = run("-c", code, cwd=project, **environment)
    assert result.returncode == 0, result.stderr
    return result.stdout.splitlines()[-1]


@needs_compiler
def test_source_distribution_and_wheel(checkout: Path, tmp_path: Path) -> None:
    """The wheel is for the oldest glibc that has its symbols.

    The ``pow`` of glibc 2.29 is new: only what is compiled there needs it.
    """
    source = checkout / "onebot_description/model/_kinematics.c"
    more = "\ndouble power(double x) { return pow(x, x); }\n"
    source.write_text("#include <math.h>\n" + source.read_text() + more)
    # A library from an earlier editable install must not get into the way.
    (checkout / FOLDER / "_library.so").write_bytes(b"old")
    name = build_backend(checkout, f"build_sdist({str(tmp_path)!r})")
    with tarfile.open(tmp_path / name) as archive:
        assert not [item for item in archive.getnames() if item.endswith(".so")]
        archive.extractall(tmp_path)
    name = build_backend(tmp_path / "onebot-0.1.0", f"build_wheel({str(tmp_path)!r})")
    unpacked = tmp_path / "unpacked"
    with zipfile.ZipFile(tmp_path / name) as wheel:
        assert [item for item in wheel.namelist() if item.endswith(".so")] == [
            f"{FOLDER}/_library.so"
        ]
        wheel.extractall(unpacked)
    metadata = (unpacked / "onebot-0.1.0.dist-info" / "WHEEL").read_text()
    assert "Root-Is-Purelib: false" in metadata
    result = run("-c", LOAD, cwd=unpacked)
    assert result.returncode == 0, result.stderr
    assert result.stdout.split() == [str(unpacked / FOLDER / "_library.so")]
    check_platform(tmp_path / name)


def check_platform(wheel: Path) -> None:
    """An index takes the tag, and auditwheel finds that the library keeps to it."""
    shown = run("-m", "auditwheel", "show", "--json", wheel, cwd=wheel.parent)
    assert shown.returncode == 0, shown.stderr
    audit = json.loads(shown.stdout)
    versions = [
        version.removeprefix("GLIBC_").split(".")
        for symbols in audit["versioned_symbols"].values()
        for version in symbols
        if version.startswith("GLIBC_")
    ]
    needed = max((int(major), int(minor)) for major, minor, *_ in versions)
    (tag,) = parse_wheel_filename(wheel.name)[3]
    assert tag in set(sys_tags())  # pip installs it here
    machine = platform.machine()
    oldest = (2, 5) if machine == "x86_64" else (2, 17)  # that pip looks for
    major, minor = max(needed, oldest)
    assert tag.platform == f"manylinux_{major}_{minor}_{machine}"
    assert audit["overall_tag"].startswith("manylinux_")  # "linux_..." if it needs anything else


def test_build_requirements(checkout: Path, tmp_path: Path) -> None:
    compiler = write_program(tmp_path / "gcc", "exit 0")
    hook = "get_requires_for_build_wheel()"
    assert "ziglang" not in build_backend(checkout, hook, PATH=str(compiler.parent), CC="")
    assert "ziglang" in build_backend(checkout, hook, PATH=str(tmp_path / "empty"), CC="")
    sdist = build_backend(checkout, "get_requires_for_build_sdist()", PATH="/nowhere", CC="")
    assert "ziglang" not in sdist
