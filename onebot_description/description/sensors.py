"""Reads sensors: the ``<gazebo reference="LINK"><sensor>`` blocks of gz sim and Gazebo classic.

They mean what SDFormat specifies; topics and frames may be named in any way that gz sim or the ROS
plugins of Gazebo classic support. A sensor with a fault is left out, and reported as a problem.
"""

import math
import operator
import re
from collections.abc import Collection, Iterable, Mapping
from dataclasses import fields, replace

from onebot_description.description.description import (
    Camera,
    Fan,
    Imu,
    Joint,
    Lidar,
    Noise,
    Reference,
    Sensor,
    clashes,
)
from onebot_description.description.frames import Frames, placed
from onebot_description.description.misplaced_sensors import warn_of_misplaced
from onebot_description.description.reading import Element, Findings, number_fault
from onebot_description.description.sensor_outputs import (
    CAMERA,
    DEPTH,
    IMU,
    LIDAR,
    OUTPUT_TYPES,
    RGBD,
    Outputs,
    is_false,
    publishing,
    text_of,
    word_of,
)
from onebot_description.errors import did_you_mean
from onebot_description.geometry.poses import ZERO, Origin, Triple
from onebot_description.ros.parameters.values import Rule, ValueType

_KINDS = {
    **dict.fromkeys(("lidar", "gpu_lidar", "ray", "gpu_ray"), LIDAR),
    **dict.fromkeys(("depth", "depth_camera"), DEPTH),
    **dict.fromkeys(("rgbd", "rgbd_camera"), RGBD),
    "imu": IMU,
    "camera": CAMERA,
}
_MOST_RAYS, _MOST_PIXELS = 300_000, 1920 * 1200
_TURN = 2 * math.pi + 1e-3  # full turns are written with few digits

