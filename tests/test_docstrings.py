"""The samples in docstrings run, and print what they say."""

import doctest
import importlib
import pydoc
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.readme import CHECKOUT

pytestmark = pytest.mark.checkout

PACKAGES = ("onebot_description", "onebot_control", "onebot_bringup", "mrm_description")
APART = "onebot_control/environment.py"  # needs an extra; its own test runs it
FILES = sorted(
    path.relative_to(CHECKOUT)
    for package in PACKAGES
    for path in (CHECKOUT / package).rglob("*.py")
    if ">>>" in path.read_text(encoding="utf-8") and not str(path).endswith(APART)
)


@pytest.mark.parametrize("file", [*map(str, FILES)])
def test_samples_run(file: str) -> None:
    name = file.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
    found = doctest.testmod(importlib.import_module(name))
    assert found.attempted and not found.failed


# Exported, but not by ``import *``: they need ROS or an extra.
OTHERS = {"onebot_control": {"Lockstep", "OneBotEnv"}}
DOCUMENTED = ("onebot_control", "onebot_control.evaluation", "onebot_description")


@pytest.mark.parametrize("package", ["onebot_control", "onebot_description"])
def test_help_lists_what_the_package_exports(package: str) -> None:
    """With a line for each; classes and functions follow with their docstrings."""
    module = importlib.import_module(package)
    text = pydoc.plain(pydoc.render_doc(module))
    names = {*module.__all__} - {"__version__"}
    listed = " ".join(re.findall(r"^ *- (``.*?)[:.] ", text, re.MULTILINE))
    assert {*re.findall(r"``(\w+)``", listed)} == names | OTHERS.get(package, set())
    assert {
        name for name in names if not re.search(rf"^    (class )?{name}\(", text, re.M)
    } == set()


def test_pdoc_renders_what_the_packages_export(tmp_path: Path) -> None:
    """Each exported class and function has its docstring in it, and nothing is warned of."""
    command = [sys.executable, "-W", "error", "-m", "pdoc", "-o", str(tmp_path), *DOCUMENTED]
    done = subprocess.run(command, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    for package in DOCUMENTED:
        page = (tmp_path / f"{package.replace('.', '/')}.html").read_text()
        for name in {*importlib.import_module(package).__all__, *OTHERS.get(package, set())}:
            if name != "__version__":
                pattern = rf'<section id="{name}">.*?<div class="docstring">.*?</section>'
                assert re.search(pattern, page, re.DOTALL), name
        assert ">Arguments:</h6>" in page  # sections are rendered
