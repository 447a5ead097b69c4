"""The notebooks, each executed in its own kernel; and the robot that they show.

With STORE_NOTEBOOKS=1 in the environment, the tests store the outputs in the notebooks.
"""

import json
import math
import os
import re
import warnings
from pathlib import Path

import nbformat
import pytest
import rerun as rr
import rerun.chunk as rc
from nav_msgs.msg import OccupancyGrid, Odometry
from nbclient import NotebookClient

from onebot_bringup.viewer.notebook import NotebookRobot
from onebot_description.description import load_description, parse_description
from onebot_description.errors import OneBotError
from tests.readme import CHECKOUT
from tests.ros_support import LATCHED
from tests.support import PATIENCE

STORES = bool(os.environ.get("STORE_NOTEBOOKS"))
FOLDERS = ("/home", "/root", "/tmp", "/work", str(CHECKOUT))
_NOT_STORED = "|".join((*FOLDERS, "stderr", "widget-view", "asset"))
NOTEBOOKS = sorted((CHECKOUT / "onebot_bringup/notebooks").glob("*.ipynb"))
ARM = Path(__file__).with_name("notebook_arm.urdf").read_text()


# --- the notebooks ------------------------------------------------------------------------------


def _source(notebook: nbformat.NotebookNode) -> str:
    return "\n".join(cell.source for cell in notebook.cells)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_is_committed_with_small_outputs(path):
    """It has its pictures, and does not name the computer that it was executed on."""
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    assert set(notebook.metadata) == {"kernelspec", "language_info"}
    assert not any(cell.metadata for cell in notebook.cells)
    assert _pictures(notebook) == 1
    assert path.stat().st_size < 150_000
    assert not any(folder in path.read_text() for folder in FOLDERS)


def _executed(
    name: str, folder: Path, results: str, changed: tuple[str, str] = ("", "")
) -> tuple[dict, nbformat.NotebookNode]:
    """Execute a notebook, and an expression after it.

    Args:
        name: of the notebook.
        folder: where it runs.
        results: the expression.
        changed: a text of the notebook, and what stands in its place.

    Returns:
        The expression's value, and the notebook with its outputs.
    """
    file = CHECKOUT / f"onebot_bringup/notebooks/{name}.ipynb"
    text = file.read_text()
    assert changed[0] in text
    notebook = nbformat.reads(text if STORES else text.replace(*changed), as_version=4)
    notebook.cells.append(
        nbformat.v4.new_code_cell(f"import json, sys\nprint(json.dumps({results}))")
    )
    folder = {"metadata": {"path": str(folder)}}
    patience = {"timeout": 5 * PATIENCE, "startup_timeout": PATIENCE}  # a cell may simulate much
    NotebookClient(notebook, resources=folder, **patience).execute()  # raises what cells do
    [output] = notebook.cells.pop().outputs
    if STORES:
        _store(file, notebook)
    return json.loads(output.text), notebook


def _store(file: Path, executed: nbformat.NotebookNode) -> None:
    """Write texts and pictures into a notebook, without widgets and what names this computer."""
    stored = nbformat.read(file, as_version=4)
    for cell, source in zip(stored.cells, executed.cells, strict=True):
        if cell.cell_type == "code":
            cell.execution_count = source.execution_count
            kept = [each for each in source.outputs if not re.search(_NOT_STORED, str(each))]
            printed = "".join(each.text for each in kept if each.output_type == "stream")
            cell.outputs = [each for each in kept if each.output_type != "stream"]
            if text := re.sub(r"\r?[^\n]*\r", "", printed):  # the last state of a progress
                cell.outputs.insert(0, nbformat.v4.new_output("stream", name="stdout", text=text))
    nbformat.write(stored, file)


def _pictures(notebook: nbformat.NotebookNode) -> int:
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", ())]
    return sum("image/png" in output.get("data", {}) for output in outputs)


