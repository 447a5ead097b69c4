"""The Dockerfile is the one that the README shows, and its image has what it needs."""

import json
import re
import sys

from packaging.specifiers import SpecifierSet

from tests.readme import CHECKOUT

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

README = (CHECKOUT / "README.md").read_text()
PROJECT = tomllib.loads((CHECKOUT / "pyproject.toml").read_text())["project"]
TEXT = (CHECKOUT / "Dockerfile").read_text()
INSTRUCTIONS = [line.split(maxsplit=1) for line in TEXT.splitlines()]


def test_the_readme_shows_the_whole_file():
    """And builds and runs an image of one name, in the folder that has the file."""
    assert f"<!-- file: Dockerfile -->\n```dockerfile\n{TEXT}```" in README
    assert README.count("```dockerfile") == 1 and "[Dockerfile](Dockerfile)" in README
    [(built, context)] = re.findall(r"docker build -t (\S+) (\S+)", README)
    [options, run] = re.findall(r"docker run (.*?) (\w+)`", README)[0]
    assert run == built and context == "."
    # As root of a terminal, whose Ctrl-C is passed on; DDS and servers are those of the computer.
    assert {"--rm", "-it", "--init", "--network host", "--ipc host"} <= {
        *options.split(),
        *re.findall(r"--\w+ \w+", options),
    }


def test_the_image_is_a_python_that_needs_no_compiler_and_starts_a_command_of_ours():
    """The README names the Pythons that pybullet has wheels for; JSON, so that signals reach it."""
    assert [name for name, _ in INSTRUCTIONS] == ["FROM", "COPY", "RUN", "CMD"]
    image, copied, run, command = (rest for _, rest in INSTRUCTIONS)
    version = re.fullmatch(r"python:(3\.\d+)-slim", image)
    assert version and version[1] in SpecifierSet(PROJECT["requires-python"])
    assert version[1] in re.search(r"best (3\.\d+ or 3\.\d+)", README)[1]
    assert copied.split()[0] == "." and copied.split()[1] in run
    assert {".git", ".venv"} <= set((CHECKOUT / ".dockerignore").read_text().split())
    assert json.loads(command)[0] in PROJECT["scripts"]