_RATES = ("update_rate", "updateRate", "updateRateHZ")  # the last two are plugins'
# Values that are read, by their path: default (None: required) and rule.
_POSITIVE, _NOT_NEGATIVE, _ANY = Rule(above=0.0), Rule(at_least=0.0), Rule()
_ANGLE, _COUNT = Rule(at_least=-_TURN, at_most=_TURN), Rule(at_least=1, at_most=_MOST_PIXELS)
_VALUES: Mapping[str, tuple[float | None, Rule]] = {
    **dict.fromkeys(_RATES, (0.0, Rule(at_least=0.0, at_most=1000.0))),
    "samples": (None, Rule(at_least=1, at_most=_MOST_RAYS)),
    "resolution": (1.0, _POSITIVE),
    "min_angle": (0.0, _ANGLE),
    "max_angle": (0.0, _ANGLE),
    "range/min": (0.0, _NOT_NEGATIVE),
    "range/max": (None, _POSITIVE),
    "horizontal_fov": (1.047, Rule(at_least=0.01, at_most=3.0)),
    "image/width": (320, _COUNT),
    "image/height": (240, _COUNT),
    "near": (0.1, _POSITIVE),
    "far": (100.0, _POSITIVE),
    # Of noise, in the order of the fields of Noise.
    "mean": (0.0, _ANY),
    "stddev": (0.0, _NOT_NEGATIVE),
    "bias_mean": (0.0, _ANY),
    "bias_stddev": (0.0, _NOT_NEGATIVE),
    "precision": (0.0, _NOT_NEGATIVE),
    # Of plugins.
    **dict.fromkeys(("min_range", "min_depth", "pointCloudCutoff"), (0.0, _NOT_NEGATIVE)),
    **dict.fromkeys(("max_range", "max_depth", "pointCloudCutoffMax"), (0.0, _POSITIVE)),
    **dict.fromkeys(("gaussianNoise", "gaussian_noise"), (0.0, _NOT_NEGATIVE)),
    **dict.fromkeys(("hackBaseline", "hack_baseline"), (0.0, _ANY)),
    "fov": (0.0, _NOT_NEGATIVE),
}
_WHOLE = ("samples", "image/width", "image/height")
# The elements in each that are read, or have no effect here.
_LENS = "horizontal_fov image clip noise depth_camera optical_frame_id camera_info_topic pose "
_KNOWN = {
    "sensor": f"{_LENS}update_rate topic plugin camera ray lidar imu gz_frame_id ignition_frame_id "
    "frame_id always_on visualize enable_metrics",
    "ray": "scan range noise visibility_mask",
    "lidar": "scan range noise visibility_mask",
    "scan": "horizontal vertical",
    "horizontal": "samples resolution min_angle max_angle",
    "vertical": "samples resolution min_angle max_angle",
    "range": "min max resolution",
    "camera": f"{_LENS}topic save visibility_mask",
    "depth_camera": "clip output",
    "image": "width height format anti_aliasing",
    "clip": "near far",
    "imu": "angular_velocity linear_acceleration noise orientation_reference_frame topic "
    "enable_orientation",
    "orientation_reference_frame": "localization custom_rpy",
}
_OF_CAMERA_PLUGIN = (
    "camera_name cameraName imageTopicName depthImageTopicName pointCloudTopicName "
    "cameraInfoTopicName depthImageCameraInfoTopicName min_depth max_depth pointCloudCutoff "
    "pointCloudCutoffMax hack_baseline hackBaseline border_crop borderCrop"
)
_KNOWN_IN_PLUGIN = {
    LIDAR: "topicName output_type outputType min_range max_range gaussianNoise gaussian_noise "
    "radiation_type radiationType radiation fov organize_cloud",
    IMU: "topicName gaussianNoise",
    **dict.fromkeys((CAMERA, DEPTH, RGBD), _OF_CAMERA_PLUGIN),
}
_KNOWN_IN_ANY_PLUGIN = (
    "ros namespace remapping argument qos robotNamespace frame_name frameName gz_frame_id "
    "ignition_frame_id frame_id always_on alwaysOn visualize"
)
_NOTHING = ("0", "false", "none", "")  # values of a plugin's child that ask for nothing
_RADIATIONS = {
    "ultrasound": "ultrasound",
    "ultrasonic": "ultrasound",
    "infrared": "infrared",
    "infared": "infrared",  # as the plugin of ROS 1 spells it
}
_FRAMES = ("gz_frame_id", "ignition_frame_id", "frame_id", "frame_name", "frameName")
_TOPIC = Rule(
    pattern=re.compile(r"/?[A-Za-z_]\w*(/[A-Za-z_]\w*)*", re.ASCII),
    write="a ROS name: words of letters, digits and _ that do not start with a digit, joined by /",
)
# Reference axes that an IMU may name, in the world: x east, y north, z up (REP-103).
_AXES: Mapping[str, Triple] = {
    "ENU": (0.0, 0.0, 0.0),
    "NED": (math.pi, 0.0, math.pi / 2.0),
    "NWU": (0.0, 0.0, math.pi / 2.0),
}
_CUSTOM, _BY_GRAVITY = "CUSTOM", ("GRAV_UP", "GRAV_DOWN")
# A sensor may differ this much from the frame of its messages; 1.57 for a quarter turn is no fault.
_APART, _TURNED = 1e-3, 1e-2  # m, rad


def read_sensors(
    findings: Findings, links: Collection[str], joints: Iterable[Joint]
) -> tuple[tuple[Sensor, ...], tuple[str, ...]]:
    """Read the sensors of a document.

    Args:
        findings: of the document; faults are added.
        links: of the robot.
        joints: of the robot.

    Returns:
        The sensors, and the names of unreadable ones.
    """
    root = findings.document.root
    parents = [root] if root.tag == "gazebo" else root.findall("gazebo")
    joints = [*joints]
    frames = Frames(links, joints)
    blocks = [
        _Block(findings, element, parent, frames)
        for parent in parents
        for element in parent.iterfind("sensor")
    ]
    warn_of_misplaced(findings, parents, links)
    blocks = [block for block in blocks if block.kind]
    for block in blocks:
        block.read(links)
    published = list[tuple[dict[str, str], _Block]]()
    sensors = list[Sensor]()
    for block in blocks:
        found = [] if block.wrong else block.sensors(blocks)
        for sensor in found:
            topics = {output: topic.lstrip("/") for output, topic in sensor.topics.items()}
            block.compare(topics, published)
            published.append((topics, block))
        if not block.wrong:
            block.warn_of_frames(found, links, joints)
            sensors.extend(found)
    bad = dict.fromkeys(block.name for block in blocks if block.wrong)
    return tuple(sensors), tuple(bad)


