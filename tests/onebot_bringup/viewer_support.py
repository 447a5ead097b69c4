"""A small robot, its transforms, and meshes of one box in every format, for the viewer's tests."""

from pathlib import Path

import numpy as np
import trimesh
from nav_msgs.msg import Odometry
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from onebot_bringup.viewer.display_server import open_recording
from onebot_bringup.viewer.robot_view import RobotView
from onebot_bringup.viewer.view_config import parse_view
from onebot_description.ros.wire.definition import type_name
from onebot_description.ros.wire.message_arrays import TfArrays
from onebot_description.ros.wire.messages import time_message, transforms_message
from tests.ros_support import NodeProcess, ros_args

ORANGE = (255, 107, 10)
BLUE = (26, 76, 230)
START_NS = 1_700_000_000_000_000_000

# A blue box, and an orange cylinder one meter beside it; each with a larger collision shape.
ARM = Path(__file__).with_name("arm.urdf").read_text().strip()

# Looking along -x: +y is to the right in the picture.
VIEW = """
fixed_frame: base
axes: {visible: false}
grid: {visible: false}
camera: {eye: [2.6, 0.5, 0.0], target: [0.0, 0.5, 0.0]}
joint_plot: {positions: false, velocities: false}
"""


class Shown:
    """A view of the arm, whose tip stands 0.5 m along y of its base, drawn into a file."""

    def __init__(self, folder: Path, view="", *, robot=True, **options) -> None:
        self.file = folder / "x.rrd"
        self.bad: list[tuple[str, Exception]] = []  # messages that could not be decoded
        self._recording = open_recording(save=self.file)
        options.setdefault("report", lambda *args: self.bad.append(args))
        self.view = RobotView(self._recording.stream, parse_view(view), **options)
        self._offered: dict[str, str] = {}
        if robot:
            describe(self.view, ARM)
            take_tf(self.view, transforms("base", "tip", 0.5))

    def send(self, topic: str, *messages, at=START_NS) -> None:
        """Publish messages on a topic that is offered by itself."""
        for message in messages:
            if topic not in self._offered:
                self._offered[topic] = type_name(message)
                assert self.view.offer(self._offered) == []
            take(self.view, topic, message, at)

    def tick(self, at=START_NS) -> list[str]:
        """Draw what has come until then; returns what the user is told."""
        return self.view.tick(at)

    def look(self, view: str, at=START_NS) -> None:
        """Show it with other settings."""
        self.view.set_view(parse_view(view))
        self.view.tick(at)

    def end(self) -> Path:
        """Return the file, complete."""
        self.view.finish()
        self._recording.close()
        return self.file


def viewer_node(
    folder: Path, text: str | None = VIEW, /, *words: str, check: bool = True, **parameters: object
) -> NodeProcess:
    """The node, with this text as its view and any free ports; by default it writes x.rrd only."""
    usual = {"viewer": "none", "save": folder / "x.rrd", "grpc_port": 0, "web_port": 0}
    usual["open_browser"] = "false"
    if text is not None:
        usual["view"] = folder / "view.yaml"
        usual["view"].write_text(text)
    arguments = ros_args(**{**usual, **parameters})
    return NodeProcess("onebot_bringup.viewer.rerun_viewer", *arguments, *words, check=check)


def show(folder: Path, view: str, *messages) -> tuple[Path, list[str]]:
    """Show messages, (topic, message) each, beside the arm whose tip stands 0.5 m along y of base.

    Returns:
        The file with what was logged, and the warnings.
    """
    shown, said = Shown(folder, view), []
    shown.view.offer({topic: type_name(message) for topic, message in messages})
    for number, (topic, message) in enumerate(messages):
        take(shown.view, topic, message, START_NS + number)
        said += shown.tick(START_NS + number * 10**9)
    file = shown.end()
    assert not shown.bad
    return file, said


def drawn(folder: Path, view: str, *messages) -> Path:
    """Return the file of ``show``, which warns of nothing."""
    file, warnings = show(folder, view, *messages)
    assert warnings == []
    return file


def transforms(parent, child, y, stamp_ns=START_NS):
    """One transform: ``child`` stands ``y`` meters along y of ``parent``."""
    return TfArrays(
        (parent,),
        (child,),
        np.array([stamp_ns]),
        np.array([[0.0, y, 0.0]]),
        np.array([[0.0, 0.0, 0.0, 1.0]]),
    )


def stamped(message, stamp_ns=START_NS, frame="tip"):
    """The message with a header."""
    message.header.frame_id, message.header.stamp = frame, time_message(stamp_ns)
    return message


def take(view: RobotView, topic: str, message, stamp_ns=START_NS) -> None:
    """Give a view a message, received at ``stamp_ns``."""
    view.take(topic, type_name(message), bytes(serialize_message(message)), stamp_ns)


def describe(view: RobotView, urdf: str) -> None:
    """Give it a description, which the next ``tick`` shows."""
    take(view, "robot_description", String(data=urdf))


def take_tf(view: RobotView, arrays: TfArrays, *, static=False) -> None:
    """Give it transforms of one stamp."""
    [stamp_ns] = {*arrays.stamps_ns.tolist()}
    values = np.hstack([arrays.translations, arrays.rotations])
    message = transforms_message(time_message(stamp_ns), arrays.parents, arrays.children, values)
    data = bytes(serialize_message(message))
    view.take("/tf_static" if static else "/tf", "tf2_msgs/msg/TFMessage", data, stamp_ns)


def take_joints(view: RobotView, stamp_ns: int, names, positions, velocities=()) -> None:
    """Give it joint states."""
    message = JointState(
        name=list(names), position=list(map(float, positions)), velocity=list(velocities)
    )
    take(view, "joint_states", stamped(message, stamp_ns), stamp_ns)


def take_odometry(view: RobotView, topic: str, stamp_ns: int, message: Odometry) -> None:
    """Give it an Odometry message of that time."""
    message.header.stamp = time_message(stamp_ns)
    take(view, topic, message, stamp_ns)


def box() -> trimesh.Trimesh:
    """A box of 1.0 x 0.6 x 0.3 m."""
    return trimesh.creation.box(extents=(1.0, 0.6, 0.3))


def write_collada(path: Path, meter: float, up_axis: str) -> Path:
    """Write ``box()`` as Collada in units of ``meter``; half of it orange, half blue."""
    mesh, parts = box().apply_scale(1.0 / meter), []
    for faces, rgb in zip(np.split(mesh.faces, 2), (ORANGE, BLUE), strict=True):
        part = trimesh.Trimesh(mesh.vertices, faces, process=False)
        material = trimesh.visual.material.PBRMaterial(baseColorFactor=(*rgb, 255))
        part.visual = trimesh.visual.TextureVisuals(material=material)
        parts.append(part)
    text = trimesh.exchange.dae.export_collada(parts).decode()
    unit = f'<unit name="u" meter="{meter}"/><up_axis>{up_axis}</up_axis>'
    path.write_text(text.replace("<up_axis>Y_UP</up_axis>", unit))
    return path


def write_obj(path: Path, material: str | None = None) -> Path:
    """Write ``box()`` as OBJ, with a .mtl of one orange material if it is named."""
    mesh = box()
    lines = []
    if material is not None:
        path.with_suffix(".mtl").write_text(f"newmtl {material}\nKd 1.0 0.42 0.04\n")
        lines += [f"mtllib {path.with_suffix('.mtl').name}", f"usemtl {material}"]
    lines += [f"v {x} {y} {z}" for x, y, z in mesh.vertices]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in mesh.faces]
    path.write_text("\n".join(lines) + "\n")
    return path
