"""Tab completion: what the shell's functions get from the commands."""

import json
import os
import sys
from collections.abc import Iterable
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from geometry_msgs.msg import TransformStamped
from std_msgs.msg import String

from onebot_bringup.cli.verbs import VERBS
from onebot_description.ros.wire.interfaces import TFMessage
from tests.onebot_bringup.cli_support import MODULE, onebot, output_of
from tests.ros_support import LATCHED, Peer
from tests.support import run_to_end

ROBOT = Path(__file__).parents[2] / "mrm_description/urdf/mrm.xacro"


BRINGUP = "onebot_bringup.launch.onebot_bringup"
MRM = "mrm_description.launch.mrm_bringup"
WORDS = {
    "onebot to": {"topic"},
    "onebot topic e": {"echo"},
    "onebot topic pub /x geometry_msgs/msg/TwistS": {"geometry_msgs/msg/TwistStamped"},
    "onebot service call /x std_srvs/srv/Tr": {"std_srvs/srv/Trigger"},
    "onebot run onebot_c": {"onebot_control"},
    "onebot run onebot_control ": {
        *("velocity_controller", "joint_trajectory_controller", "navigator"),
    },
    "onebot completion ": {"bash", "zsh", "fish"},
    "onebot run onebot_control velocity_controller ": set(),  # it must not run
    "onebot discovery:=subnet topic e": {"echo"},
    "onebot check ": {"package_path:=", "arm.urdf"},
    "onebot_bringup viewer:=na": {"viewer:=native"},
    "onebot_bringup world:=": {"world:=maze", "world:=ramp"},
    "onebot_bringup world:=a": {"world:=arm.urdf"},
    "onebot_bringup sim": {"sim:=true", "sim:=false"},
    "/bin/mrm_bringup robo": set(),
    f"onebot view {ROBOT} relo": {"reload:=true", "reload:=false"},
    "onebot replay run fix": {"fixed_frame:="},
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


def completed(lines: Iterable[str]) -> dict[str, set[str]]:
    """What argcomplete's function of a shell gets for lines whose end Tab is pressed at."""
    modules = {"onebot_bringup": BRINGUP, "mrm_bringup": MRM}
    asked = [(line, modules.get(Path(line.split()[0]).name, MODULE)) for line in lines]
    found = {}
    with TemporaryDirectory() as folder:
        done = run_to_end([sys.executable, "-c", COMPLETE, json.dumps(asked), folder])
        assert done.returncode == 0 and "Traceback" not in done.stderr, done.stderr
        for number, (line, _) in enumerate(asked):
            file = Path(folder, str(number))
            words = file.read_text().splitlines() if file.exists() else []
            found[line] = {word.strip() for word in words}
    return found


def test_words(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Commands, subcommands, options, types; launch arguments with their choices, and files."""
    (tmp_path / "arm.urdf").touch()
    monkeypatch.chdir(tmp_path)
    assert completed(WORDS) == WORDS


def test_every_command() -> None:
    """A command that is added is completed, and none runs for it."""
    options = completed([f"onebot {verb} --" for verb in VERBS])
    others = [line.removesuffix("--") for line, words in options.items() if not words]
    assert [line for line, words in completed(others).items() if not words] == []


def test_running_topics(ros_domain: int) -> None:
    """Names of what is discovered."""
    with Peer(ros_domain, "talker") as peer:
        peer.node.create_publisher(String, "/words", 10)
        peer.node.declare_parameter("speed", 1.0)
        message = TFMessage(transforms=[TransformStamped(child_frame_id="left_wheel")])
        message.transforms[0].header.frame_id = "base_link"
        peer.node.create_publisher(TFMessage, "/tf_static", LATCHED).publish(message)
        lines = {
            "onebot topic echo /wo": {"/words"},
            "onebot node info /t": {"/talker"},
            "onebot param get /talker sp": {"speed"},
            "onebot tf echo base_link le": {"left_wheel"},
        }
        assert completed(lines) == lines


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
    done = run_to_end(["bash", "-c", script], env=os.environ | {"PATH": path})
    assert done.stdout.split() == ["-F", "_python_argcomplete", "info"], done.stderr
    assert "compdef" in output_of("completion", "zsh")
    assert "complete --command mrm_bringup" in output_of("completion", "fish")
    assert onebot("completion", "tcsh").returncode == 2
