"""Launch arguments in, processes out: which nodes, with which parameters. None of them is started.

What the nodes then do is tested by bringing robots up (``test_mrm_bringup``,
``test_onebot_bringup``).
"""

import os
from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, ClassVar
from unittest.mock import patch

import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from onebot_bringup.cli import check, snapshot
from onebot_bringup.cli.replay import ReplaySettings
from onebot_bringup.cli.steer import SteerSettings
from onebot_bringup.launch.arguments import PACKAGES, Settings
from onebot_bringup.launch.bringup import (
    Bringup,
    bring_up,
    environment,
    summary_text,
    with_params_file,
    with_view,
)
from onebot_bringup.launch.nodes import (
    NODES,
    Launch,
    write_parameters,
)
from onebot_bringup.launch.robots import PlacedRobot
from onebot_bringup.launch.settings import BringupSettings, StandingSettings, checked_settings
from onebot_bringup.launcher.process import NodeProcess
from onebot_control.conventions import DRIVE_CONTROLLER
from onebot_control.simulation_parameters import SimulationConfig
from onebot_description.description import Description, load_description
from onebot_description.description_files import Source
from onebot_description.errors import OneBotError, UsageError
from onebot_description.parameters.reader import leaves
from onebot_description.parameters.values import plain
from tests.onebot_control.drive_models import car, mecanum
from tests.readme_tables import PARAMETERS

ARM = (Path(__file__).parents[1] / "robots/xacro_arm.xacro").read_text()
JOINTS = "/**:\n  ros__parameters: {rate: 20.0}\n"

Make = Callable[..., Launch]


@pytest.fixture
def arm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The arm, and parameters for its joints and for a controller, in the working directory."""
    monkeypatch.chdir(tmp_path)
    for name, text in (("arm.xacro", ARM), ("joints.yaml", JOINTS), ("control.yaml", JOINTS)):
        (tmp_path / name).write_text(text)
    return tmp_path / "arm.xacro"


@pytest.fixture(scope="module")
def described(tmp_path_factory: pytest.TempPathFactory) -> Description:
    """The arm, expanded once."""
    file = tmp_path_factory.mktemp("described") / "arm.xacro"
    file.write_text(ARM)
    return load_description(file)


@pytest.fixture
def make(arm: Path, described: Description) -> Make:
    """A factory for the launch arguments given, of a robot that can be simulated or cannot."""

    def factory(
        simulated: bool = True, /, *, ros_args: tuple[str, ...] = (), **given: str
    ) -> Launch:
        kind = BringupSettings if simulated else StandingSettings
        control = str(arm.parent / "control.yaml") if simulated else ""
        source = Source(str(arm), {"height": "2.0"}, (str(arm),), 1)
        nodes = arm.parent / "nodes"
        nodes.mkdir(exist_ok=True)
        settings = checked_settings(kind, given, model=str(arm), view="none", params_file=control)
        return Launch(settings, described, source, ros_args, folder=nodes)

    return factory


def write_control(arm: Path, parameters: str) -> None:
    """Write these parameters into the controller's file."""
    text = f"/**/velocity_controller:\n  ros__parameters: {{{parameters}}}\n"
    (arm.parent / "control.yaml").write_text(text)


def names(launch: Launch) -> list[str]:
    return [node.name for node in launch.nodes()]


def given_by(words: str) -> dict[str, str]:
    return dict(word.split(":=") for word in words.split())


def process_of(launch: Launch, name: str) -> NodeProcess:
    """One of the nodes, whether it is to start or not."""
    [row] = [row for row in NODES if row.name == name]
    return launch.node(row)


def parameters_of(launch: Launch, name: str, robot: str = "") -> dict[str, Any]:
    """The parameters of its own that a node gets; of one of several robots, that robot's."""
    [row] = [row for row in NODES if row.name == name]
    file = launch.folder / robot / f"{row.node}.yaml"
    assert str(file) in launch.node(row).arguments
    [content] = yaml.safe_load(file.read_text()).values()
    found: dict[str, Any] = content["ros__parameters"]
    return found


