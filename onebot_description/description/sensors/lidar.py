"""Range finders: lidars of one or several rows of rays, sonars and cliff sensors."""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

from onebot_description.description.sensors.block import (
    NOT_NEGATIVE,
    POSITIVE,
    Block,
    is_false,
    text_of,
)
from onebot_description.description.sensors.kind import Kind, Substitute, joined
from onebot_description.description.sensors.noise import Noise, read_noise
from onebot_description.elements.reading import Element
from onebot_description.elements.sensor import SensorModel
from onebot_description.parameters.values import Rule

RADIATIONS = ("ultrasound", "infrared")  # ordered like the constants of sensor_msgs/msg/Range


class Fan(NamedTuple):
    """Ray directions evenly spread over an angle, including both ends."""

    samples: int = 1
    lower: float = 0.0  # first angle, rad
    upper: float = 0.0  # last angle, rad


@dataclass(frozen=True)
class Lidar(SensorModel):
    """A range finder whose rays are in rows; x ahead, z up."""

    horizontal: Fan  # rays of a row, about z
    vertical: Fan  # rows, upwards
    range_min: float  # m
    range_max: float  # m
    noise: Noise = Noise()
    is_organized: bool = True  # whether clouds have points for rays that hit nothing, too
    radiation: str = "infrared"  # one of RADIATIONS, for Range messages
    cone: float = 0.0  # field of view of Range messages, rad; 0: the angle of the rays

    @property
    def field_of_view(self) -> float:
        """Field of view of Range messages: as set, or the maximum angle between rays, rad."""
        spans = (fan.upper - fan.lower for fan in (self.horizontal, self.vertical))
        return self.cone or max(spans)

    @property
    def rays(self) -> tuple[int, int]:
        return self.vertical.samples, self.horizontal.samples

    @property
    def summary(self) -> str:
        rows, columns = self.rays
        ranges = f"{columns} {'range' if columns == 1 else 'ranges'} to {self.range_max:.4g} m"
        return f"{rows} × {ranges}" if rows > 1 else ranges


_MAX_RAYS = 300_000
_TURN = 2 * math.pi + 1e-3  # full turns are written with few digits
_ANGLE = Rule(at_least=-_TURN, at_most=_TURN)
_RANGE_MIN, _RANGE_MAX = ("min", 0.0, NOT_NEGATIVE), ("max", None, POSITIVE)
_MESSAGES = {
    "scan": "sensor_msgs/msg/LaserScan",
    "points": "sensor_msgs/msg/PointCloud2",
    "point_cloud": "sensor_msgs/msg/PointCloud",
    "range": "sensor_msgs/msg/Range",
}
# The output of a plugin that names a message type of sensor_msgs.
_BY_TYPE = {message.rpartition("/")[2]: output for output, message in _MESSAGES.items()}
# The output of other plugins: that of the first of these words in the name of the plugin's file.
_WORDS = {
    "points": "ray_sensor velodyne ouster livox",
    "point_cloud": "block_laser",
    "scan": "laser",
    "range": "range sonar",
}


def _fan(tag: str, samples: int, angle: float) -> str:
    angles = f"<min_angle>-{angle}</min_angle><max_angle>{angle}</max_angle>"
    return f"<{tag}><samples>{samples}</samples>{angles}</{tag}>"


def _inside(tag: str, fans: str, range_min: float, range_max: float) -> str:
    limits = f"<range><min>{range_min}</min><max>{range_max}</max></range>"
    return f"<{tag}><scan>{fans}</scan>{limits}</{tag}>"


# The content of the blocks that replace plugins.
_PLANE, _ROWS = _fan("horizontal", 360, 3.14), _fan("vertical", 16, 0.26)
_IN_PLANE = _inside("lidar", _PLANE, 0.1, 12)
_IN_ROWS = _inside("lidar", _PLANE + _ROWS, 0.1, 12)
_CONE = _inside("ray", _fan("horizontal", 5, 0.1), 0.02, 4)
_CONE += '<plugin name="range" filename="libgazebo_ros_range.so"/>'