def _widgets(notebook: nbformat.NotebookNode) -> list[dict]:
    """The states of all widgets."""
    states = notebook.metadata.widgets["application/vnd.jupyter.widget-state+json"]["state"]
    return [widget["state"] for widget in states.values()]


@pytest.mark.slow
def test_robot_model_shows_the_robot_with_its_sliders(tmp_path):
    """Without rclpy; the viewer does not come from another computer."""
    results, notebook = _executed(
        "robot_model",
        tmp_path,
        "{'shape': poses.shape, 'positions': robot.positions, 'ros': 'rclpy' in sys.modules}",
    )
    assert results["shape"] == [200, 5, 7]
    assert results["positions"] == {
        "left_wheel_joint": 0.4,
        "right_wheel_joint": 0.0,
        "caster_swivel_joint": 0.8,
        "caster_wheel_joint": 0.0,
    }
    assert not results["ros"]
    assert _pictures(notebook) == 1
    widgets = _widgets(notebook)
    sliders = [each for each in widgets if each["_model_name"] == "FloatSliderModel"]
    assert {each["description"]: each["value"] for each in sliders} == results["positions"]
    [viewer] = [each for each in widgets if each["_model_name"] == "AnyModel"]
    assert viewer["_esm"].startswith("http://localhost:")


@pytest.mark.slow
def test_driving_far_with_the_odometry_centimeters_off(tmp_path):
    """Without rclpy; the worn wheel is a hundred times worse. A tenth of the way shows it, too."""
    results, notebook = _executed(
        "driving",
        tmp_path,
        "{'meters': meters, 'driven': driven, 'error': error.tolist(), 'worn': error_worn.tolist(),"
        " 'ros': 'rclpy' in sys.modules}",
        ("meters = 1000.0", "meters = 100.0"),
    )
    assert results["driven"] == pytest.approx(results["meters"], abs=0.02)
    assert len(results["error"]) > 100
    assert 0.005 < max(results["error"]) < 0.001 * results["meters"]
    assert results["worn"][-1] > 100 * results["error"][-1]
    assert not results["ros"]
    assert _pictures(notebook) == 1


@pytest.mark.slow
def test_grasping_puts_the_box_onto_the_table(tmp_path):
    """Without rclpy, and upright; on the way it is lifted over the table, and does not slip."""
    results, notebook = _executed(
        "grasping",
        tmp_path,
        "{'box': vars(box), 'highest': carried[:, 2].max(), 'pressed': grip.effort,"
        " 'off': off, 'ros': 'rclpy' in sys.modules}",
    )
    box = results["box"]
    assert [box["x"], box["y"]] == pytest.approx([0.4, 0.6], abs=0.005)
    assert box["z"] == pytest.approx(0.085, abs=1e-4)  # half of its edge above the table's 60 mm
    assert [box["roll"], box["pitch"]] == pytest.approx([0.0, 0.0], abs=1e-4)
    assert box["yaw"] == pytest.approx(math.pi / 2.0, abs=0.02)
    assert results["highest"] == pytest.approx(0.125, abs=1e-4)
    assert results["pressed"] == pytest.approx(-10.0)  # N, the limit of the motor
    assert not results["ros"]
    assert _pictures(notebook) == 1
    names = {each.get("description") for each in _widgets(notebook)}
    assert {"lift", "finger"} <= names and "other_finger" not in names


@pytest.mark.slow
def test_ros_drives_a_running_robot_round_a_circle(peer, tmp_path):
    """In the domain of the environment, and the robot ends with the last cell."""
    received = peer.hear(Odometry, "/velocity_controller/odom")
    results, notebook = _executed(
        "ros", tmp_path, "{'distance': distance, 'truth': path(truth).tolist(), 'code': code}"
    )
    assert len(received) > 100
    assert math.pi < results["distance"] < 2.0 * math.pi  # more than once round by its braking
    for x, y in results["truth"]:
        assert math.hypot(x, y - 0.5) == pytest.approx(0.5, abs=0.01)
    assert min(x for x, _ in results["truth"]) < -0.49
    assert results["code"] == 0
    assert _pictures(notebook) == 1


