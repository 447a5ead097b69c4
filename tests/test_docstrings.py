"""The samples in docstrings run, and print what they say."""

import doctest
import importlib

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
