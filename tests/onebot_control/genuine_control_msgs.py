"""Builds packages such as control_msgs with ROS's own generators, for tests of the types made here.

No wheel of ROS has them, so ``load_interface`` makes their types of definitions. That these are
everyone else's types can only be shown by types that share no code with them. The wheels do have
the generators, and the headers and libraries that generated code needs: this module calls them as
CMake would for somebody who builds the package. It takes 30 s of processor time; CMake would need
more wheels, and corrections of what they say about the machine on which they were made.

    python -m tests.onebot_control.genuine_control_msgs FOLDER TYPE ...

builds these types of one package, with those in them, and needs a C and a C++ compiler and
Python's headers. FOLDER belongs on PYTHONPATH and its folder ``lib`` on LD_LIBRARY_PATH before the
process starts that is to have the package.
"""

import os
import shutil
import subprocess
import sys
import sysconfig
from collections.abc import Iterable, Sequence
from pathlib import Path
from unittest.mock import patch

import numpy as np
from rosidl_cli.command.helpers import build_type_description_tuples
from rosidl_cli.command.translate.api import translate
from rosidl_generator_c.cli import GenerateC
from rosidl_generator_py.cli import GeneratePython
from rosidl_typesupport_c.cli import GenerateCTypesupport
from rosidl_typesupport_fastrtps_c.cli import GenerateFastRTPSCTypesupport
from rosidl_typesupport_introspection_c.cli import GenerateIntrospectionCTypesupport

from onebot_description.ros.wire.interface_text import own_package

_PREFIX = Path(sys.prefix)
# A library of each one's code, in this order: each is linked to those before it.
_GENERATORS = {
    "rosidl_generator_c": GenerateC,
    "rosidl_typesupport_fastrtps_c": GenerateFastRTPSCTypesupport,
    "rosidl_typesupport_introspection_c": GenerateIntrospectionCTypesupport,
    "rosidl_typesupport_c": GenerateCTypesupport,
    "rosidl_generator_py": GeneratePython,
}
_FLAGS = "-O0 -g0 -w -fPIC -shared -Wl,--as-needed".split()


def build(folder: Path, types: Sequence[str]) -> None:
    """Generate, compile and link a package in an empty folder."""
    package = types[0].partition("/")[0]
    (folder / "lib").mkdir(parents=True)
    with patch.dict(os.environ, AMENT_PREFIX_PATH=sys.prefix):  # for the generators' templates
        _generate(folder, package, types)
    for name in _GENERATORS:
        sources = folder / "src" / name / package
        _link(folder, f"lib/lib{package}__{name}.so", sources.glob("*/**/*.c*"))
    # The Python package, and the module by which it reaches the libraries.
    python = folder / "src/rosidl_generator_py" / package
    shutil.copytree(python, folder / package, ignore=shutil.ignore_patterns("*.c"))
    (folder / package / "__init__.py").touch()
    source = python / f"_{package}_s.ep.rosidl_typesupport_c.c"
    _link(folder, f"{package}/{package}_s__rosidl_typesupport_c.so", [source])


def _generate(folder: Path, package: str, types: Sequence[str]) -> None:
    """Write the code, and beside that of C each type's description and hash as a .json file."""
    definitions = own_package(package)
    files = [f"{kind}/{name}.{kind}" for _, kind, name in (type_.split("/") for type_ in types)]
    translated = translate(
        package_name=package,
        interface_files=[f"{definitions}:{file}" for file in files],
        output_format="idl",
        output_path=folder / "idl",
    )
    with patch("rosidl_generator_c.cli.build_type_description_tuples", _description_tuples):
        for name, generator in _GENERATORS.items():
            output = folder / "src" / name / package
            generator(name).generate(package, translated, [_PREFIX / "share"], output_path=output)


def _description_tuples(idl_files: Iterable[object], descriptions: Iterable[object]) -> list[str]:
    """Each file with its description; rosidl_cli confuses a message with an action of its name."""
    kinds = {str(file): Path(str(file).rpartition(":")[2]).parent.name for file in idl_files}
    return [
        pair
        for file, kind in kinds.items()
        for pair in build_type_description_tuples(
            [file], [path for path in descriptions if Path(str(path)).parent.name == kind]
        )
    ]


def _link(folder: Path, library: str, sources: Iterable[Path]) -> None:
    """Compile a library, and link it to what it needs of those built before and of the wheels."""
    headers = _PREFIX / "include"
    folders = [*(folder / "src").iterdir(), headers, *headers.iterdir()]
    includes = [*map(str, folders), sysconfig.get_path("include"), np.get_include()]
    files = sorted(map(str, sources))
    libraries = [*(folder / "lib").glob("*.so"), *(_PREFIX / "lib").glob("*.so")]
    command = [
        "c++" if files[0].endswith(".cpp") else "cc",
        *_FLAGS,
        f"-Wl,-soname,{Path(library).name}",
        *("-o", str(folder / library)),
        *(f"-I{include}" for include in includes),
        *files,
        *map(str, libraries),
    ]
    subprocess.run(command, check=True)


if __name__ == "__main__":
    build(Path(sys.argv[1]), sys.argv[2:])