@pytest.mark.slow
def test_mapping_drives_out_of_the_maze_with_its_map(peer, tmp_path):
    """The map is published, and nearly all of it is as the maze is."""
    received = peer.hear(OccupancyGrid, "/map", LATCHED)
    results, notebook = _executed(
        "mapping", tmp_path, "{'share': share, 'seen': int(seen.sum()), 'code': code}"
    )
    assert received and received[-1].header.frame_id == "world"
    assert results["share"] > 0.97 and results["seen"] > 3000
    assert results["code"] == 0
    assert _pictures(notebook) == 1


# --- the robot shown ----------------------------------------------------------------------------


@pytest.fixture
def arm(monkeypatch) -> NotebookRobot:
    # Nothing fetches the page's part of the viewer here, and to serve it takes seconds.
    monkeypatch.setenv("RERUN_NOTEBOOK_ASSET", "http://127.0.0.1:9/widget.js")
    return NotebookRobot(parse_description(ARM, "arm"))


def _angles(path: Path, frame: str) -> list[float]:
    """The angles about z of the transforms of a frame in a file, rad."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a recording without a footer is our choice
        chunks = list(rc.RrdReader(str(path)).stream())
    found = []
    for chunk in chunks:
        if str(chunk.entity_path) == f"/tf/{frame}":
            column = chunk.to_record_batch().column("Transform3D:quaternion").to_pylist()
            found += [2.0 * math.atan2(row[0][2], row[0][3]) for row in column]
    return found


def test_a_slider_moves_its_joint_and_those_that_follow_it_and_no_other(arm, tmp_path):
    """The viewer gets a transform of each link that has moved."""
    assert set(arm.sliders) == {"shoulder", "axle"}
    assert arm.positions == {"shoulder": 1.0, "elbow": -1.0, "axle": 0.0}
    arm.recording.set_sinks(rr.FileSink(tmp_path / "x.rrd"))
    arm.sliders["shoulder"].value = 1.25
    arm.recording.disconnect()
    assert arm.positions == {"shoulder": 1.25, "elbow": -1.25, "axle": 0.0}
    assert _angles(tmp_path / "x.rrd", "upper") == pytest.approx([1.25])
    assert _angles(tmp_path / "x.rrd", "lower") == pytest.approx([-1.25])
    assert not _angles(tmp_path / "x.rrd", "wheel")


def test_move_moves_the_sliders_and_refuses_what_no_joint_can_do(arm):
    """A joint without limits goes farther than its slider did at first."""
    arm.move({"shoulder": 0.75, "axle": 10.0})
    assert arm.positions == {"shoulder": 0.75, "elbow": -0.75, "axle": 10.0}
    assert arm.sliders["axle"].value == arm.sliders["axle"].max == 10.0
    for positions, problem in (
        ({"shoulder": 2.0}, 'joint "shoulder": 2 is beyond its limits, 0.5 to 1.5'),
        ({"elbow": 0.0}, 'joint "elbow" follows joint "shoulder"'),
        ({"sholder": 1.0}, 'no moving joint "sholder"'),
    ):
        with pytest.raises(OneBotError, match=problem):
            arm.move(positions)
    assert arm.positions == {"shoulder": 0.75, "elbow": -0.75, "axle": 10.0}


def test_what_cannot_be_drawn_is_warned_of(monkeypatch):
    """The rest is shown."""
    monkeypatch.setenv("RERUN_NOTEBOOK_ASSET", "http://127.0.0.1:9/widget.js")
    robot = load_description(CHECKOUT / "tests/robots/missing_mesh.urdf")
    with pytest.warns(UserWarning, match="not drawn but marked with a box"):
        NotebookRobot(robot)