class Recorded(BringupSettings):
    """Launch arguments that record the names of those that are read."""

    names: ClassVar[set[str]] = set()

    def __getattribute__(self, name: str) -> Any:
        Recorded.names.add(name)
        return super().__getattribute__(name)


def test_every_argument_is_read_and_every_parameter_declared(make: Make) -> None:
    """Otherwise an argument is accepted without effect, or a node ignores what it is given."""
    given = {"record": "bag", "steer": "true", "world": "maze", "rate": "50"}
    launch = make(**given)
    settings = Recorded(
        **{f.name: getattr(launch.settings, f.name) for f in fields(launch.settings)}
    )
    launch = replace(launch, settings=settings)
    Recorded.names.clear()
    for row in NODES:
        row.starts(launch)
        kinds = {**PARAMETERS, "controller_manager": (SimulationConfig,)}[row.node]
        declared = {leaf.name for kind in kinds for leaf in leaves(kind)}
        assert set(parameters_of(launch, row.name)) <= {*declared, "use_sim_time"}
    environment(settings)
    summary_text(launch)
    names = {argument.name for argument in settings.arguments()}
    # These are used when the models are read.
    assert names - Recorded.names == {PACKAGES.name, "robots"}


@pytest.mark.parametrize("kind", [BringupSettings, StandingSettings, SteerSettings, ReplaySettings])
def test_an_argument_has_the_type_of_its_parameter(kind: type[Settings]) -> None:
    """Annotations of settings repeat what the nodes declare."""
    parameters = {**PARAMETERS, "steering_viewer": PARAMETERS["rerun_viewer"]}
    for argument in kind.arguments():
        kinds = parameters[argument.nodes[0]] if argument.nodes else ()
        types = {leaf.name: leaf.type for kind in kinds for leaf in leaves(kind)}
        wanted = types.get(argument.parameter, argument.type)
        assert (argument.type.base, argument.type.many) == (wanted.base, wanted.many)


@pytest.mark.parametrize("sim", [True, False])
def test_an_argument_given_is_what_the_node_gets(make: Make, sim: bool) -> None:
    """What a row of the nodes' table sets by itself does not override it."""
    candidates = ("0.25", "7", "false", "true", "given", "a,b")
    for argument in make(sim).settings.arguments():
        # What stands is not simulated here.
        if argument.nodes and (sim or DRIVE_CONTROLLER not in argument.nodes):
            possible = (text for text in argument.choices or candidates if text != argument.default)
            text = next(text for text in possible if not argument.problem(text))
            further = {}
            if argument.name == "joints":
                further = {"sim": "false"}
            if argument.nodes == ("steering_page",):
                further = {"steer": "true"}
            if argument.nodes == ("navigator",):
                further = {"navigate": "true"}
            launch = make(sim, **{**further, argument.name: text})
            found = parameters_of(launch, argument.nodes[0])[argument.parameter]
            assert found == plain(argument.value(text))


@pytest.mark.parametrize(
    ("sim", "words", "nodes"),
    [
        (True, "", "velocity_controller robot_state_publisher rerun_viewer"),
        (True, "sim:=false", "robot_state_publisher joint_state_publisher rerun_viewer"),
        (False, "", "robot_state_publisher joint_state_publisher rerun_viewer"),
        (False, "joint_states:=false", "robot_state_publisher rerun_viewer"),
        (False, "sim:=true viewer:=none", "joint_trajectory_controller robot_state_publisher"),
        (False, "viewer:=none joint_states:=0 save:=x.rrd", "robot_state_publisher rerun_viewer"),
        (
            True,
            "record:=bag viewer:=none steer:=true",
            "bag_recorder velocity_controller robot_state_publisher steering_page",
        ),
    ],
)
def test_which_nodes_are_started(make: Make, sim: bool, words: str, nodes: str) -> None:
    """The recorder comes first; one node moves the joints, the simulation or the publisher."""
    assert names(make(sim, **given_by(words))) == nodes.split()