class _Block:
    """One <sensor> while it is read, with its faults."""

    def __init__(
        self, findings: Findings, element: Element, parent: Element, frames: Frames
    ) -> None:
        self._findings, self._element, self._frames = findings, element, frames
        self._link, self.wrong = parent.get("reference", ""), False
        self.name, self.place = element.get("name", "").strip(), findings.where(element)
        kind = element.get("type", "")
        self.kind = _KINDS.get(kind, "")
        self.outputs = publishing(element, self.kind) if self.kind else []
        if not kind:
            self.problem(f"has no type; write one of: {', '.join(_KINDS)}")
        elif not self.kind:
            hint = did_you_mean(kind, _KINDS, "simulated")
            findings.warning(element, f'sensors of type "{kind}" are not simulated{hint}')

    def problem(self, text: str, element: Element | None = None) -> None:
        """Report a problem, because of which the sensor is left out."""
        self.wrong = True
        self._findings.problem(self._element if element is None else element, text)

    def read(self, links: Collection[str]) -> None:
        """Read what the sensor measures."""
        if not self._link:
            self.problem('lies in no link; write <gazebo reference="LINK"> around it')
        elif self._link not in links:
            hint = self._findings.hint(self._link, links, "links")
            self.problem(f'there is no link "{self._link}"{hint}')
        if not self.name:
            self.problem('has no name; write <sensor name="...">')
        self._warn_of_unknown(self._element)
        for plugin in self._element.iterfind("plugin"):
            self._warn_of_unread(plugin)
        self._pose = self._read_pose()
        self._model = self._read_model()
        self._rate = self._number(self._element, "update_rate")

    def _rays(self) -> tuple[int, int]:
        """Return the number of rows of a lidar, and of rays in each row."""
        model = self._model
        return (
            (model.vertical.samples, model.horizontal.samples)
            if isinstance(model, Lidar)
            else (1, 1)
        )

    def sensors(self, blocks: Iterable["_Block"]) -> list[Sensor]:
        """Return one sensor for each publishing plugin; unusable if the block is ``wrong`` then.

        ``blocks`` are all blocks of the robot.
        """
        return [
            self._sensor(outputs, topics)
            for outputs in self.outputs
            if (topics := self._topics(outputs, blocks))
        ]

    def _topics(self, outputs: Outputs, blocks: Iterable["_Block"]) -> dict[str, str]:
        made = outputs.made(self._rays()[0])
        if not made:
            text = f"asks for {outputs.unknown_type}, which cannot be made of rays, so it"
            types = ", ".join(f"sensor_msgs/{each}" for each in OUTPUT_TYPES)
            text += f" publishes nothing; write one of: {types}"
            self._findings.warning(outputs.plugin or self._element, text)
            return {}
        written = outputs.topics(made, self._above(outputs, blocks))
        topics = {output: self._checked(topic) for output, topic in written.items()}
        names = [topics[output].lstrip("/") for output in made if output != "depth_camera_info"]
        twice = next((name for name in names if names.count(name) > 1), "")
        if twice and not self.wrong:
            self.problem(f'publishes two things on "{twice}"; give each a topic of its own')
        return topics

    def _above(self, outputs: Outputs, blocks: Iterable["_Block"]) -> str:
        """Return a prefix for topics that other sensors would have, too; "" if there are none."""
        defaults, rays = outputs.defaults(self._rays()[0]), self._rays()
        rivals = [(block, block.rivals(defaults, rays)) for block in blocks]
        if sum(count for _, count in rivals) < 2:
            return ""
        name = word_of(self.name)
        twin = any(
            count and block.name == self.name and block is not self for block, count in rivals
        )
        return f"{word_of(self._link)}/{name}" if twin else name

    def rivals(self, defaults: Collection[str], rays: tuple[int, int]) -> int:
        """Return how many of its plugins also have one of these default topics.

        A single ray, as of a cliff sensor, does not compete with a scan of many ``rays``.
        """
        if self._rays() == (1, 1) != rays:
            return 0
        rows = self._rays()[0]
        return sum(not each.defaults(rows).isdisjoint(defaults) for each in self.outputs)

    def _sensor(self, outputs: Outputs, topics: dict[str, str]) -> Sensor:
        model, rate, plugin = self._model, self._rate, outputs.plugin
        frame = text_of(self._element, "optical_frame_id") if isinstance(model, Camera) else ""
        if plugin is not None:
            rate = rate or next(filter(None, (self._number(plugin, tag) for tag in _RATES)), 0.0)
            frame = frame or text_of(plugin, *_FRAMES)
            model = self._as_published(model, plugin, topics)
        frame = frame or text_of(self._element, *_FRAMES) or self._link
        frame = frame.lstrip("/")  # ROS 1 wrote it; tf2 refuses it
        return Sensor(self.name, self._link, self._pose, rate, topics, frame, model, self.place)

    def _as_published(
        self, model: Lidar | Camera | Imu, plugin: Element, topics: Collection[str]
    ) -> Lidar | Camera | Imu:
        """Return the sensor's model, changed by the limits and options of a plugin."""
        stddev = self._of_plugin(plugin, "gaussianNoise", "gaussian_noise") or 0.0
        if isinstance(model, Imu):
            rates, accelerations = (
                (_noisier(x, stddev), _noisier(y, stddev), _noisier(z, stddev))
                for x, y, z in (model.angular_velocity, model.linear_acceleration)
            )
            return replace(model, angular_velocity=rates, linear_acceleration=accelerations)
        if isinstance(model, Camera):
            lows, highs = ("min_depth", "pointCloudCutoff"), ("max_depth", "pointCloudCutoffMax")
            near, far = self._narrowed(plugin, lows, highs, model.depth_near, model.depth_far)
            return replace(
                model,
                depth_near=near,
                depth_far=far,
                baseline=self._of_plugin(plugin, "hack_baseline", "hackBaseline") or 0.0,
                blank=math.nan
                if any(plugin.find(tag) is not None for tag in (*lows, *highs))
                else math.inf,
            )
        least, greatest = self._narrowed(
            plugin, ("min_range",), ("max_range",), model.least, model.greatest
        )
        model = replace(
            model,
            least=least,
            greatest=greatest,
            noise=_noisier(model.noise, stddev),
            is_organized=not is_false(text_of(plugin, "organize_cloud")),
        )
        if "range" not in topics:
            return model
        cone = self._of_plugin(plugin, "fov") or 0.0
        return replace(model, cone=cone, radiation=self._radiation(plugin))

    def _of_plugin(self, plugin: Element, *tags: str) -> float | None:
        """Return the value of the first of these elements that a plugin has."""
        written = (tag for tag in tags if plugin.find(tag) is not None)
        return next((self._number(plugin, tag) for tag in written), None)

    def _narrowed(
        self,
        plugin: Element,
        lows: tuple[str, ...],
        highs: tuple[str, ...],
        least: float,
        greatest: float,
    ) -> tuple[float, float]:
        """Return a range, narrowed by the limits in a plugin."""
        low, high = self._of_plugin(plugin, *lows), self._of_plugin(plugin, *highs)
        if low is None and high is None:
            return least, greatest
        limits = max(least, low or 0.0), min(greatest, math.inf if high is None else high)
        if not limits[0] < limits[1] and not self.wrong:
            names = " and ".join(
                f"<{tag}>" for tag in (*lows, *highs) if plugin.find(tag) is not None
            )
            text = f"{names} leave nothing of {least:g} to {greatest:g} m, which is measured"
            self.problem(f"{text}; change them", plugin)
        return limits

    def _radiation(self, plugin: Element) -> str:
        file = plugin.get("filename", "")
        text = text_of(plugin, "radiation_type", "radiationType", "radiation")
        if text and text not in _RADIATIONS:
            kinds = "ultrasound, infrared"
            fault = f'has the unknown radiation "{text}", so it is infrared; write one of: {kinds}'
            self._findings.warning(plugin, fault)
        is_sonar = not text and ("gazebo_ros_range" in file or "sonar" in file)
        return "ultrasound" if is_sonar else _RADIATIONS.get(text, "infrared")

    def compare(
        self, topics: Mapping[str, str], published: Iterable[tuple[Mapping[str, str], "_Block"]]
    ) -> None:
        """Report topics that another sensor has ``published`` already."""
        for others, block in published:
            place = f"the one at {block.place}" if block is not self else "another plugin of it"
            for topic in clashes(others, topics)[:1]:
                text = f'publishes "{topic}", as {place} does'
                self.problem(f"{text}; give it a <topic> of its own")
            info = topics.get("camera_info", "")
            if not self.wrong and info and info in others.values():
                text = f'its CameraInfo is on "{info}", as that of {place} is'
                text += "; to tell them apart, write a <camera_info_topic> in it"
                self._findings.warning(self._element, text)
                return

    def warn_of_frames(
        self, sensors: Iterable[Sensor], links: Collection[str], joints: Iterable[Joint]
    ) -> None:
        """Warn once of each frame that is wrong for the messages of these sensors."""
        for sensor in {sensor.frame: sensor for sensor in sensors}.values():
            self._warn_of_frame(sensor, links, joints)

    def _warn_of_frame(
        self, sensor: Sensor, links: Collection[str], joints: Iterable[Joint]
    ) -> None:
        """Warn if the frame of the messages is not a link, or not at the sensor.

        It is no fault for images, which have an optical frame, and clouds, which are converted.
        """
        if sensor.frame not in links:
            hint = self._findings.hint(sensor.frame, links, "links")
            text = f'no link is called "{sensor.frame}", the frame of its messages{hint}'
            self._findings.warning(self._element, text)
            return
        is_there = sensor.frame == sensor.link and sensor.origin == Origin()
        if is_there or next(iter(sensor.topics)) not in ("scan", "range", "imu"):
            return
        fixed = [joint for joint in joints if joint.kind == "fixed"]
        body, (at, turn) = placed(sensor.link, sensor.origin, fixed)
        frame_body, (place, direction) = placed(sensor.frame, Origin(), fixed)
        apart = math.dist(at, place)
        cosine = abs(sum(map(operator.mul, turn, direction)))  # cosine of half the angle
        angle = 2 * math.acos(min(1.0, cosine))
        if body != frame_body:
            text = "moves against"
        elif apart > _APART or angle > _TURNED:
            text = f"is {apart:.3g} m and {math.degrees(angle):.3g} degrees from"
        else:
            return
        text += f' "{sensor.frame}", the frame of its messages, which have what it measures there'
        remedy = "name a link that is where it is in <gz_frame_id>, or change its <pose>"
        self._findings.warning(self._element, f"{text}; {remedy}")

    def _checked(self, topic: str) -> str:
        """Return a topic's name."""
        name = topic.rstrip("/").replace(" ", "_").replace("//", "/")
        try:
            ValueType(str, _TOPIC).checked(name)
        except ValueError as error:
            if not self.wrong:  # names are made of one another
                self.problem(f"its topic {error}")
        return name

    def _read_model(self) -> Lidar | Camera | Imu:
        if self.kind == LIDAR:
            return self._lidar()
        if self.kind == IMU:
            return self._imu()
        assert self.kind in (CAMERA, DEPTH, RGBD), self.kind
        return self._camera()

    def _lidar(self) -> Lidar:
        ray = self._inside("ray", "lidar")
        across, up = self._fan(ray, "scan/horizontal"), self._fan(ray, "scan/vertical")
        least, greatest = self._number(ray, "range/min"), self._number(ray, "range/max")
        self._ordered(ray, "range", "min", least, "max", greatest)
        if across.samples * up.samples > _MOST_RAYS and not self.wrong:
            rays = f"{across.samples} x {up.samples} rays are more than {_MOST_RAYS}"
            self.problem(f"{rays}; lower <samples>")
        noise = self._noise(self._element.find(".//noise"))  # some have it beside <ray>
        return Lidar(across, up, least, greatest, noise)

    def _fan(self, ray: Element, path: str) -> Fan:
        element = ray.find(path)
        if element is None:
            if path.endswith("horizontal"):
                self.problem(f"has no <{path}>; write its <samples>, <min_angle> and <max_angle>")
            return Fan()
        samples, resolution, least, greatest = (
            self._number(element, tag)
            for tag in ("samples", "resolution", "min_angle", "max_angle")
        )
        count = max(1, round(samples * resolution))
        if count > _MOST_RAYS and not self.wrong:
            self.problem(f"{count} rays are more than {_MOST_RAYS}; lower <samples>", element)
        if count > 1:
            self._ordered(ray, path, "min_angle", least, "max_angle", greatest)
            if greatest - least > _TURN:
                self.problem("min_angle to max_angle is more than a turn (6.2832 rad)", element)
        return Fan(count, least, greatest)

    def _ordered(
        self, element: Element, path: str, low: str, least: float, high: str, greatest: float
    ) -> None:
        if not least < greatest and not self.wrong:
            text = f"<{low}> {least:g} is not below <{high}> {greatest:g}; swap or change them"
            self.problem(text, element.find(path))

    def _camera(self) -> Camera:
        camera = self._inside("camera")
        fov, width, height = (
            self._number(camera, path) for path in ("horizontal_fov", "image/width", "image/height")
        )
        if width * height > _MOST_PIXELS and not self.wrong:
            self.problem(
                f"{width:g} x {height:g} pixels are more than {_MOST_PIXELS} (1920 x 1200); lower "
                "<width> or <height>",
                camera.find("image"),
            )
        near, far = self._clip(camera, "clip", (0.1, 100.0))
        depth = self._clip(camera, "depth_camera/clip", (near, far))
        return Camera(
            fov, int(width), int(height), near, far, *depth, self._noise(camera.find("noise"))
        )

    def _clip(
        self, camera: Element, path: str, default: tuple[float, float]
    ) -> tuple[float, float]:
        clip = camera.find(path)
        if clip is None:
            return default
        near, far = self._number(clip, "near"), self._number(clip, "far")
        self._ordered(camera, path, "near", near, "far", far)
        return near, far

    def _imu(self) -> Imu:
        imu = self._element.find("imu")
        if imu is None:
            return Imu()
        groups = []
        for tag, old_name in (("angular_velocity", "rate"), ("linear_acceleration", "accel")):
            old = imu.find(f"noise/{old_name}")
            elements = [imu.find(f"{tag}/{axis}/noise") for axis in "xyz"]
            noises = [self._noise(old if noise is None else noise) for noise in elements]
            groups.append((noises[0], noises[1], noises[2]))
        has_none = is_false(imu.findtext("enable_orientation", ""))
        reference = None if has_none else self._reference(imu)
        return Imu(groups[0], groups[1], reference)

    def _reference(self, imu: Element) -> Reference:
        """Return the reference axes of an IMU's orientation."""
        element = imu.find("orientation_reference_frame")
        if element is None:
            return Reference()
        name = element.findtext("localization", _CUSTOM).strip()
        if name in _BY_GRAVITY:
            text = f"{name} is not simulated: the orientation is that in the world, as of ENU"
            self._findings.warning(element, f"{text}; write one of: {', '.join(_AXES)}, {_CUSTOM}")
        elif name != _CUSTOM and name not in _AXES:
            hint = did_you_mean(name, (*_AXES, _CUSTOM))
            self.problem(f'there are no axes "{name}"{hint}', element)
        if name != _CUSTOM:
            return Reference(_AXES.get(name, _AXES["ENU"]))
        custom = element.find("custom_rpy")
        if custom is None:
            return Reference(self._frames.turned(ZERO, self._pose, self._link), at_start=True)
        x, y, z = self._numbers(custom, "roll pitch yaw")
        parent = custom.get("parent_frame", "").strip()
        if parent == "world":
            return Reference((x, y, z))
        link = self._frame(custom, parent)
        pose = Origin() if parent else self._pose
        return Reference(self._frames.turned((x, y, z), pose, link), at_start=True)

    def _noise(self, element: Element | None) -> Noise:
        if element is None:
            return Noise()
        kind = (element.get("type") or element.findtext("type") or "gaussian").strip()
        if kind not in ("none", "gaussian", "gaussian_quantized"):
            kinds = "none, gaussian, gaussian_quantized"
            self.problem(f'unknown noise type "{kind}"; write one of: {kinds}', element)
        if kind == "none":
            return Noise()
        return Noise(*(self._number(element, field.name) for field in fields(Noise)))

    def _inside(self, *tags: str) -> Element:
        """Return the element with the values; in some robots that is the <sensor> itself."""
        elements = (self._element.find(tag) for tag in tags)
        return next((element for element in elements if element is not None), self._element)

    def _number(self, parent: Element, path: str) -> float:
        """Return a value, checked by the table of values; 0 if it is wrong."""
        default, rule = _VALUES[path]
        element = parent.find(path)
        text = "" if element is None else (element.text or "").strip()
        if element is None:
            if default is None:
                self.problem(f"has no <{path}>", parent)
            return default or 0.0
        fault = number_fault(text) if text else "is empty; write a number"
        try:
            if fault is None:
                value = float(ValueType(float, rule).checked(float(text)))
                if path not in _WHOLE or value.is_integer():
                    return value
                fault = f"{text} is no whole number"
        except ValueError as error:
            fault = str(error)
        self.problem(fault, element)
        return 0.0

    def _read_pose(self) -> Origin:
        element = self._element.find("pose")
        if element is None:
            return Origin()
        frame = element.get("relative_to", "").strip()
        link = self._frame(element, frame)
        x, y, z, *angles = self._numbers(element, "x y z roll pitch yaw")
        if element.get("degrees", "").strip().lower() in ("true", "1"):
            angles = [*map(math.radians, angles)]
        pose = Origin((x, y, z), (angles[0], angles[1], angles[2]))
        return pose if link == self._link else self._frames.relative(pose, link, self._link)

    def _frame(self, element: Element, name: str) -> str:
        """Return the link whose frame has this name; "" means the sensor's link."""
        link = self._frames.link(name, self._link)
        if link is None:
            hint = self._findings.hint(name, self._frames.names, "links and joints")
            self.problem(f'there is no frame "{name}"{hint}', element)
        return link or self._link

    def _numbers(self, element: Element, names: str) -> list[float]:
        """Return an element's numbers, one for each of ``names``; zeros if empty or wrong."""
        words, count = (element.text or "").split(), len(names.split())
        fault = next(filter(None, map(number_fault, words)), None)
        if fault is None and len(words) == count:
            return [*map(float, words)]
        if words:
            text = fault or f"holds {len(words)} numbers; write {names}"
            self.problem(text, element)
        return [0.0] * count

    def _warn_of_unknown(self, element: Element) -> None:
        """Warn of elements that are not read, because a name may be misspelt."""
        known_tags = _KNOWN.get(element.tag)
        if known_tags is None:
            return
        for child in element:
            if child.tag not in known_tags.split():
                hint = self._findings.hint(child.tag, known_tags.split(), "known here")
                text = f"is not simulated inside <{element.tag}>, so it is ignored{hint}"
                self._findings.warning(child, text)
            self._warn_of_unknown(child)

    def _warn_of_unread(self, plugin: Element) -> None:
        """Warn of a plugin's children that are not read, in one warning."""
        known = f"{_KNOWN_IN_ANY_PLUGIN} {_KNOWN_IN_PLUGIN[self.kind]}".split() + [*_RATES]
        children = [*plugin, *plugin.iterfind("ros/*")]
        unread = [child.tag for child in children if child.tag not in known and _asks(child)]
        rules = [
            f"<remapping> {old}:={new}"
            for outputs in self.outputs
            if outputs.plugin is plugin
            for old, new in outputs.idle
        ]
        names = ", ".join([*(f"<{tag}>" for tag in dict.fromkeys(unread)), *rules])
        if len(unread) == 1 and not rules:
            hint = self._findings.hint(unread[0], known)
            hint = hint if "did you mean" in hint else ""  # else it lists all that is known
            self._findings.warning(plugin, f"{names} is not simulated, so it is ignored{hint}")
        elif names:
            self._findings.warning(plugin, f"{names}: nothing of the sensor reads this")


def _asks(element: Element) -> bool:
    """Return whether an element asks for anything; zeros and false do not."""
    words = (element.text or "").split()
    zeros = all(
        word.lower() in _NOTHING or number_fault(word) is None and not float(word) for word in words
    )
    return len(element) > 0 or not zeros


def _noisier(noise: Noise, stddev: float) -> Noise:
    """Return noise with independent noise of another ``stddev`` added."""
    return replace(noise, stddev=math.hypot(noise.stddev, stddev)) if stddev else noise
