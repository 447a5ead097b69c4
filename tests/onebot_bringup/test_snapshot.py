"""``onebot snapshot``: its command line, the pose it draws, and how the picture is framed."""

from pathlib import Path

import pytest

from onebot_bringup.cli.pictures import _record_description
from onebot_bringup.cli.snapshot import check_picture, parse_command_line
from onebot_bringup.launch.arguments import UsageError
from onebot_bringup.viewer.display_server import open_recording
from onebot_bringup.viewer.rendering import Framing, framed, robot_view_id
from onebot_description.description import load_description
from onebot_description.errors import OneBotError
from tests.readme import CHECKOUT


def test_command_line():
    """Options in any order; a negative first coordinate; arguments for xacro."""
    args = parse_command_line(
        ["a.png", "b.xacro", "--camera", "-1,0,1", "--joints", "p=0.5", "q=-1e-2", "mesh:=no"]
    )
    assert (args.file, args.source, args.arguments) == (Path("a.png"), "b.xacro", {"mesh": "no"})
    assert args.camera == ((-1.0, 0.0, 1.0), None)
    assert args.joints == {"p": 0.5, "q": -0.01}
    assert (args.width, args.height, args.dashboard) == (1280, 720, False)
    args = parse_command_line(["a.png", "--ros-args", "-r", "__ns:=/left"])
    assert args.ros_args == ("-r", "__ns:=/left") and args.source is None
    assert parse_command_line(["a.png", "run", "namespace:=left"]).source == "run"
    bag = parse_command_line(["a.png", "run.mcap", "namespace:=left"])
    assert bag.arguments == {"namespace": "left"}


@pytest.mark.parametrize(
    "words",
    [
        [],
        ["a.png", "--width", "0"],
        ["a.png", "--height", "1e3"],
        ["a.png", "--camera", "1,2"],
        ["a.png", "--camera", "1,2,3:"],
        ["a.png", "--camera", "nan,2,3"],
        ["a.png", "--camera", "1,2,3:1,2,3"],
        ["a.png", "b.urdf", "--joints", "x=nan"],
        ["a.png", "--joints", "x=1"],
        ["a.png", "mesh:=no"],
        ["a.png", "namespace:=left"],
        ["a.png", "b.rrd", "namespace:=left"],
        ["a.png", "b.mcap", "mesh:=no"],
    ],
)
def test_wrong_command_lines_are_refused(words: list[str]):
    """Nothing is started for them."""
    with pytest.raises(UsageError):
        parse_command_line(words)


def test_where_a_picture_can_be_written(tmp_path: Path):
    """A .png in a folder that exists; this is said before anything is drawn."""
    check_picture(tmp_path / "a.png")
    assert list(tmp_path.iterdir()) == []
    for wrong in (tmp_path / "a.jpg", tmp_path / "none/a.png", Path("/proc/a.png")):
        with pytest.raises(OneBotError, match=r"a\.(jpg|png)"):
            check_picture(wrong)


LAYOUT = {
    "/time_panel": {"TimePanelBlueprint": {"state": "Collapsed", "timeline": "ros_time"}},
    "/view/v1/EyeControls3D": {
        "EyeControls3D": {"position": [1.0, 0.0, 0.0], "tracking_entity": "robot"}
    },
    "/viewport": {"ViewportBlueprint": {"root_container": "c"}},
}


def test_the_robot_alone_fills_the_picture():
    """Its view is maximised and no panel is shown; the layout given is left as it was."""
    made = framed(LAYOUT, "v1", Framing(dashboard=False))
    assert made["/viewport"]["ViewportBlueprint"] == {"root_container": "c", "maximized": "v1"}
    panels = ("/time_panel", "/top_panel", "/selection_panel", "/blueprint_panel")
    assert all("Hidden" in str(made[panel]) for panel in panels)
    assert made["/time_panel"]["TimePanelBlueprint"]["timeline"] == "ros_time"
    assert made["/view/v1/EyeControls3D"] == LAYOUT["/view/v1/EyeControls3D"]
    assert LAYOUT["/time_panel"]["TimePanelBlueprint"]["state"] == "Collapsed"


@pytest.mark.parametrize(
    ("before", "framing", "after"),
    [
        (
            {"position": [1.0, 0.0, 0.0], "tracking_entity": "robot"},
            Framing(eye=(0.0, 0.0, 2.0), target=(0.0, 0.0, 0.0)),
            {"kind": "Orbital", "position": [0.0, 0.0, 2.0], "look_target": [0.0, 0.0, 0.0]},
        ),
        (
            {"kind": "FirstPerson", "position": [9]},
            Framing(target=(1.0, 2.0, 3.0)),
            {"kind": "FirstPerson", "position": [9], "look_target": [1.0, 2.0, 3.0]},
        ),
    ],
)
def test_a_camera_of_ones_own_follows_nothing(before, framing, after):
    """It stays where it is put; of a target alone, the eye and how it moves stay."""
    made = framed({"/view/v1/EyeControls3D": {"EyeControls3D": before}}, "v1", framing)
    assert made["/view/v1/EyeControls3D"] == {"EyeControls3D": after}


def test_the_view_of_the_robot_is_found():
    """By its name, or else as the first in 3D."""
    views = {"a": ("TimeSeries", "Robot"), "b": ("3D", "Map"), "c": ("3D", "Robot")}
    assert robot_view_id(views) == "c"
    del views["c"]
    assert robot_view_id(views) == "b"
    with pytest.raises(OneBotError, match="--dashboard"):
        robot_view_id({"a": ("TimeSeries", "Robot")})


def test_a_missing_mesh_is_one_warning(tmp_path, capsys):
    """Of the picture, not of the file, too; other warnings of the file are given as well."""
    mesh = '<visual><geometry><mesh filename="{}"/></geometry></visual>'
    meshes = 2 * mesh.format("no.stl") + mesh.format(
        CHECKOUT / "onebot_description/meshes/wheel.dae"
    )
    file = tmp_path / "r.urdf"
    file.write_text(f'<robot name="r"><link name="a">{meshes}</link><gazbo/></robot>')
    recording = open_recording(save=tmp_path / "r.rrd")
    args = parse_command_line(["a.png", str(file), "--view", "none"])
    args.description = load_description(file)
    _record_description(args, recording.stream)
    recording.close()
    typo, missing = sorted(capsys.readouterr().err.splitlines())
    assert "gazbo" in typo
    assert missing.startswith("warning: link a: not drawn but marked with a box: mesh ")
    assert f"{tmp_path / 'no.stl'}: no such file" in missing