def test_what_each_node_is(make: Make) -> None:
    """The robot's own nodes end the launch, all others may go; the viewer yields to them.

    Each gets namespace, log level and time, and last of all what follows --ros-args.
    """
    given = {"namespace": "/left/arm/", "log_level": "warn", "use_sim_time": "true"}
    launch = make(ros_args=("-p", "x:=1"), record="bag", steer="true", **given)
    for node in (*launch.nodes(), process_of(launch, "joint_state_publisher")):
        words = list(node.arguments)
        assert node.module.rpartition(".")[2] == node.name
        assert (node.nice > 0) == (node.name == "rerun_viewer")
        ignored = node.name in ("bag_recorder", "rerun_viewer", "steering_page")
        assert node.on_exit == ("ignore" if ignored else "shutdown")
        assert words[-2:] == ["-p", "x:=1"]
        own = words[words.index("--ros-args") :]
        assert own[1:3] == ["--log-level", "warn"]
        assert "__ns:=/left/arm" in own and own[own.index("__ns:=/left/arm") - 1] == "-r"
        assert parameters_of(launch, node.name)["use_sim_time"] is True
        file = own[len(own) - own[::-1].index("--params-file")]
        assert Path(file).read_text().startswith(f'"/left/arm/{node.name}":')


def test_a_namespace_is_the_prefix_of_all_frames(make: Make) -> None:
    """Of publishers, controller and viewer alike, simulated or not."""
    controller = parameters_of(make(namespace="left"), "velocity_controller")
    assert controller["tf_frame_prefix_enable"] and controller["tf_frame_prefix"] == "left/"
    for launch in (make(namespace="left"), make(False, namespace="left")):
        for name in ("robot_state_publisher", "rerun_viewer"):
            assert parameters_of(launch, name)["frame_prefix"] == "left/"
    none = parameters_of(make(namespace="left", frame_prefix=""), "velocity_controller")
    assert none["tf_frame_prefix_enable"] is False


def test_what_the_nodes_get_by_default(make: Make, arm: Path, described: Description) -> None:
    """The robot, frames and the time; every joint swings within its limits, unless a file decides.

    The controller's own parameters override those of its file, which is found from anywhere.
    """
    assert parameters_of(make(False), "robot_state_publisher") == {
        "robot_description": described.urdf,
        "frame_prefix": "",
        "hold_floating_joints": True,  # nobody else places it
        "publish_frequency": 0.0,
        "ignore_timestamp": False,
        "use_sim_time": False,
    }
    file = str(arm.parent / "joints.yaml")
    launch = make(joints=file, sim="false")
    assert parameters_of(launch, "joint_state_publisher") == {"use_sim_time": False}
    assert file in process_of(launch, "joint_state_publisher").arguments, "parameters override it"
    swing = parameters_of(make(rate="20"), "joint_state_publisher")
    assert swing == {"rate": 20.0, "swing": 8.0, "use_sim_time": False}
    launch = make(params_file="control.yaml")
    assert parameters_of(launch, "velocity_controller") == {
        "robot_description": described.urdf,
        "tf_frame_prefix_enable": False,
        "tf_frame_prefix": "",
        "use_sim_time": False,
    }
    words = process_of(launch, "velocity_controller").arguments
    files = [word for word in words if word.endswith(".yaml")]
    assert files[0] == str(arm.parent / "control.yaml") and len(files) == 2


@pytest.mark.parametrize(
    ("written", "given", "frame"),
    [
        ("x: 1.0", {}, "world"),
        ("x: 1.0", {"ground_truth_tf": "false"}, "map"),
        ("ground_truth_tf: false", {}, "map"),
        ("world_frame_id: hall", {}, "hall"),
    ],
)
def test_the_frame_of_a_world(
    make: Make, arm: Path, written: str, given: dict[str, str], frame: str
) -> None:
    """It is map where the truth is not on TF, so that TF is one tree, unless the file names one."""
    write_control(arm, written)
    found = parameters_of(make(world="maze", **given), "velocity_controller")
    assert found["world_frame_id"] == frame


