"""Runs test suites of others, unmodified: ``python -m tests.peer_suites FOLDER``.

FOLDER has checkouts of the repositories in ``SUITES``, of ROS 2 Jazzy, by their names. Each file
runs in a process of its own; a row says what came of it.
"""

import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

from onebot_description.ros.domains import used_domain

SUITES = {
    "geometry2": (
        "tf2_py/test/test_buffer_core.py",
        "tf2_ros_py/test/test_buffer.py",
        "tf2_ros_py/test/test_buffer_client.py",
        "tf2_ros_py/test/test_listener_and_broadcaster.py",
        "tf2_geometry_msgs/test/test_tf2_geometry_msgs.py",
        "tf2_sensor_msgs/test/test_tf2_sensor_msgs.py",
    ),
    "message_filters": (
        "test/directed.py",
        "test/test_approxsync.py",
        "test/test_message_filters_cache.py",
    ),
    "common_interfaces": ("sensor_msgs_py/test/test_point_cloud2.py",),
    "tf_transformations": ("test/test_transformations.py",),
    "angles": ("angles/test/utest.py",),
}
_PYTEST = (
    "import sys, onebot_description, pytest; "
    "sys.exit(pytest.main(['-q', '-p', 'no:cacheprovider', '--import-mode=importlib', '-p', "
    "'no:onebot_bringup.testing.plugin', '-c', '/dev/null', sys.argv[1]]))"
)


def outcome(file: Path, aliases: Path) -> tuple[bool, str]:
    """Return whether the tests of a file pass, and pytest's last line."""
    with used_domain():
        run = subprocess.run(
            [sys.executable, "-c", _PYTEST, str(file)],
            capture_output=True,
            text=True,
            timeout=600,
            env={**os.environ, "PYTHONPATH": f"{os.getcwd()}:{aliases}"},
        )
    last = (run.stdout.strip() or run.stderr.strip()).splitlines()[-1]
    return run.returncode == 0, re.sub(r" in [0-9.]+s.*", "", last)


def main(folder: Path) -> int:
    """Print a row for each file; return how many failed."""
    failures = 0
    print("| Repository | Tests | Outcome |\n|---|---|---|")
    with tempfile.TemporaryDirectory() as aliases:
        # The build of tf2_py puts the module that is tested there.
        package = Path(aliases, "test_tf2_py")
        package.mkdir()
        (package / "__init__.py").touch()
        (package / "_tf2_py.py").write_text("from tf2_py._tf2_py import *\n")
        for repository, files in SUITES.items():
            for file in files:
                passed, text = outcome(folder / repository / file, Path(aliases))
                failures += not passed
                print(f"| {repository} | {file} | {text} |", flush=True)
    return failures


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    sys.exit(main(Path(sys.argv[1])))
