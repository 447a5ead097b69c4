"""Pictures as ``onebot snapshot`` makes them: right, whole, and the same every time."""

import re
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import psutil
import pytest
from PIL import Image

from onebot_bringup.cli.pictures import record_pose
from onebot_bringup.viewer import rendering
from onebot_bringup.viewer.display_server import open_recording
from onebot_bringup.viewer.rendering import headless_viewer, still
from onebot_description.description import load_description
from onebot_description.description.loading import load_world
from onebot_description.errors import OneBotError
from onebot_description.model import RobotModel
from tests.onebot_bringup.viewer_support import ARM, BLUE, ORANGE, VIEW, Shown
from tests.support import run_to_end, wait_for
from tests.support_rendering import center, colored, pixels, require_renderer

pytestmark = pytest.mark.slow

SIZE = ("--width", "480", "--height", "320")


@pytest.fixture
def arm(tmp_path: Path) -> Path:
    """A blue box with an orange cylinder beside it, seen along -x: +y is to the right."""
    require_renderer()
    (tmp_path / "view.yaml").write_text(VIEW)
    (tmp_path / "arm.urdf").write_text(ARM)
    return tmp_path


def snapshot(*words: str | Path) -> subprocess.CompletedProcess[str]:
    """Run the command to its end."""
    command = [sys.executable, "-m", "onebot_bringup.cli.main", "snapshot"]
    return run_to_end([*command, *map(str, words), *SIZE])


def drawn(folder: Path, *words: str | Path, name: str = "a.png"):
    done = snapshot(folder / name, *words)
    assert done.returncode == 0, done.stderr
    assert f"wrote {folder / name} (480 x 320)" in done.stdout
    return pixels(folder / name)


def _arm(folder: Path, *words: str) -> tuple[str | Path, ...]:
    return (folder / "arm.urdf", "--view", folder / "view.yaml", *words)


def test_joints_and_camera_stand_where_they_are_told(arm):
    """In place of an older picture."""
    (arm / "a.png").write_text("an old one")
    files = {entry.name for entry in arm.iterdir()}
    front = drawn(arm, *_arm(arm, "--joints", "slide=1.0"))
    assert Image.open(arm / "a.png").format == "PNG" and front.shape == (320, 480, 3)
    assert {entry.name for entry in arm.iterdir()} == files, "nothing else is left there"
    # The cylinder is a meter to the right of the box, which it is in at 0.
    assert center(colored(front, ORANGE))[0] > center(colored(front, BLUE))[0] + 0.2
    # From the other side, left is right; the middle of the picture is what the camera looks at.
    camera = ("--camera", "-2.6,0.5,0:0,0.5,0")
    back = drawn(arm, *_arm(arm, "--joints", "slide=1.0"), *camera, name="2.png")
    assert center(colored(front, ORANGE))[0] > 0.5 > center(colored(back, ORANGE))[0]
    sides = [center(colored(back, color))[0] - 0.5 for color in (ORANGE, BLUE)]
    assert sum(sides) == pytest.approx(0.0, abs=0.03)


def test_a_busy_viewer_is_waited_for(arm, tmp_path, monkeypatch):
    """Until its own deadline, with what it waits for; and the layout of one pose has no plot."""
    description = load_description(arm / "arm.urdf")
    model = RobotModel.from_description(description)
    positions = model.pose({})
    recording = open_recording(save=tmp_path / "pose.rrd")
    record_pose(description, positions, "", recording.stream)
    recording.close()
    said: list[str] = []
    with headless_viewer(str(tmp_path / "pose.rrd"), 480, 320, said.append) as client:
        assert [view.name for view in client.get_state().views] == ["Robot"]
        [viewer] = [c for c in psutil.Process().children() if "--headless" in c.cmdline()]
        viewer.suspend()
        resumed = threading.Thread(
            target=lambda: wait_for(lambda: "viewer is busy" in said[-1], "it") and viewer.resume()
        )
        said.append("")
        resumed.start()
        assert client.take_screenshot()
        resumed.join()
        assert re.fullmatch(r"waiting for the picture: the viewer is busy \(\d+ s\)", said[-1])
        monkeypatch.setattr(rendering, "PATIENCE", 3.0)
        viewer.suspend()
        with pytest.raises(OneBotError, match="the viewer has not answered for 3 s"):
            still(client, said.append)
        viewer.resume()


def test_the_end_of_a_recording(arm, tmp_path):
    """A recording that was cut short by a crash is refused, and named."""
    shown = Shown(tmp_path, VIEW)
    assert shown.tick() == []
    rrd = shown.end()
    whole = drawn(arm, rrd)
    assert center(colored(whole, ORANGE))[0] > center(colored(whole, BLUE))[0]
    with rrd.open("ab") as file:
        file.write(rrd.read_bytes()[100:150])  # as far as a message got
    done = snapshot(arm / "b.png", rrd)
    assert done.returncode == 1, done.stderr
    assert f"{rrd} cannot be shown: " in done.stderr


PLATE = (
    '<link name="base_link"><visual><geometry><box size="0.2 0.2 0.02"/></geometry></visual></link>'
)


@pytest.mark.parametrize("source", ["plate.urdf", "maze", "plate.rrd"])
def test_a_picture_of_what_never_moves(source: str, tmp_path: Path) -> None:
    """All of it is static, without any time that the viewer could go to."""
    require_renderer()
    (tmp_path / "plate.urdf").write_text(f'<robot name="plate">{PLATE}</robot>')
    description = load_world(source) if "." not in source else None
    path = description.source if description else str(tmp_path / source)
    if path.endswith(".rrd"):
        plate = load_description(tmp_path / "plate.urdf")
        recording = open_recording(save=Path(path))
        record_pose(plate, RobotModel.from_description(plate).pose({}), "", recording.stream)
        recording.close()
    image = drawn(tmp_path, path)
    assert np.ptp(image, axis=(0, 1)).max() > 50, "something is drawn"