def test_the_topics_of_nav2(make: Make, described: Description) -> None:
    """Every node has them: one of one robot in its namespace, the viewer's of each of several."""
    single = make(nav2_topics="true", namespace="yard")
    rules = ["-r", "velocity_controller/cmd_vel:=cmd_vel", "-r", "velocity_controller/odom:=odom"]
    for node in single.nodes():
        assert " ".join(rules) in " ".join(node.arguments)
    assert "a Twist on /yard/cmd_vel" in summary_text(single)
    robots = [PlacedRobot(name, 0.0, 0.0, 0.0, described) for name in ("a", "b")]
    fleet = replace(make(nav2_topics="true", robots="2", steer="true"), robots=robots)
    words = " ".join(process_of(fleet, "rerun_viewer").arguments)
    assert "a/velocity_controller/cmd_vel:=a/cmd_vel" in words and "b/odom" in words
    assert parameters_of(fleet, "steering_page")["topic"] == "a/cmd_vel"
    summary = summary_text(fleet)
    assert summary.startswith("2 robots in one world, a to b\n")
    assert "onebot teleop a, or a Twist on /a/cmd_vel" in summary and "such as a/odom" in summary


def test_several_robots_are_two_processes(make: Make, arm: Path, described: Description) -> None:
    """One simulates all, one publishes their states; each robot has parameters of its own."""
    other = load_description(arm, {"height": "3.0"})
    (arm.parent / "b.yaml").write_text(JOINTS)
    robots = [
        PlacedRobot("a", 0.0, 1.0, 0.0, described),
        PlacedRobot("b", 2.0, 3.0, 0.5, other, arm.parent / "b.yaml"),
    ]
    given = {"robots": "fleet.yaml", "namespace": "yard", "rate": "50", "use_sim_time": "true"}
    nodes = replace(make(ros_args=("-p", "z:=1"), **given), robots=robots)
    assert names(nodes) == ["velocity_controller", "robot_state_publisher", "rerun_viewer"]
    assert parameters_of(nodes, "velocity_controller", "a")["y"] == 1.0
    assert parameters_of(nodes, "velocity_controller", "b") == {
        "x": 2.0,
        "y": 3.0,
        "yaw": 0.5,
        "robot_description": other.urdf,
        "tf_frame_prefix_enable": True,
        "tf_frame_prefix": "yard/b/",
        "update_rate": 50.0,
        "world_frame_id": "world",
        "use_sim_time": True,
    }
    words = list(process_of(nodes, "velocity_controller").arguments)
    assert {"__ns:=/yard/a", "__ns:=/yard/b"} < set(words)
    own, common = words[: words.index("--ros-args")], words[words.index("--ros-args") :]
    assert own.count(str(arm.parent / "b.yaml")) == 1 and own.count("z:=1") == 2
    assert str(arm.parent / "control.yaml") in common and common[1:3] == ["--log-level", "info"]
    state = parameters_of(nodes, "robot_state_publisher", "b")
    assert state["frame_prefix"] == "yard/b/" and state["robot_description"] == other.urdf
    assert parameters_of(nodes, "rerun_viewer")["robots"] == ["a", "b"]
    assert parameters_of(nodes, "steering_page")["topic"] == "a/velocity_controller/cmd_vel"
    # All odometry frames have a parent, even where that of a single robot has none.
    for written, frame in (('""', "world"), ("map", "map")):
        write_control(arm, f"world_frame_id: {written}")
        drive = parameters_of(nodes, "velocity_controller", "a")
        assert drive["world_frame_id"] == frame


SPACE = {"namespace": "left"}


