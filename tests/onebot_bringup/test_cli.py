"""The ``onebot`` command, run as its users run it."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from onebot_bringup.cli.main import main
from onebot_bringup.cli.run import EXECUTABLES, run
from onebot_bringup.cli.verbs import VERBS
from onebot_description.errors import UsageError
from tests.onebot_bringup.cli_support import onebot, running
from tests.ros_support import Peer
from tests.support import lines_of_ours, wait_for

ROBOTS = Path(__file__).parents[1] / "robots"
ARM = (ROBOTS / "xacro_arm.xacro").read_text()


@pytest.fixture
def arm(tmp_path: Path) -> str:
    (tmp_path / "arm.xacro").write_text(ARM)
    return str(tmp_path / "arm.xacro")


@pytest.mark.parametrize(
    ("words", "code", "out", "err"),
    [
        (["--help"], 0, "usage: onebot ", ""),
        (["help"], 0, "usage: onebot ", ""),
        (["check", "--help"], 0, "usage: onebot check FILE", ""),
        (["help", "check"], 0, "usage: onebot check FILE", ""),
        (["topic", "--help"], 0, "usage: onebot topic COMMAND", ""),
        (["help", "topic", "pub"], 0, "usage: onebot topic pub ", ""),
        (["--version"], 0, "onebot ", ""),
        ([], 2, "", "usage: onebot "),
        (["chekc"], 2, "", 'error: onebot has no command "chekc" (did you mean "check"?'),
        (["topic"], 2, "", "error: onebot topic what? (pub, echo, list"),
        (["topic", "lst"], 2, "", 'error: onebot topic has no command "lst" (did you mean "list"?'),
        (["topic", "hz", "-w", "-1", "/x"], 2, "", "error: onebot topic hz: argument -w/--window"),
        (["check"], 2, "", "error: onebot check takes one file, not 0"),
        (["check", "--all", "a"], 2, "", 'error: no option "--all"'),
        (["check", "/no/such/robot.urdf"], 1, "", "error: /no/such/robot.urdf"),
        (["trajectory", "--help"], 0, "usage: onebot trajectory [JOINT=POSITION ...]", ""),
    ],
)
def test_words(words: list[str], code: int, out: str, err: str) -> None:
    """Help goes to standard output; a mistake is one error, with where to read more."""
    done = onebot(*words)
    assert done.returncode == code
    assert done.stdout.startswith(out) and bool(done.stdout) == bool(out)
    assert done.stderr.startswith(err) and bool(done.stderr) == bool(err)
    if code == 2 and words:
        names = words[:2] if words[:2] == ["topic", "hz"] else words[: words[0] in VERBS]
        assert done.stderr.splitlines()[-1] == " ".join(["see: onebot", *names, "--help"])


def test_run(peer: Peer, tmp_path: Path) -> None:
    """A node is run by its package and name, with its arguments, until Ctrl-C."""
    file = tmp_path / "robot.urdf"
    file.write_text('<robot name="r"><link name="base"/></robot>')
    words = ("run", "onebot_description", "robot_state_publisher", str(file))
    with running(tmp_path, *words, "--ros-args", "-r", "__node:=mine") as node:
        wait_for(lambda: "mine" in peer.node.get_node_names(), "the node")
        assert node.interrupt() == 0 and not lines_of_ours(node.err)


def test_executables() -> None:
    """Those of each package are those that its CMakeLists.txt installs for ros2 run."""
    for package, modules in EXECUTABLES.items():
        text = (ROBOTS.parents[1] / package / "CMakeLists.txt").read_text()
        named = set(re.findall(r"RENAME (\w+)\)", text)) - {"onebot"}
        for names in re.findall(r"foreach\(node ([\w ]+)\)", text):
            named |= set(names.split())
        assert named == set(modules)
    for words, part in {
        ("onebot_bringup", "viewer"): 'did you mean "onebot_bringup rerun_viewer"',
        ("onebot_bringup",): "takes a package, an executable",
    }.items():
        with pytest.raises(UsageError) as error:
            run(words)
        assert part in str(error.value)


@pytest.mark.parametrize(
    ("verb", "words", "code", "parts"),
    [
        ("check", ["height:=2.5"], 0, ["arm", "base", "tip", "shoulder"]),
        ("check", ["heigth:=2"], 1, ['did you mean "height"?']),
        ("check", ["--show-args"], 0, ["height:=1.0"]),
        ("view", ["--show-args"], 0, ["viewer:=web", "height:=1.0"]),
    ],
)
def test_a_robot_with_arguments(
    arm: str, verb: str, words: list[str], code: int, parts: list[str]
) -> None:
    """Xacro's arguments are taken, listed, and refused with the nearest name."""
    done = onebot(verb, arm, *words)
    text, silent = (done.stderr, done.stdout) if code else (done.stdout, done.stderr)
    assert done.returncode == code and all(part in text for part in parts) and not silent


