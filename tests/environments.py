"""Environments of Python without the checkout: built and installed as a user's are."""

import os
import shutil
import site
import subprocess
import sys
import venv
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parent.parent


def environment_without_ros_variables() -> dict[str, str]:
    """The variables of this process, without those that lead to its packages."""
    dropped = (
        "PYTHONPATH",
        "AMENT_PREFIX_PATH",
        "_ROS_WHEELS_BOOTSTRAP_COMPLETE",
        "LD_LIBRARY_PATH",
    )
    return {name: value for name, value in os.environ.items() if name not in dropped}


def copy_of_checkout(folder: Path) -> Path:
    """A copy of what a build needs."""
    ignore = shutil.ignore_patterns(".*", "__pycache__", "*.so", "tests")
    copy = shutil.copytree(CHECKOUT, folder / "checkout", ignore=ignore)
    shutil.copy(CHECKOUT / ".gitignore", copy)
    return Path(copy)


def fresh_environment(folder: Path) -> Path:
    """An environment without this project, whose dependencies are those of the running one."""
    venv.create(folder / "venv", with_pip=False)
    python = folder / "venv/bin/python"
    target = next((folder / "venv/lib").glob("python*/site-packages"))
    # addsitedir would run the .pth files of an editable install of this project: only add the path.
    (target / "dependencies.pth").write_text("\n".join(site.getsitepackages()) + "\n")
    return python


def install(python: Path, *args: str) -> None:
    """Install by pip, without dependencies."""
    pip = [sys.executable, "-m", "pip", "--python", str(python), "install", "-q", "--no-deps"]
    subprocess.run([*pip, *args], check=True, env=environment_without_ros_variables())


def build(project: Path, target: str, folder: Path) -> Path:
    """Make the "sdist" or the "wheel" of a project's folder."""
    command = [sys.executable, "-m", "hatchling", "build", "-t", target, "-d", str(folder)]
    subprocess.run(command, cwd=project, check=True)
    (made,) = folder.iterdir()
    return made