@pytest.mark.parametrize(
    ("parameters", "given", "wanted"),
    [
        ("x: 1.0", {}, {"frame_prefix": "", "use_sim_time": False, "x": None}),
        ("x: 1.0", SPACE, {"frame_prefix": "left/"}),
        ("tf_frame_prefix_enable: false", SPACE, {"frame_prefix": ""}),
        ("tf_frame_prefix: a", {}, {"frame_prefix": "a/"}),
        ("tf_frame_prefix: /a/b/", SPACE, {"frame_prefix": "a/b/"}),
        ("tf_frame_prefix: a, tf_frame_prefix_enable: false", SPACE, {"frame_prefix": ""}),
        ("tf_frame_prefix: a", {"frame_prefix": "b/"}, {"frame_prefix": "b/"}),
        ("tf_frame_prefix: a", {"sim": "false"}, {"frame_prefix": ""}),
        ("use_sim_time: true", {}, {"use_sim_time": True}),
        ("use_sim_time: true", {"use_sim_time": "false"}, {"use_sim_time": False}),
        ("x: 1.0", {"real_time_factor": "0"}, {"use_sim_time": True}),
        ("real_time_factor: 2.0", {"use_sim_time": "false"}, {"use_sim_time": True}),
        ("real_time_factor: 2.0", {"real_time_factor": "1.0"}, {"use_sim_time": False}),
    ],
)
def test_the_command_line_overrides_the_file_and_that_the_defaults(
    make: Make, arm: Path, parameters: str, given: dict[str, str], wanted: dict[str, Any]
) -> None:
    """All nodes name the frames, and take the time, as the controller's file has it."""
    write_control(arm, parameters)
    settings = with_params_file(make(**given).settings)
    assert wanted == {name: getattr(settings, name) for name in wanted}


def test_all_nodes_have_the_time_of_the_simulation_of_what_stands(make: Make, arm: Path) -> None:
    given = {"sim": "true", "real_time_factor": "2"}
    assert with_params_file(make(False, **given).settings).use_sim_time


def test_a_wrong_prefix_in_the_controller_s_file_is_refused(make: Make, arm: Path) -> None:
    """With its line."""
    write_control(arm, "tf_frame_prefix: 5")
    with pytest.raises(OneBotError, match=r"control.yaml:2: tf_frame_prefix: 5 is a number; write"):
        with_params_file(make().settings)


@pytest.mark.parametrize(
    ("sim", "given", "frame"),
    [
        (True, {}, ""),  # the viewer chooses: odom, as the simulation has it
        (True, {"sim": "false"}, "base"),  # there is no odom
        (True, {"sim": "false", "frame_prefix": "r/"}, "r/base"),
        (True, {"sim": "false", "fixed_frame": "world"}, "world"),
        (True, {"sim": "false", "view": "v.yaml"}, ""),  # the user's view decides
        (False, {}, ""),  # it may have an odom of its own
    ],
)
def test_the_viewer_s_fixed_frame(make: Make, sim: bool, given: dict[str, str], frame: str) -> None:
    """The one asked for, else the robot's root if it could be simulated but is not."""
    command = Bringup("test", "a test", control="control.yaml" if sim else "")
    assert with_view(make(sim, **given).settings, command, "base").fixed_frame == frame


def test_one_address_is_printed_of_page_and_viewer(make: Make) -> None:
    """The viewer's is named unless the steering page holds the view, whose address waits for it."""
    for steer, viewer in (("true", "web"), ("true", "none"), ("false", "web")):
        launch = make(steer=steer, viewer=viewer)
        assert parameters_of(launch, "rerun_viewer")["embedded"] is (steer == "true")
        waits = "await_view" in parameters_of(launch, "steering_page")
        assert waits is (viewer == "web")


