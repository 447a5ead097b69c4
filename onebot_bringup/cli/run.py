"""``onebot run PACKAGE EXECUTABLE ...``: runs a node or bringup, like ``ros2 run``."""

import importlib
import os
import sys
from collections.abc import Sequence

from onebot_bringup.launch.nodes import BRINGUPS, NODES
from onebot_description.errors import UsageError, did_you_mean
from onebot_description.ros.discovery import use_local_discovery
from onebot_description.ros.process_start import blas_variables

# Module of each executable by package and name, as installed by the packages' CMakeLists.txt.
EXECUTABLES: dict[str, dict[str, str]] = {}
for module in (*(row.module for row in NODES), *BRINGUPS.values()):
    EXECUTABLES.setdefault(module.partition(".")[0], {})[module.rpartition(".")[2]] = module


def run(argv: Sequence[str]) -> int:
    """Run the executable and return its exit code."""
    if argv and argv[0] in ("-h", "--help"):
        print("usage: onebot run PACKAGE EXECUTABLE [ARGUMENT ...] [--ros-args ...]\n")
        print("Runs a node or a bringup:")
        for package, executables in EXECUTABLES.items():
            print("".join(f"  {package} {executable}\n" for executable in executables), end="")
        return 0
    if len(argv) < 2:
        raise UsageError("onebot run takes a package, an executable and its arguments")
    package, executable, *arguments = argv
    modules = EXECUTABLES.get(package, {})
    if executable not in modules:
        pairs = [f"{name} {node}" for name, row in EXECUTABLES.items() for node in row]
        pair = f"{package} {executable}"
        raise UsageError(f'onebot run has no "{pair}"{did_you_mean(pair, pairs)}')
    use_local_discovery()
    os.environ.update(blas_variables())
    sys.argv[:] = [executable, *arguments]
    return int(importlib.import_module(modules[executable]).main())