@pytest.mark.parametrize("kind", ["velocity", "effort", "position"])
def test_check_names_interfaces_that_are_not_simulated(arm: str, kind: str) -> None:
    """In the words with which the simulation refuses them."""
    command = f'<joint name="shoulder"><command_interface name="{kind}"/></joint>'
    block = f'<ros2_control name="s" type="system">{command}</ros2_control>'
    Path(arm).write_text(ARM.replace("</robot>", f"{block}</robot>"))
    done = onebot("check", arm)
    text = f"joint shoulder: <ros2_control> has only the command interface {kind}, which cannot be"
    assert done.returncode == 0 and (text in done.stderr) == (kind != "position")


def test_settings_before_the_command(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is discovered can be said for any command; a mistake is one error."""
    names = ("ROS_DISCOVERY_SERVER", "ROS_AUTOMATIC_DISCOVERY_RANGE", "ROS_DOMAIN_ID")
    for name in names:
        monkeypatch.setenv(name, "")
    assert main(["discovery:=10.0.0.7:11811", "domain_id:=7", "--version"]) == 0
    assert [os.environ[name] for name in names] == ["10.0.0.7:11811", "SUBNET", "7"]
    for word, error in (
        ("discovery:=subnett", "write localhost, subnet, or HOST:PORT of a discovery server"),
        ("discovry:=subnet", 'did you mean "discovery"'),
        ("domain_id:=233", "write an integer from 0 to 232"),
    ):
        done = onebot(word, "topic", "list")
        assert done.returncode == 2 and error in done.stderr
    assert main(["discovery:=localhost"]) == 2 and os.environ["ROS_DISCOVERY_SERVER"] == ""


@pytest.mark.parametrize("home", ["/dev/null", None])
def test_check_works_without_a_home_or_a_locale(tmp_path: Path, home: str | None) -> None:
    """Nor does it need a folder that can be written; what cannot be shown is escaped."""
    file = tmp_path / "r\N{LATIN SMALL LETTER E WITH ACUTE}.xacro"
    text = ARM.replace('"arm"', '"\N{RIGHT-TO-LEFT OVERRIDE}arm"').replace('"base"', '"ba&#155;se"')
    file.write_text(text, encoding="utf-8")
    limited = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    environment = {name: value for name, value in os.environ.items() if name != "HOME"}
    environment |= limited | ({"HOME": home, "PYTHONIOENCODING": "ascii"} if home else {})
    environment |= {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    done = subprocess.run(
        [sys.executable, "-m", "onebot_bringup.cli.main", "check", os.fsencode(file)],
        capture_output=True,
        cwd="/proc",
        env=environment,
        timeout=180,
    )
    assert done.returncode == 0 and b"Traceback" not in done.stderr, done.stderr
    assert done.stdout.startswith(b"\\u202earm  (") and b"ba\\x9bse" in done.stdout
    assert b"shoulder" in done.stdout


def test_a_reader_that_leaves_is_no_error(arm: str) -> None:
    """``onebot check x | head -0`` prints no traceback."""
    read, write = os.pipe()
    os.close(read)
    done = subprocess.run(
        [sys.executable, "-m", "onebot_bringup.cli.main", "check", arm],
        stdout=write,
        stderr=subprocess.PIPE,
        timeout=180,
    )
    os.close(write)
    assert done.returncode == 141 and done.stderr == b""


def test_check_opens_the_meshes_and_takes_a_package_path(tmp_path: Path) -> None:
    """A package elsewhere is found where ``package_path:=`` says; what is in it must be a mesh."""
    parts = tmp_path / "elsewhere/parts"
    parts.mkdir(parents=True)
    (parts / "package.xml").write_text("<package><name>parts</name></package>")
    mesh = '<geometry><mesh filename="package://parts/a.stl"/></geometry>'
    (tmp_path / "r.urdf").write_text(
        f'<robot name="r"><link name="a"><visual>{mesh}</visual></link></robot>'
    )
    words = ("check", str(tmp_path / "r.urdf"))
    done = onebot(*words)
    assert done.returncode == 1 and done.stdout == "" and "package_path:=FOLDER" in done.stderr
    cube = (ROBOTS / "meshes/cube.stl").read_bytes()
    pointer = b"version https://git-lfs.github.com/spec/v1"
    for content, code, text in ((pointer, 1, "git lfs pull"), (cube, 0, "1 mesh")):
        (parts / "a.stl").write_bytes(content)
        done = onebot(*words, f"package_path:={tmp_path / 'elsewhere'}")
        assert done.returncode == code and text in done.stdout + done.stderr


def test_a_bringup_finds_includes_on_the_package_path(arm: str) -> None:
    """Also before anything is started, to list the arguments of what is included."""
    folder = Path(arm).parent
    parts = folder / "elsewhere/parts"
    parts.mkdir(parents=True)
    (parts / "package.xml").write_text("<package><name>arm_parts</name></package>")
    Path(arm).rename(parts / "arm.xacro")
    file = folder / "robot/r.xacro"
    file.parent.mkdir()
    include = '<xacro:include filename="$(find arm_parts)/arm.xacro"/>'
    file.write_text(f'<robot name="r" {ARM.split(" ", 2)[2].splitlines()[0]}{include}</robot>')
    words = ("view", str(file), "viewer:=none", "--show-args")
    assert "height:=1.0" not in onebot(*words).stdout
    done = onebot(*words, f"package_path:={folder / 'elsewhere'}")
    assert done.returncode == 0 and "height:=1.0" in done.stdout
    assert "package_path:=" in done.stdout