def test_robot_state_publisher_follows_the_files(make: Make) -> None:
    """It gets what the robot was read from, unless edits are not to count."""
    factory = make()
    words = process_of(factory, "robot_state_publisher").arguments
    assert words[0] == "--follow" and Source.from_json(words[1]) == factory.source
    assert "--follow" not in process_of(make(reload="false"), "robot_state_publisher").arguments


def refused(robot: Bringup, *argv: str) -> str:
    """The error with which a bringup is refused before anything is started."""
    # A bringup sets variables for its nodes.
    with patch.dict(os.environ), pytest.raises(OneBotError) as caught:
        bring_up(robot, argv)
    return str(caught.value)


@pytest.fixture
def launches(monkeypatch: pytest.MonkeyPatch) -> list[Launch]:
    """What bringups would start: they are refused with "no node is started" instead."""
    made: list[Launch] = []

    def ended(launch: Launch) -> None:
        made.append(launch)
        raise OneBotError("no node is started")

    monkeypatch.setattr(Launch, "nodes", ended)
    return made


@pytest.fixture
def view() -> Bringup:
    """A command that takes a file."""
    return Bringup("view", "shows a robot", takes_file=True)


@pytest.fixture
def driven(arm: Path) -> Bringup:
    """A command with a robot of its own, which can be simulated."""
    return Bringup("drive", "drives", model=str(arm), control=str(arm.parent / "control.yaml"))


def test_the_model_is_given_once(view: Bringup, driven: Bringup, arm: Path) -> None:
    """A command that takes a file takes one; one that does not takes none."""
    assert "view needs a file" in refused(view)
    assert "not both" in refused(view, str(arm), f"model:={arm}")
    assert "more.urdf" in refused(view, str(arm), "more.urdf")
    assert 'no argument "robots"' in refused(view, str(arm), "robots:=2")
    assert "arm.xacro" in refused(driven, str(arm))


def test_the_models_arguments_make_the_robot(
    view: Bringup, arm: Path, launches: list[Launch]
) -> None:
    assert refused(view, str(arm), "height:=2.5", "viewer:=none") == "no node is started"
    [launch] = launches
    assert launch.description.joints[0].origin.xyz == (0.0, 0.0, 2.5)


@pytest.mark.parametrize("name", ["port", "namespace", "model", "package_path", "height"])
def test_the_models_argument_of_a_name_that_the_command_has(
    view: Bringup, arm: Path, launches: list[Launch], name: str
) -> None:
    """It is ``model.NAME``, for each command; any of the model's may be written so."""
    arm.write_text(ARM.replace("height", name))
    given = f"model.{name}:=2.5"
    assert refused(view, str(arm), given, "viewer:=none") == "no node is started"
    [launch] = launches
    assert launch.description.joints[0].origin.xyz == (0.0, 0.0, 2.5)
    assert snapshot.parse_command_line(["a.png", str(arm), given]).arguments == {name: "2.5"}
    assert check.run([str(arm), given]) == 0
    assert 'no argument "model.other"' in refused(view, str(arm), "model.other:=1")


