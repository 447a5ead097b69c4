"""The image of the Dockerfile has what it needs; that the README shows it, test_readme tests."""

import json
import re
import sys

from packaging.specifiers import SpecifierSet

from tests.readme import CHECKOUT

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

PROJECT = tomllib.loads((CHECKOUT / "pyproject.toml").read_text())["project"]
TEXT = (CHECKOUT / "Dockerfile").read_text()
INSTRUCTIONS = [line.split(maxsplit=1) for line in TEXT.splitlines()]


def test_the_image_is_a_python_that_needs_no_compiler_and_starts_a_command_of_ours():
    """All dependencies have wheels for it (.ci/pythons); JSON, so that signals reach it."""
    assert [name for name, _ in INSTRUCTIONS] == ["FROM", "COPY", "RUN", "CMD"]
    image, copied, run, command = (rest for _, rest in INSTRUCTIONS)
    version = re.fullmatch(r"python:(3\.\d+)-slim", image)
    assert version and version[1] in SpecifierSet(PROJECT["requires-python"])
    assert copied.split()[0] == "." and copied.split()[1] in run
    assert {".git", ".venv"} <= set((CHECKOUT / ".dockerignore").read_text().split())
    assert json.loads(command)[0] in PROJECT["scripts"]
