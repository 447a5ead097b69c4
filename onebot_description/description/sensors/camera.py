"""Color cameras, depth cameras, and RGB-D cameras."""

import math
from dataclasses import dataclass, replace
from typing import ClassVar, NamedTuple

from onebot_description.description.sensors.block import ANY, POSITIVE, Block, text_of
from onebot_description.description.sensors.kind import Kind, Substitute, joined
from onebot_description.description.sensors.noise import Noise, read_noise
from onebot_description.elements.reading import Element
from onebot_description.elements.sensor import SensorModel
from onebot_description.parameters.values import Rule


@dataclass(frozen=True)
class Camera(SensorModel):
    """A pinhole camera without distortion, looking along x."""

    field_of_view: float  # horizontal, rad
    width: int  # pixels
    height: int
    near: float  # m along the axis
    far: float
    depth_near: float  # near clip of depths, m along the axis
    depth_far: float  # far clip of depths
    noise: Noise = Noise()  # noise of colors (0 to 1), or of depths (m)
    baseline: float = 0.0  # distance from the left camera of a pair to this one, m
    blank: float = math.inf  # x, y and z of a point without a depth, as in gz sim

    @property
    def summary(self) -> str:
        return f"{self.width} × {self.height} pixels, {math.degrees(self.field_of_view):.4g}°"


class _Output(NamedTuple):
    """The message type of an output, and names of its topic below the camera's name."""

    message_type: str
    ros_2: str
    documented: str  # topic in the documentation of ROS 2's plugin
    tag: str  # the element that sets it in ROS 1


_IMAGE, _INFO = "sensor_msgs/msg/Image", "sensor_msgs/msg/CameraInfo"
_OUTPUTS = {
    "image": _Output(_IMAGE, "image_raw", "image_raw", "imageTopicName"),
    "depth": _Output(_IMAGE, "depth/image_raw", "image_depth", "depthImageTopicName"),
    "points": _Output("sensor_msgs/msg/PointCloud2", "points", "points", "pointCloudTopicName"),
    "camera_info": _Output(_INFO, "camera_info", "camera_info", "cameraInfoTopicName"),
    "depth_camera_info": _Output(
        _INFO, "depth/camera_info", "camera_info_depth", "depthImageCameraInfoTopicName"
    ),
}
_MAX_PIXELS = 1920 * 1200
_FIELD_OF_VIEW = Rule(at_least=0.01, at_most=3.0)
_NEAR, _FAR = ("near", 0.1, POSITIVE), ("far", 100.0, POSITIVE)
_LENS = "horizontal_fov image clip noise depth_camera optical_frame_id camera_info_topic pose "
_LOWS, _HIGHS = "min_depth pointCloudCutoff", "max_depth pointCloudCutoffMax"