def test_unknown_arguments_are_refused_if_the_model_is_known(view: Bringup, arm: Path) -> None:
    """Those of the model are known too, and are suggested; all are reported at once."""
    said = refused(view, str(arm), "heigth:=1", "viewwer:=web")
    assert 'no argument "heigth" (did you mean "height"?' in said
    assert 'no argument "viewwer"' in said and len(said.splitlines()) == 2
    arm.write_text(ARM.replace("<link", '<xacro:include filename="$(arg other)"/><link', 1))
    assert "no argument" not in refused(view, str(arm), "heigth:=1", "view:=absent.yaml")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["joints:=joint.yaml", "sim:=0"], "joints:=joint.yaml: no such file"),
        (["view:=absent.yaml"], "view:=absent.yaml: no such file"),
        (["params_file:=contol.yaml"], "params_file:=contol.yaml: no such file"),
        (["save:=nowhere/x.rrd"], "save:=nowhere/x.rrd cannot be written: No such file"),
        (["save:=x.mcap"], "must end in .rrd"),
        (["record:=taken"], "record:=taken cannot be written: File exists"),
        (["record:=/proc/bag"], "record:=/proc/bag cannot be written: "),
        (["world:=mase"], 'no world "mase" (did you mean "maze"?'),
        (["world:=joints.yaml"], "joints.yaml:1"),
        (["steer:=true", "host:=192.0.2.77"], "host:=192.0.2.77 is not an address of this"),
        (["joints:=joints.yaml", "sim:=0", "save:=x.rrd", "record:=bag"], "absent.xacro"),
        (["world:=maze", "save:=kept.rrd"], "absent.xacro"),
    ],
)
def test_files_are_checked_before_anything_starts(
    driven: Bringup, arm: Path, words: list[str], said: str
) -> None:
    (arm.parent / "taken").mkdir()
    Path("kept.rrd").write_text("kept")
    before = sorted(arm.parent.iterdir())
    # The model comes after all these checks, so a correct one would be refused here.
    assert said in refused(driven, *words, "model:=absent.xacro")
    assert sorted(arm.parent.iterdir()) == before and Path("kept.rrd").read_text() == "kept"


def test_parameters_for_no_node_are_refused(driven: Bringup) -> None:
    """A limit would be none; the error has the sections that would do."""
    Path("file.yaml").write_text(JOINTS.replace("/**", "joint_state_publisher"))
    said = refused(driven, "joints:=file.yaml", "sim:=false", "namespace:=r1")
    assert 'section "/joint_state_publisher" is for none of the nodes; write ' in said
    assert "/r1/joint_state_publisher" in said


OF_ALL = """/**:
  ros__parameters:
    use_sim_time: false
    max_sped: 1.0
    qos_overrides./tf.publisher.depth: 5
    update_rate: 50
"""


@pytest.mark.parametrize(
    ("words", "names"),
    [
        ("params_file:=all.yaml", {4: "max_sped"}),
        ("robots:=two.yaml", {4: "max_sped"}),
        ("joints:=all.yaml sim:=false", {4: "max_sped", 6: "update_rate"}),
    ],
)
def test_names_that_no_node_declares_are_a_line_each(
    driven: Bringup,
    launches: list[Launch],
    capsys: pytest.CaptureFixture[str],
    words: str,
    names: dict[int, str],
) -> None:
    """In a section for several nodes, which may have them; before anything starts."""
    Path("all.yaml").write_text(OF_ALL)
    robot = "{{x: {}, y: 0.0, params_file: all.yaml}}"
    Path("two.yaml").write_text(f"robots: {{a: {robot.format(0.0)}, b: {robot.format(9.0)}}}")
    assert refused(driven, *words.split(), "namespace:=r1") == "no node is started"
    text = "no node of this bringup that is given the file declares it"
    printed = capsys.readouterr().err.replace(f"{Path.cwd()}/", "")
    assert [line for line in printed.splitlines() if text in line] == [
        f'warning: all.yaml:{line}: {name} in section "/**": {text}' for line, name in names.items()
    ]


def test_parameters_are_those_of_the_drive_that_the_urdf_shows(
    driven: Bringup, launches: list[Launch], capsys: pytest.CaptureFixture[str]
) -> None:
    """The file names no type; each robot of a fleet has its own drive."""
    for description in (mecanum(), car()):
        Path(f"{description.robot_name}.urdf").write_text(description.urdf)
    Path("all.yaml").write_text("/**: {ros__parameters: {wheel_separation_x: 0.3, wheelbase: 0.3}}")
    entry = "{{x: {}, y: 0.0, model: {}.urdf, params_file: all.yaml}}"
    both = f"robots: {{a: {entry.format(0.0, 'mecanum')}, b: {entry.format(9.0, 'car')}}}"
    Path("both.yaml").write_text(both)
    for words, unknown in (
        ("model:=mecanum.urdf params_file:=all.yaml", ["wheelbase"]),
        ("model:=car.urdf params_file:=all.yaml", ["wheel_separation_x"]),
        ("robots:=both.yaml", []),
    ):
        assert refused(driven, *words.split()) == "no node is started"
        printed = capsys.readouterr().err
        lines = [line for line in printed.splitlines() if "declares it" in line]
        assert [line.split(": ")[2].split(" in ")[0] for line in lines] == unknown, words