class LidarKind(Kind[Lidar]):
    """How a range finder is described."""

    types = ("lidar", "gpu_lidar", "ray", "gpu_ray")
    message_types = _MESSAGES
    elements = {
        "sensor": "ray lidar",
        **dict.fromkeys(("ray", "lidar"), "scan range noise visibility_mask"),
        "scan": "horizontal vertical",
        **dict.fromkeys(("horizontal", "vertical"), "samples resolution min_angle max_angle"),
        "range": "min max resolution",
    }
    plugin_elements = (
        "topicName output_type outputType min_range max_range gaussianNoise gaussian_noise "
        "radiation_type radiationType radiation fov organize_cloud"
    )
    substitutes = (
        Substitute("velodyne|ouster|livox", "lidar", "gpu_lidar", "10", _IN_ROWS),
        Substitute(r"sonar|ultrasonic|(?<![a-z])range", "range", "ray", "10", _CONE),
        Substitute("laser|lidar|hokuyo|ray_sensor", "lidar", "gpu_lidar", "10", _IN_PLANE),
    )
    _made = ""  # the output of the plugin

    @staticmethod
    def read(block: Block) -> Lidar:
        ray = block.child("ray", "lidar")
        across, up = (_read_fan(block, ray, f"scan/{axis}") for axis in ("horizontal", "vertical"))
        range_min, range_max = block.limits(ray, "range", _RANGE_MIN, _RANGE_MAX)
        if across.samples * up.samples > _MAX_RAYS and not block.wrong:
            rays = f"{across.samples} x {up.samples} rays are more than {_MAX_RAYS}"
            block.problem(f"{rays}; lower <samples>")
        noise = read_noise(block, block.element.find(".//noise"))  # some have it beside <ray>
        return Lidar(across, up, range_min, range_max, noise)

    def limited(self, block: Block, model: Lidar, plugin: Element, stddev: float) -> Lidar:
        limits = model.range_min, model.range_max
        range_min, range_max = block.narrowed(plugin, "min_range", "max_range", limits)
        is_range = self._made == "range"
        return replace(
            model,
            range_min=range_min,
            range_max=range_max,
            noise=model.noise.plus(stddev),
            is_organized=not is_false(text_of(plugin, "organize_cloud")),
            cone=(is_range and block.of_plugin(plugin, "fov", NOT_NEGATIVE)) or 0.0,
            radiation=_radiation(plugin) if is_range else "infrared",
        )

    @property
    def publishes(self) -> bool:
        return super().publishes or bool(self._made or self.fault)

    def read_plugin(self, plugin: Element) -> dict[str, str]:
        if kind := text_of(plugin, "output_type", "outputType"):
            self._made = _BY_TYPE.get(kind.rpartition("/")[2], "")
            if not self._made:
                text = f"asks for {kind}, which rays cannot provide, so it publishes nothing"
                types = ", ".join(f"sensor_msgs/{type_name}" for type_name in _BY_TYPE)
                self.fault = f"{text}; write one of: {types}"
        else:
            outputs = ((output, word) for output, words in _WORDS.items() for word in words.split())
            self._made = next((output for output, word in outputs if word in self.file), "")
        return super().read_plugin(plugin)

    def made(self, rows: int) -> tuple[str, ...]:
        if self.fault or self._made:
            return () if self.fault else (self._made,)
        outputs = ("points", "scan") if rows > 1 else ("scan", "points")
        return outputs[:1] if self.named else outputs

    def default_topics(self, outputs: tuple[str, ...], below: str) -> dict[str, str]:
        topic = self.topic or joined(below, outputs[0].replace("point_cloud", "points"))
        names = dict.fromkeys(outputs, topic)
        if self.topic or outputs[0] == "scan":
            names["points"] = f"{topic}/points"
        elif "scan" in outputs:
            names["scan"] = f"{below or self.sensor_name}/scan"
        return names


def _read_fan(block: Block, ray: Element, path: str) -> Fan:
    element = ray.find(path)
    if element is None:
        if path.endswith("horizontal"):
            block.problem(f"has no <{path}>; write its <samples>, <min_angle> and <max_angle>")
        return Fan()
    samples = block.count(element, "samples", None, _MAX_RAYS)
    count = max(1, round(samples * block.number(element, "resolution", 1.0, POSITIVE)))
    lower = block.number(element, "min_angle", 0.0, _ANGLE)
    upper = block.number(element, "max_angle", 0.0, _ANGLE)
    if count > 1:
        block.check_order(ray, path, ("min_angle", lower), ("max_angle", upper))
        if upper - lower > _TURN:
            block.problem("min_angle to max_angle is more than a turn (6.2832 rad)", element)
    return Fan(count, lower, upper)


def _radiation(plugin: Element) -> str:
    """Return the radiation of a plugin that publishes Range messages."""
    text = text_of(plugin, "radiation_type", "radiationType", "radiation")
    file = plugin.get("filename", "")
    is_sonar = not text and ("gazebo_ros_range" in file or "sonar" in file)
    return "ultrasound" if is_sonar or text in ("ultrasound", "ultrasonic") else "infrared"
