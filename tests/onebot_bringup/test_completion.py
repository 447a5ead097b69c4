"""Tab completion: what the shell's functions get from the commands."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from std_msgs.msg import String

from onebot_bringup.cli.completion import launch_words
from tests.onebot_bringup.cli_support import MODULE, onebot, output_of
from tests.ros_support import Peer

ROBOT = Path(__file__).parents[2] / "mrm_description/urdf/mrm.xacro"


def completed(line: str, folder: Path, module: str = MODULE) -> set[str]:
    """What argcomplete's function of a shell gets for a line whose end Tab is pressed at."""
    file = folder / "out"
    file.touch()
    variables = {
        "_ARGCOMPLETE": "1",
        "_ARGCOMPLETE_STDOUT_FILENAME": str(file),
        "_ARGCOMPLETE_IFS": "\n",
        "COMP_LINE": line,
        "COMP_POINT": str(len(line)),
    }
    done = subprocess.run(
        [sys.executable, "-m", module], env=os.environ | variables, capture_output=True, text=True
    )
    assert "Traceback" not in done.stderr, done.stderr
    return {word.strip() for word in file.read_text().splitlines()}


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("onebot to", {"topic"}),
        ("onebot topic e", {"echo"}),
        ("onebot topic echo --flow", {"--flow-style"}),
        ("onebot topic pub /x geometry_msgs/msg/TwistS", {"geometry_msgs/msg/TwistStamped"}),
        ("onebot service call /x std_srvs/srv/Tr", {"std_srvs/srv/Trigger"}),
        ("onebot tf ", {"tree", "echo", "monitor"}),
        ("onebot run onebot_c", {"onebot_control"}),
        ("onebot run onebot_control ", {"velocity_controller"}),
        ("onebot completion ", {"bash", "zsh", "fish"}),
        ("onebot doctor --c", {"--clean"}),
        ("onebot nothing ", set()),
        ("onebot topic nothing ", set()),
        ("onebot run onebot_control velocity_controller ", set()),  # it must not run
    ],
)
def test_words(tmp_path: Path, line: str, expected: set[str]) -> None:
    """Commands, subcommands, options, types."""
    assert completed(line, tmp_path) == expected


@pytest.mark.parametrize(
    ("line", "module", "expected"),
    [
        ("onebot_bringup viewer:=na", "onebot_bringup.launch.onebot_bringup", {"viewer:=native"}),
        ("/bin/mrm_bringup ste", "mrm_description.launch.mrm_bringup", set()),
        ("mrm_bringup names", "mrm_description.launch.mrm_bringup", {"namespace:="}),
        (f"onebot view {ROBOT} relo", MODULE, {"reload:=true", "reload:=false"}),
        ("onebot replay run fra", MODULE, {"frame_prefix:="}),
    ],
)
def test_launch_arguments(tmp_path: Path, line: str, module: str, expected: set[str]) -> None:
    """Names with their choices, in place of a bringup that starts."""
    assert completed(line, tmp_path, module) == expected


def test_running_topics(ros_domain: int, tmp_path: Path) -> None:
    """Names of what is discovered."""
    with Peer(ros_domain, "talker") as peer:
        peer.node.create_publisher(String, "/words", 10)
        assert completed("onebot topic echo /wo", tmp_path) == {"/words"}
        assert completed("onebot node info /t", tmp_path) == {"/talker"}


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