@pytest.mark.parametrize("word", ["--help", "-s"])
def test_help_starts_nothing(view: Bringup, arm: Path, word: str, capsys: Any) -> None:
    """It names the model's arguments, also those that the command has itself."""
    arm.write_text(ARM.replace("<link", '<xacro:arg name="namespace" default="q"/><link', 1))
    assert bring_up(view, [str(arm), word]) == 0
    shown = capsys.readouterr().out
    assert "Arguments of the model" in shown and "height:=1.0" in shown
    assert "model.namespace:=q" in shown
    assert ("usage: view FILE" in shown) == (word == "--help")


SUMMARY = """\
Robot "arm": 3 links, 1 of 2 joints can move
  model    MODEL
  topics   /tf /tf_static /left/robot_description /left/joint_states
  frames   begin with left/
  drive    onebot teleop /left/velocity_controller/cmd_vel, or a Twist on \
/left/velocity_controller/cmd_vel
  Ctrl-C stops everything"""


@pytest.mark.parametrize(
    ("sim", "given", "text"),
    [
        (True, "namespace:=/left/", SUMMARY),
        (False, "", "\n  joints   swing within their limits\n"),
        (False, "joints:=j.yaml", "\n  joints   j.yaml\n"),
        (False, "joint_states:=false", "\n  joints   wait for /joint_states\n"),
    ],
)
def test_the_summary_says_what_runs(make: Make, sim: bool, given: str, text: str) -> None:
    launch = make(sim, **given_by(given))
    summary = summary_text(launch)
    assert text in summary.replace(launch.settings.model, "MODEL")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("publish_frequency:=1001", "a number from 0 to 1000"),
        ("frame_prefix:=left", "frame_prefix:=left/"),
        ("port:=8081", "add steer:=true"),
        ("world:=maze sim:=false", "world:=maze is for the simulation"),
        ("rate:=0", "rate:=0 is not valid; write a number from 0.001 to 1000"),
        ("robots:=3 x:=1", "x:=1 is for one robot, not for robots:=3"),
        ("robots:=3 reload:=true", "reload:=true is for one robot, not for robots:=3"),
        ("joints:=j.yaml", "joints:=j.yaml has no effect, since the simulation moves"),
        ("nav2_topics:=true sim:=false", "nav2_topics:=true is for the simulation"),
        ("robots:=3 sim:=false", "robots:=3 is for the simulation: write sim:=true"),
    ],
)
def test_values_that_are_not_possible(make: Make, words: str, said: str) -> None:
    with pytest.raises(UsageError, match=said):
        make(**given_by(words))


Text = st.text(st.characters(blacklist_categories=("Cs",)))
Number = st.booleans() | st.integers(-(2**31), 2**31) | st.sampled_from((10.0, 1e-5, -2.5e300))
Name = st.text(st.characters(blacklist_categories=("Cs",)), max_size=50)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.dictionaries(Name, Text | Number, max_size=5))
def test_values_come_back_with_their_type(tmp_path: Path, values: dict[str, object]) -> None:
    """Any text (emoji, quotes, "1.0", "true"), boolean or number is read back unchanged.

    ROS would take 10 for an integer, and YAML 1.1 takes 1e-05 for a text.
    """
    path = write_parameters(tmp_path, "node", values)
    loaded = yaml.safe_load(path.read_text())["/node"]["ros__parameters"] or {}
    assert loaded == values
    assert {name: type(value) for name, value in loaded.items()} == {
        name: type(value) for name, value in values.items()
    }
