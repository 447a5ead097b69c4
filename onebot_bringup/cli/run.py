"""``onebot run PACKAGE EXECUTABLE ...``: runs a node or bringup, like ``ros2 run``.

``onebot run FILE.py ...`` runs any node from its file, which need not be installed.
"""

import ast
import importlib
import os
import re
import runpy
import signal
import sys
from collections.abc import Sequence
from pathlib import Path

from onebot_bringup.launch.nodes import BRINGUPS, NODES
from onebot_description.elements.packages import use_source_packages
from onebot_description.errors import OneBotError, UsageError, did_you_mean
from onebot_description.ros.discovery import use_local_discovery
from onebot_description.ros.process_start import blas_variables

# Module of each executable by package and name, as installed by the packages' CMakeLists.txt.
EXECUTABLES: dict[str, dict[str, str]] = {}
for module in (*(row.module for row in NODES), *BRINGUPS.values()):
    EXECUTABLES.setdefault(module.partition(".")[0], {})[module.rpartition(".")[2]] = module

# Distributions by the module that they are imported by, where the names differ.
_DISTRIBUTIONS = {
    **{"cv2": "opencv-python", "PIL": "pillow", "yaml": "PyYAML", "serial": "pyserial"},
    **{"sklearn": "scikit-learn", "skimage": "scikit-image", "usb": "pyusb", "smbus": "smbus2"},
}
_ROS_1 = "rospy", "roslib", "tf", "actionlib", "dynamic_reconfigure"
_INTERFACES = re.compile(r"\w+_(msgs|srvs|actions?|interfaces)")
_OF_ROS = re.compile(
    r"(ament|launch|ros|rcl|rqt|tf2|nav2|moveit|image_|laser_|control|diagnostic_|interactive_)\w*|PyKDL"
)


def run(argv: Sequence[str]) -> int:
    """Run the executable and return its exit code."""
    if argv and argv[0] in ("-h", "--help"):
        print("usage: onebot run PACKAGE EXECUTABLE [ARGUMENT ...] [--ros-args ...]")
        print("       onebot run FILE.py [ARGUMENT ...] [--ros-args ...]\n")
        print("Runs any node from its Python file, or a node or a bringup of these packages:")
        for package, executables in EXECUTABLES.items():
            print("".join(f"  {package} {executable}\n" for executable in executables), end="")
        return 0
    if argv and argv[0].endswith(".py"):
        return run_file(Path(argv[0]), argv[1:])
    if len(argv) < 2:
        raise UsageError("onebot run takes a package, an executable and its arguments, or a file")
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


def run_file(file: Path, arguments: Sequence[str]) -> int:
    """Run a node from its file as ``__main__``, and its function ``main`` if it does not call that.

    A file of a Python package is run as its module, so it may import its neighbors. A file with
    relative imports is in a package, even if that lacks ``__init__.py``.
    """
    if not file.is_file():
        raise UsageError(f"there is no file {file}")
    use_local_discovery()
    use_source_packages(file)
    # The node handles Ctrl-C itself; a background job of a shell goes on ignoring it.
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    sys.argv[:] = [str(file), *arguments]
    tree = ast.parse(file.read_bytes(), file)
    imports = [node.level for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    top, names = file.resolve().parent, [file.stem]
    while len(names) <= max(imports, default=0) or (top / "__init__.py").is_file():
        names.insert(0, top.name)
        top = top.parent
    sys.path.insert(0, str(top))
    try:
        if names[1:]:
            members = runpy.run_module(".".join(names), run_name="__main__", alter_sys=True)
        else:
            members = runpy.run_path(str(file), run_name="__main__")
        if "main" in members and not _calls_main(tree):  # setup.py names it as an entry point
            return int(members["main"]() or 0)
    except OneBotError:
        raise
    except ImportError as error:
        if error.name is None:
            raise
        raise OneBotError(f"{file}: {_explain(error)}") from error
    return 0


def _calls_main(tree: ast.Module) -> bool:
    """Whether the file itself calls its function ``main``, as below ``if __name__ == ...``."""
    return any(
        isinstance(node, ast.Name) and node.id == "main"
        for statement in tree.body
        if isinstance(statement, (ast.If, ast.Expr, ast.Try))
        for node in ast.walk(statement)
    )


def _explain(error: ImportError) -> str:
    """Return which package is missing, and where it comes from."""
    name = str(error.name)
    if not isinstance(error, ModuleNotFoundError) or "." in name:  # part of an installed package
        return str(error)
    apt = f"with an installed ROS 2: apt install ros-jazzy-{name.lower().replace('_', '-')}"
    sources = "add the folder of its Python sources to PYTHONPATH"
    if name in _ROS_1:
        return f'it imports "{name}", a package of ROS 1: it is not a node of ROS 2'
    if _INTERFACES.fullmatch(name):
        return (
            f'there are no interfaces "{name}" here: get the sources of that package and run '
            f"`onebot interface add FOLDER`; {apt}"
        )
    if _OF_ROS.fullmatch(name):
        return f'there is no package "{name}" here, and pip has none: {sources}; {apt}'
    distribution = _DISTRIBUTIONS.get(name, name)
    return f'there is no module "{name}" here: pip install {distribution}, or {sources}'
