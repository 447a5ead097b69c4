"""Every command of every README does what the README says."""

import ast
import re
import shlex
import sys
from pathlib import Path

import pytest
import yaml
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet

from tests import readme
from tests.readme import CHECKOUT
from tests.ros_support import Peer
from tests.support import PATIENCE, RunningProcess, run_to_end, wait_for
from tests.support_rendering import require_renderer

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

TEXTS = {
    str(file.relative_to(CHECKOUT)): file.read_text()
    for file in (
        readme.README,
        *readme.documents(),
        CHECKOUT / "tests/benchmarks/README.md",
    )
}
GUIDE = (CHECKOUT / "CONTRIBUTING.md").read_text()
ALL = "\n".join(TEXTS.values()).replace("\\\n", "")
BESIDE = re.compile(r"<!-- beside (.*?) -->\n```sh\n(.*?)```", re.DOTALL)
IN_TURN = re.compile(r"<!-- in turn -->\n```sh\n(.*?)```", re.DOTALL)
WHOLE = re.compile(r"<!-- whole -->\n```sh\n(.*?)```", re.DOTALL)
BLOCK = re.compile(r"```sh\n(.*?)```", re.DOTALL)
FIRST_TWO = BLOCK.findall(ALL)[:2]
ALONE = list(
    dict.fromkeys(
        line
        for block in BLOCK.findall(WHOLE.sub("", IN_TURN.sub("", BESIDE.sub("", ALL))))
        if block not in FIRST_TWO
        for line in block.splitlines()
    )
)
# What runs until Ctrl-C, and what it has printed by then.
ENDLESS = {r"topic pub (?!.*(--once|--times))": "#50", r"topic hz": "average rate"}
NODE = re.compile(r"python -m onebot_\S*\.(\w+)")


def test_every_package_has_a_readme():
    """Which the first table of README.md links to."""
    packages = [str(file.parent.name) for file in CHECKOUT.glob("*/package.xml")]
    for name in [*packages, "tests/benchmarks"]:
        assert f"]({name}/README.md)" in TEXTS["README.md"]
        assert f"{name}/README.md" in TEXTS


def test_first_two_commands_are_what_ci_runs():
    """Installing and testing are shown by .ci/run itself, which takes them from the README."""
    first, second = readme.blocks()[:2]
    assert "pip install" in first and "onebot_bringup" in first
    assert "[test]" in second and "pytest" in second
    script = (CHECKOUT / ".ci/run").read_text()
    assert "tests/readme.py until-up 1" in script and "tests/readme.py run 2" in script
    assert "pytest -m slow" in script


@pytest.mark.slow
@pytest.mark.parametrize("command", ALONE)
def test_command(command, ros_domain, tmp_path):
    """It runs as written, in a folder with the checkout's files, and ends with exit code 0."""
    if "snapshot" in command:
        require_renderer()
    _lay_out_checkout(tmp_path)
    if node := NODE.search(command):
        _run_node(command, node[1], ros_domain, tmp_path)
    else:
        _run(command, tmp_path)


@pytest.mark.slow
def test_commands_in_turn(ros_domain, tmp_path):
    """Each finds what the one before has left; the blocks begin alike."""
    _lay_out_checkout(tmp_path)
    for command in dict.fromkeys("".join(IN_TURN.findall(ALL)).splitlines()):
        _run(command, tmp_path)


def _lay_out_checkout(folder):
    for entry in CHECKOUT.iterdir():
        if not entry.name.startswith("."):
            (folder / entry.name).symlink_to(entry)


def _run(command, tmp_path):
    if readme.BRINGUP.search(command):
        code, output = readme.run_until_up(command, tmp_path, timeout=PATIENCE)
        assert "Traceback" not in output
        assert code == 0
        return
    done = run_to_end(["bash", "-c", command], cwd=tmp_path, timeout=5 * PATIENCE)
    assert done.returncode == 0, done.stdout + done.stderr


def _run_node(command, name, domain, folder):
    with Peer(domain) as peer, RunningCommand(f"exec {command}", folder) as running:
        # A node of that name may be left for a moment of a robot whose test has ended.
        wait_for(lambda: running.has_ros and name in peer.node.get_node_names(), name)


@pytest.mark.slow
@pytest.mark.parametrize("robot", dict.fromkeys(robot for robot, _ in BESIDE.findall(ALL)))
def test_commands_beside_a_running_robot(robot, ros_domain, tmp_path):
    """In a second terminal, each ends with exit code 0, or runs until Ctrl-C and then does."""
    _lay_out_checkout(tmp_path)
    commands = "".join(block for beside, block in BESIDE.findall(ALL) if beside == robot)
    with RunningCommand(f"exec {robot}", tmp_path) as running:
        wait_for(lambda: readme.is_up(robot, running.output), "the robot")
        for command in commands.splitlines():
            [printed] = [text for kind, text in ENDLESS.items() if re.search(kind, command)] or [""]
            if printed:
                with RunningCommand(f"exec {command}", tmp_path) as endless:
                    wait_for(lambda e=endless, p=printed: p in e.output, command)
                continue
            done = run_to_end(["bash", "-c", command], cwd=tmp_path, timeout=5 * PATIENCE)
            assert done.returncode == 0 and done.stdout, command + done.stdout + done.stderr


SAVED = re.findall(r"\*(test_\w+\.py)\*.*?```python\n(.*?)```", ALL, re.DOTALL)


