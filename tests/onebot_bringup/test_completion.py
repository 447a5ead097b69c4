"""Tab completion: what the shell's functions get from the commands."""

import json
import os
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path

from std_msgs.msg import String

from onebot_bringup.cli.completion import launch_words
from tests.onebot_bringup.cli_support import MODULE, onebot, output_of
from tests.ros_support import Peer

ROBOT = Path(__file__).parents[2] / "mrm_description/urdf/mrm.xacro"


BRINGUP = "onebot_bringup.launch.onebot_bringup"
MRM = "mrm_description.launch.mrm_bringup"
WORDS = {
    "onebot to": {"topic"},
    "onebot topic e": {"echo"},
    "onebot topic echo --flow": {"--flow-style"},
    "onebot topic pub /x geometry_msgs/msg/TwistS": {"geometry_msgs/msg/TwistStamped"},
    "onebot service call /x std_srvs/srv/Tr": {"std_srvs/srv/Trigger"},
    "onebot tf ": {"tree", "echo"},
    "onebot run onebot_c": {"onebot_control"},
    "onebot run onebot_control ": {"velocity_controller"},
    "onebot completion ": {"bash", "zsh", "fish"},
    "onebot doctor --c": {"--clean"},
    "onebot nothing ": set(),
    "onebot topic nothing ": set(),
    "onebot run onebot_control velocity_controller ": set(),  # it must not run
    "onebot_bringup viewer:=na": {"viewer:=native"},
    "/bin/mrm_bringup ste": set(),
    "mrm_bringup names": {"namespace:="},
    f"onebot view {ROBOT} relo": {"reload:=true", "reload:=false"},
    "onebot replay run fra": {"frame_prefix:="},
}
# Each completion ends its process: they are forks of one that has imported what is slow.
COMPLETE = """
import importlib, json, os, sys
from onebot_bringup.cli import completion
for number, (line, module) in enumerate(json.loads(sys.argv[1])):
    if not os.fork():
        os.environ |= {
            "_ARGCOMPLETE": "1",
            "_ARGCOMPLETE_STDOUT_FILENAME": f"{sys.argv[2]}/{number}",
            "_ARGCOMPLETE_IFS": "\\n",
            "COMP_LINE": line,
            "COMP_POINT": str(len(line.encode())),
        }
        importlib.import_module(module).main()
    os.wait()
"""


def completed(lines: Iterable[str], folder: Path) -> dict[str, set[str]]:
    """What argcomplete's function of a shell gets for lines whose end Tab is pressed at."""
    modules = {"onebot_bringup": BRINGUP, "mrm_bringup": MRM}
    asked = [(line, modules.get(Path(line.split()[0]).name, MODULE)) for line in lines]
    done = subprocess.run(
        [sys.executable, "-c", COMPLETE, json.dumps(asked), str(folder)],
        capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0 and "Traceback" not in done.stderr, done.stderr
    found = {}
    for number, (line, _) in enumerate(asked):
        file = folder / str(number)
        words = file.read_text().splitlines() if file.exists() else []
        found[line] = {word.strip() for word in words}
    return found


def test_words(tmp_path: Path) -> None:
    """Commands, subcommands, options, types; launch arguments with their choices."""
    assert completed(WORDS, tmp_path) == WORDS


def test_running_topics(ros_domain: int, tmp_path: Path) -> None:
    """Names of what is discovered."""
    with Peer(ros_domain, "talker") as peer:
        peer.node.create_publisher(String, "/words", 10)
        lines = {"onebot topic echo /wo": {"/words"}, "onebot node info /t": {"/talker"}}
        assert completed(lines, tmp_path) == lines


def test_launch_words() -> None:
    """Of what --show-args prints: switches and choices with their values."""
    listed = (
        "  viewer:=web    where (web, none)\n"
        "  reload:=true   edits\n"
        "  reach:=1.0\n"
        "  params_file:=/a/long/path.yaml\n"
        "                 a file (x y)\n"
    )
    assert launch_words(listed) == {
        "viewer:=web": "where (web, none)",
        "viewer:=none": "where (web, none)",
        "reload:=true": "edits",
        "reload:=false": "edits",
        "reach:=": "",
        "params_file:=": "a file (x y)",
    }


def test_in_bash(tmp_path: Path) -> None:
    """The printed code, evaluated by bash, completes a line in it; every shell has its code."""
    program = tmp_path / "onebot"
    program.write_text(f'#!/bin/sh\nexec {sys.executable} -m {MODULE} "$@"\n')
    program.chmod(0o755)
    script = (
        'eval "$(onebot completion bash)"\n'
        'COMP_LINE="onebot topic inf" COMP_POINT=16 COMP_TYPE=9\n'
        'complete -p onebot | grep -o -- "-F [a-z_]*"\n'
        '_python_argcomplete onebot\necho "${COMPREPLY[0]}"'
    )
    path = f"{tmp_path}:{os.environ['PATH']}"
    done = subprocess.run(
        ["bash", "-c", script], env=os.environ | {"PATH": path}, capture_output=True, text=True
    )
    assert done.stdout.split() == ["-F", "_python_argcomplete", "info"], done.stderr
    assert "compdef" in output_of("completion", "zsh")
    assert "complete --command mrm_bringup" in output_of("completion", "fish")
    assert onebot("completion", "tcsh").returncode == 2
