"""The Dockerfile keeps to the rules of hadolint, and is the one that the README shows."""

import json
import re
import shlex
import sys
from pathlib import Path

from packaging.specifiers import SpecifierSet

from tests.support import run_to_end

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

CHECKOUT = Path(__file__).resolve().parent.parent
README = (CHECKOUT / "README.md").read_text()
PROJECT = tomllib.loads((CHECKOUT / "pyproject.toml").read_text())["project"]
TEXT = (CHECKOUT / "Dockerfile").read_text()
# Each instruction and its arguments; a backslash continues a line.
INSTRUCTIONS = [line.split(maxsplit=1) for line in TEXT.replace("\\\n", " ").splitlines()]


def _arguments(instruction: str) -> list[str]:
    return [rest for name, rest in INSTRUCTIONS if name == instruction]


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


def test_base_image_is_a_pinned_python_that_needs_no_compiler():
    """Rules DL3006 and DL3007; the README names the Pythons that pybullet has wheels for."""
    [image] = _arguments("FROM")
    version = re.fullmatch(r"python:(3\.\d+)-slim", image)
    assert version and version[1] in SpecifierSet(PROJECT["requires-python"])
    [best] = re.findall(r"best (3\.\d+) or (3\.\d+)", README)
    assert version[1] in best
    assert INSTRUCTIONS[0][0] == "FROM"


def test_instructions_are_the_plain_ones():
    """Rules DL3020 (no ADD), DL3004 (no sudo), DL3000 and DL3045 (absolute paths)."""
    assert {name for name, _ in INSTRUCTIONS} <= {"FROM", "COPY", "RUN", "CMD"}
    assert "sudo" not in TEXT
    assert all(rest.split()[-1].startswith("/") for rest in _arguments("COPY"))


def test_pip_installs_what_is_copied():
    """Rule DL3042 (no cache); a checkout's environment and history stay out of the image."""
    [copied] = _arguments("COPY")
    source, target = copied.split()
    [run] = map(shlex.split, _arguments("RUN"))
    assert source == "." and run == ["pip", "install", "--no-cache-dir", target]
    assert {".git", ".venv"} <= set((CHECKOUT / ".dockerignore").read_text().split())


def test_command_is_one_of_ours():
    """Rule DL3025 (JSON, so that signals reach it); its arguments are known."""
    [text] = _arguments("CMD")
    program, *arguments = json.loads(text)
    assert INSTRUCTIONS[-1][0] == "CMD"
    module = PROJECT["scripts"][program].partition(":")[0]
    shown = run_to_end([sys.executable, "-m", module, "--show-args"], check=True)
    known = re.findall(r"^ *(\w+):=", shown.stdout, re.MULTILINE)
    assert {argument.partition(":=")[0] for argument in arguments} <= {*known}