@pytest.mark.parametrize(
    "brings_up", [False, pytest.param(True, marks=pytest.mark.slow)], ids=["simulation", "bringup"]
)
def test_the_examples_in_python(brings_up, tmp_path, ros_domain):
    """Saved as the README has them, they pass."""
    examples = {name: code for name, code in SAVED if ("bringup" in code) == brings_up}
    for name, code in examples.items():
        (tmp_path / name).write_text(code)
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *examples]
    done = run_to_end(command, cwd=tmp_path, timeout=5 * PATIENCE)
    assert f"{len(examples)} passed" in done.stdout, done.stdout + done.stderr


def test_the_workflow_to_copy_installs_and_tests() -> None:
    """As far as one can see here: on a Python that is supported, this project, and pytest."""
    [text] = re.findall(r"```yaml\n(on:.*?)```", TEXTS["README.md"], re.DOTALL)
    steps = yaml.safe_load(text)["jobs"]["robot"]["steps"]
    [version] = [step["with"]["python-version"] for step in steps if "setup-python" in str(step)]
    project = tomllib.loads((CHECKOUT / "pyproject.toml").read_text())["project"]
    assert version in SpecifierSet(project["requires-python"])
    install, test = (shlex.split(step["run"], comments=True) for step in steps if "run" in step)
    names = [Requirement(word).name for word in install[2:]]
    assert install[:2] == ["pip", "install"] and names == ["pytest", project["name"]]
    assert test[:3] == ["python", "-m", "pytest"]


@pytest.mark.slow
def test_your_own_robot_drives(ros_domain, tmp_path):
    """The block, pasted into an empty folder, brings up a robot that drives as commanded."""
    [block] = WHOLE.findall(ALL)
    with Peer(ros_domain) as peer, RunningCommand(block, tmp_path) as running:
        truth = peer.hear(Odometry, "/velocity_controller/ground_truth")
        odometry = peer.hear(Odometry, "/velocity_controller/odom")
        wait_for(lambda: "driving robot" in running.output, "the robot")
        command = peer.publisher(Twist, "/velocity_controller/cmd_vel")
        twist = Twist()
        twist.linear.x = 0.2

        def has_driven():
            command.publish(twist)
            return truth and truth[-1].pose.pose.position.x > 0.5

        wait_for(has_driven, "half a meter")
        assert abs(truth[-1].pose.pose.position.y) < 0.01
        wait_for(lambda: odometry[-1].pose.pose.position.x > 0.5, "the odometry")
        wait_for(lambda: "[steering_page]" in running.output, "the steering page")


class RunningCommand(RunningProcess):
    """A shell command that is running meanwhile."""

    def __init__(self, command, folder):
        super().__init__(["bash", "-c", command], folder)

    @property
    def has_ros(self):
        """Whether it has called rclpy.init: it uses a segment of shared memory then."""
        return "/fastrtps_" in Path(f"/proc/{self.process.pid}/maps").read_text()


@pytest.mark.parametrize("name", [*TEXTS, "CONTRIBUTING.md"])
def test_pictures_and_links_exist(name):
    """Each file that the README points to is in the repository, each heading in that file."""
    folder = (CHECKOUT / name).parent
    text = (CHECKOUT / name).read_text()
    for match in re.findall(r"\]\((?!https?:)([^)]+)\)|src=\"([^\"]+)\"", text):
        target, _, heading = (match[0] or match[1]).partition("#")
        file = folder / target if target else CHECKOUT / name
        assert file.exists(), target
        if heading:
            assert heading in _anchors(file.read_text()), f"{target}#{heading}"


def test_code_that_is_named_exists():
    """Each file in backticks is in the checkout, each name in CONTRIBUTING.md in some source."""
    sources = [
        file
        for folder in CHECKOUT.glob("*_*/")
        for file in (*folder.rglob("*.py"), *folder.rglob("*.js"), *folder.rglob("*.c"))
    ]
    sources += (CHECKOUT / "tests").rglob("*.py")
    paths = "".join(f"/{file.relative_to(CHECKOUT)}\n" for file in sources)
    for code in re.findall(r"`([\w./-]+\.(?:py|js|c))`", ALL + GUIDE):
        path = re.sub(
            "NAME|VERB|KIND", r"\\w+", re.escape(code)
        )  # of a file that is yet to be written
        assert re.search(f"/{path}\n", paths), code
    words = set(re.findall(r"\w+", " ".join(file.read_text() for file in sources)))
    for code in re.findall(r"`([A-Za-z_][\w.]*)(?:\(.*?\))?`", GUIDE):
        if not code.endswith((".py", ".js", ".c")):
            assert set(code.split(".")) <= words, code


def _anchors(text):
    """The headings of a Markdown file as a link to them is written."""
    headings = re.findall(r"^#+ (.*)", text, re.MULTILINE)
    return [re.sub(r"[^\w\- ]", "", heading).lower().replace(" ", "-") for heading in headings]


def test_shown_files_are_the_real_ones():
    """Where a README quotes a file, it quotes what the file says."""
    quoted = re.findall(r"<!-- file: (\S+) -->\n```\w*\n(.*?)```", ALL, re.DOTALL)
    assert quoted
    for name, text in quoted:
        assert text in Path(CHECKOUT / name).read_text(), name


def test_python_examples_run(monkeypatch):
    """They give arrays of the shapes that they say."""
    monkeypatch.chdir(CHECKOUT)
    names: dict = {}
    for code in re.findall(r"<!-- python -->\n```python\n(.*?)```", ALL, re.DOTALL):
        exec(code, names)
        for name, shape in re.findall(r"^(\w+) = .*# (\(\d.*?\))", code, re.MULTILINE):
            assert names[name].shape == ast.literal_eval(shape), name
    assert names["translations"].shape == (1, 3) and names["rotations"].shape == (1, 4)
    assert names["hand"].shape == (4, 4) and names["poses"].shape == (2, 7)