class ColorCamera(Kind[Camera]):
    """How a color camera is described.

    Attributes:
        by_sensor: outputs of the <sensor>.
        by_plugin: outputs of a plugin that names topics.
    """

    types: ClassVar[tuple[str, ...]] = ("camera",)
    message_types = {output: spec.message_type for output, spec in _OUTPUTS.items()}
    frame_tags = ("optical_frame_id",)
    elements = {
        "sensor": f"{_LENS}camera",
        "camera": f"{_LENS}topic save visibility_mask",
        "depth_camera": "clip output",
        "image": "width height format anti_aliasing",
        "clip": "near far",
    }
    plugin_elements = (
        f"camera_name cameraName {' '.join(spec.tag for spec in _OUTPUTS.values())} "
        f"{_LOWS} {_HIGHS} hack_baseline hackBaseline border_crop borderCrop"
    )
    substitutes: ClassVar[tuple[Substitute, ...]] = (
        Substitute("camera", "camera", "camera", "30"),
    )
    by_sensor: ClassVar[tuple[str, ...]] = ("image", "camera_info")
    by_plugin: ClassVar[tuple[str, ...]] = ("image", "camera_info")

    def __init__(self, sensor: Element, plugin: Element | None) -> None:
        self._info = text_of(sensor, "camera_info_topic").strip("/")
        super().__init__(sensor, plugin)

    @staticmethod
    def read(block: Block) -> Camera:
        camera = block.child("camera")
        fov = block.number(camera, "horizontal_fov", 1.047, _FIELD_OF_VIEW)
        width = block.count(camera, "image/width", 320, _MAX_PIXELS)
        height = block.count(camera, "image/height", 240, _MAX_PIXELS)
        if width * height > _MAX_PIXELS and not block.wrong:
            size = f"{width:g} x {height:g} pixels are more than {_MAX_PIXELS} (1920 x 1200)"
            block.problem(f"{size}; lower <width> or <height>", camera.find("image"))
        near, far = depth = block.limits(camera, "clip", _NEAR, _FAR)
        if camera.find("depth_camera/clip") is not None:
            depth = block.limits(camera, "depth_camera/clip", _NEAR, _FAR)
        noise = read_noise(block, camera.find("noise"))
        return Camera(fov, width, height, near, far, *depth, noise)

    def limited(self, block: Block, model: Camera, plugin: Element, stddev: float) -> Camera:
        limits = model.depth_near, model.depth_far
        near, far = block.narrowed(plugin, _LOWS, _HIGHS, limits)
        has_limit = any(plugin.find(tag) is not None for tag in f"{_LOWS} {_HIGHS}".split())
        return replace(
            model,
            depth_near=near,
            depth_far=far,
            baseline=block.of_plugin(plugin, "hack_baseline hackBaseline", ANY) or 0.0,
            blank=math.nan if has_limit else math.inf,
        )

    def read_plugin(self, plugin: Element) -> dict[str, str]:
        name = text_of(plugin, "camera_name", "cameraName")
        written = {output: text_of(plugin, spec.tag) for output, spec in _OUTPUTS.items()}
        is_of_ros_1 = any(written.values())
        base = joined(self.space, name or ("" if is_of_ros_1 else self.sensor_name))
        rules, topics = len(self.idle), {}
        for output, (_, ros_2, documented, _) in _OUTPUTS.items():
            default = joined(base, written[output] or ros_2)
            topics[output] = self.remapped(base, (ros_2, documented), default)
        names_any = name or is_of_ros_1 or len(self.idle) < rules
        return topics if names_any or ("gazebo_ros" in self.file and not self.topic) else {}

    def made(self, rows: int) -> tuple[str, ...]:
        return self.by_plugin if self.named else self.by_sensor

    def topics(self, outputs: tuple[str, ...], below: str = "") -> dict[str, str]:
        topics = super().topics(outputs, below)
        return topics | {"camera_info": self._info} if self._info else topics

    def default_topics(self, outputs: tuple[str, ...], below: str) -> dict[str, str]:
        if self.topic:
            return self.below_topic(outputs)
        return {output: f"{below or 'camera'}/{spec.ros_2}" for output, spec in _OUTPUTS.items()}

    def below_topic(self, outputs: tuple[str, ...]) -> dict[str, str]:
        """Return the topics below the <topic> of the <sensor>, as in gz sim."""
        info = joined(self.topic.rpartition("/")[0], "camera_info")
        return {outputs[0]: self.topic, "camera_info": info, "points": f"{self.topic}/points"}


class DepthCamera(ColorCamera):
    """How a depth camera is described; its plugin also publishes colors."""

    types = ("depth", "depth_camera")
    substitutes = ()
    by_sensor = ("depth", "camera_info", "points")
    by_plugin = ("image", "depth", "camera_info", "points", "depth_camera_info")


class RgbdCamera(ColorCamera):
    """How an RGB-D camera is described."""

    types = ("rgbd", "rgbd_camera")
    substitutes = (Substitute("realsense|kinect|openni|depth|rgbd", "camera", "rgbd_camera", "30"),)
    by_sensor = by_plugin = ("image", "depth", "camera_info", "points")

    def below_topic(self, outputs: tuple[str, ...]) -> dict[str, str]:
        names = {output: f"{self.topic}/{output}" for output in outputs}
        return names | {"depth": f"{self.topic}/depth_image"}
