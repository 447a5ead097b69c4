"""Build hook of the wheel: compiles the library of onebot_description, and writes type stubs.

The result calls Python by its stable functions only, and is loaded with ctypes: one wheel serves
every Python 3 on its platform. Where no C compiler exists, pip brings one for the time of the
build, in the ``ziglang`` wheel.
"""

import importlib.util
import re
import sysconfig
import tempfile
from pathlib import Path
from types import ModuleType
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

_FOLDER = "onebot_description/compiled"
_PACKAGES = "onebot_description/ros/packages"
# The oldest glibc that pip has tags for, where it is not 2.17.
_OLDEST_GLIBC = {"x86_64": (2, 5), "i686": (2, 5)}


def _platform_tag(library: Path) -> str:
    """Return the wheel's platform tag: manylinux (PEP 600) if the library needs glibc.

    An index takes no wheel for "linux", and glibc runs what was linked against an older one. The
    library has the versions that it needs among the names of its symbols, such as GLIBC_2.14.
    """
    platform = sysconfig.get_platform().replace("-", "_").replace(".", "_")
    needed = re.findall(rb"\0GLIBC_(\d+)\.(\d+)", library.read_bytes())
    if not needed:
        return platform
    machine = platform.removeprefix("linux_")
    versions = [(int(major), int(minor)) for major, minor in needed]
    major, minor = max(*versions, _OLDEST_GLIBC.get(machine, (2, 17)))
    return f"manylinux_{major}_{minor}_{machine}"


class CustomBuildHook(BuildHookInterface):  # type: ignore[misc]
    """Puts the compiled library in the wheel, or in the checkout for an editable install.

    Stubs of the packages of interfaces are installed in both ways.
    """

    def dependencies(self) -> list[str]:
        """Name the wheels that this build needs besides hatchling."""
        if self.target_name != "wheel" or self._build_library.find_system_compilers():
            return []
        return ["ziglang"]

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile, before the wheel's files are collected.

        Args:
            version: "editable" for an editable install, "standard" for a wheel with all files.
            build_data: what hatchling reads from a hook; gets the library and the wheel's tag.

        Raises:
            BuildError: nothing here can compile C; the message names what to install.
        """
        if self.target_name != "wheel":
            return
        library = self._build_library
        self._temporary = tempfile.TemporaryDirectory(prefix="onebot-build-")
        folder = Path(self.root, _FOLDER) if version == "editable" else Path(self._temporary.name)
        target = folder / library.LIBRARY.name
        library.build(target)
        if version != "editable":
            build_data["force_include"][str(target)] = f"{_FOLDER}/{target.name}"
        stubs = self._load(f"{_PACKAGES}/stubs.py")
        for package in Path(self.root, _PACKAGES).iterdir():
            if stub := stubs.write_stubs(package.name, package, Path(self._temporary.name)):
                build_data["force_include"][str(stub)] = stub.name
        build_data["pure_python"] = False
        build_data["tag"] = f"py3-none-{_platform_tag(target)}"

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove the folder that the files were made in."""
        if temporary := getattr(self, "_temporary", None):
            temporary.cleanup()

    @property
    def _build_library(self) -> ModuleType:
        return self._load(f"{_FOLDER}/build_library.py")

    def _load(self, file: str) -> ModuleType:
        # By its path: the package cannot be imported while it is built.
        path = Path(self.root, file)
        spec = importlib.util.spec_from_file_location(f"onebot_{path.stem}", path)
        assert spec is not None and spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return module
