"""Reads sensors: the ``<gazebo reference="LINK"><sensor>`` blocks of gz sim and Gazebo classic.

Their meaning is SDFormat's; topics and frames may be named in any way that gz sim or the ROS
plugins of Gazebo classic have it. A sensor with a fault is left out, and reported as a problem.
"""

import math
import operator
import re
from collections import Counter
from collections.abc import Collection, Iterable, Mapping
from dataclasses import fields

from onebot_description.description.description import (
    Camera,
    Fan,
    Imu,
    Joint,
    Lidar,
    Noise,
    Origin,
    Sensor,
)
from onebot_description.description.reading import Element, Findings, number_fault
from onebot_description.description.sensor_topics import (
    CAMERA,
    DEPTH,
    IMU,
    LIDAR,
    RGBD,
    TopicNames,
    text_of,
)
from onebot_description.errors import did_you_mean
from onebot_description.parameters.values import Rule, ValueType

_KINDS = {
    **dict.fromkeys(("lidar", "gpu_lidar", "ray", "gpu_ray"), LIDAR),
    **dict.fromkeys(("depth", "depth_camera"), DEPTH),
    **dict.fromkeys(("rgbd", "rgbd_camera"), RGBD),
    "imu": IMU,
    "camera": CAMERA,
}
_MOST_RAYS, _MOST_PIXELS = 300_000, 1920 * 1200
_TURN = 2 * math.pi + 1e-3  # full turns are written with few digits

# What is read, by its path: default (None: it is needed) and rule.
_POSITIVE, _NOT_NEGATIVE, _ANY = Rule(above=0.0), Rule(at_least=0.0), Rule()
_ANGLE, _COUNT = Rule(at_least=-_TURN, at_most=_TURN), Rule(at_least=1, at_most=_MOST_PIXELS)
_VALUES: Mapping[str, tuple[float | None, Rule]] = {
    "update_rate": (0.0, Rule(at_least=0.0, at_most=1000.0)),
    "updateRate": (0.0, Rule(at_least=0.0, at_most=1000.0)),  # a plugin's
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
}
_WHOLE = ("samples", "image/width", "image/height")
# The elements in each that are read, or change nothing here.
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
}
_FRAMES = ("gz_frame_id", "ignition_frame_id", "frame_id", "frame_name", "frameName")
_TOPIC = Rule(
    pattern=re.compile(r"[A-Za-z_]\w*(/[A-Za-z_]\w*)*", re.ASCII),
    write="a ROS name: words of letters, digits and _ that do not start with a digit, joined by /",
)
# Of a sensor from the frame of its messages; rounded angles such as 1.57 are no fault.
_APART, _TURNED = 1e-3, 1e-2  # m, rad


def read_sensors(
    findings: Findings, links: Collection[str], joints: Iterable[Joint]
) -> tuple[tuple[Sensor, ...], tuple[str, ...]]:
    """Return the sensors of a document, and the names of unreadable ones."""
    root = findings.document.root
    parents = [root] if root.tag == "gazebo" else root.findall("gazebo")
    blocks = [
        _Block(findings, element, parent)
        for parent in parents
        for element in parent.iterfind("sensor")
    ]
    for parent in parents:
        for plugin in parent.iterfind("plugin"):
            _warn_of_plugin(findings, plugin, links)
    blocks = [block for block in blocks if block.kind]
    unnamed = Counter(block.kind for block in blocks if not block.names.given)
    sensors, blocks_by_topic = list[Sensor](), dict[str, _Block]()
    for block in blocks:
        sensor = block.read(links, alone=unnamed[block.kind] < 2)
        for topic in () if block.wrong else sensor.topics.values():
            first_block = blocks_by_topic.setdefault(topic, block)
            if first_block is not block:
                text = f'publishes "{topic}", as the one at {first_block.place} does'
                block.problem(f"{text}; give it a <topic> of its own")
        if not block.wrong:
            block.warn_of_frame(sensor, links, joints)
            sensors.append(sensor)
    bad = dict.fromkeys(block.name for block in blocks if block.wrong)
    return tuple(sensors), tuple(bad)


def _warn_of_plugin(findings: Findings, plugin: Element, links: Collection[str]) -> None:
    """Warn of a plugin that stands for a sensor, outside of any."""
    link = (plugin.findtext("bodyName") or "").strip()
    if not link:
        return
    file, rate = plugin.get("filename", ""), plugin.findtext("updateRate", "100").strip()
    text = f'is a sensor on link "{link}" without a <sensor>, so it is ignored'
    if "imu" in file or "imu" in plugin.get("name", ""):
        text += (
            f'; write <gazebo reference="{link}"><sensor name="imu" type="imu"><update_rate>{rate}'
            "</update_rate></sensor></gazebo>"
        )
    findings.warning(plugin, text)


def _pose_in_body(
    link: str, origin: Origin, joints: Iterable[Joint]
) -> tuple[str, list[float], list[float]]:
    """Return the first link of a link's rigid body, and a pose of the link in its frame.

    The pose is a translation (3,), m, and a unit quaternion (4,), x y z w.
    """
    import numpy as np  # only now: it takes longer to import than all that is done here

    from onebot_description.model import quaternions

    above = {joint.child: joint for joint in joints if joint.kind == "fixed"}
    at, turn = np.array(origin.xyz), quaternions.from_rpy(origin.rpy)
    while joint := above.pop(link, None):
        outer = quaternions.from_rpy(joint.origin.rpy)
        at = quaternions.rotate(outer, at) + joint.origin.xyz
        turn, link = quaternions.multiply(outer, turn), joint.parent
    return link, at.tolist(), turn.tolist()


class _Block:
    """One <sensor>, and what is wrong in it."""

    def __init__(self, findings: Findings, element: Element, parent: Element) -> None:
        self._findings, self._element = findings, element
        self._link, self.wrong = parent.get("reference", ""), False
        self.name, self.place = element.get("name", "").strip(), findings.where(element)
        kind = element.get("type", "")
        self.kind = _KINDS.get(kind, "")
        self.names = TopicNames(element, self.kind)
        if not kind:
            self.problem(f"has no type; write one of: {', '.join(_KINDS)}")
        elif not self.kind:
            hint = did_you_mean(kind, _KINDS, "simulated")
            findings.warning(element, f'sensors of type "{kind}" are not simulated{hint}')

    def problem(self, text: str, element: Element | None = None) -> None:
        """Report what leaves the sensor out."""
        self.wrong = True
        self._findings.problem(self._element if element is None else element, text)

    def read(self, links: Collection[str], *, alone: bool) -> Sensor:
        """Return the sensor, which is not to be used if the block is ``wrong``.

        ``alone``: every other sensor of its kind names a topic.
        """
        if not self._link:
            self.problem('lies in no link; write <gazebo reference="LINK"> around it')
        elif self._link not in links:
            hint = self._findings.hint(self._link, links, "links")
            self.problem(f'there is no link "{self._link}"{hint}')
        if not self.name:
            self.problem('has no name; write <sensor name="...">')
        self._warn_of_unknown(self._element)
        model = self._model()
        rate, plugin = self._number(self._element, "update_rate"), self._element.find("plugin")
        if not rate and plugin is not None:
            rate = self._number(plugin, "updateRate")
        frame = text_of(self._element, "optical_frame_id") if isinstance(model, Camera) else ""
        frame = frame or text_of(self._element, *_FRAMES) or self._link
        rows = model.vertical.samples if isinstance(model, Lidar) else 1
        written = self.names.topics(rows=rows, alone=alone)
        topics = {output: self._checked(topic) for output, topic in written.items()}
        pose = self._pose()
        return Sensor(self.name, self._link, pose, rate, topics, frame, model, self.place)

    def warn_of_frame(
        self, sensor: Sensor, links: Collection[str], joints: Iterable[Joint]
    ) -> None:
        """Warn of a frame of the messages that is no link, or is not where the sensor is.

        Pictures have an optical frame, and clouds are given in the frame that is named.
        """
        if sensor.frame not in links:
            hint = self._findings.hint(sensor.frame, links, "links")
            text = f'no link is called "{sensor.frame}", the frame of its messages{hint}'
            self._findings.warning(self._element, text)
            return
        is_there = sensor.frame == sensor.link and sensor.origin == Origin()
        if is_there or not sensor.topics.keys() & {"scan", "imu"}:
            return
        body, at, turn = _pose_in_body(sensor.link, sensor.origin, joints)
        frame_body, place, direction = _pose_in_body(sensor.frame, Origin(), joints)
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
        """Return a topic relative to the robot's namespace."""
        name = topic.strip("/").replace(" ", "_").replace("//", "/")
        try:
            ValueType(str, _TOPIC).checked(name)
        except ValueError as error:
            self.problem(f"its topic {error}")
        return name

    def _model(self) -> Lidar | Camera | Imu:
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
        return Imu(*groups)

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
        """The element that holds the values: some robots have them in <sensor> itself."""
        elements = (self._element.find(tag) for tag in tags)
        return next((element for element in elements if element is not None), self._element)

    def _number(self, parent: Element, path: str) -> float:
        """Return a value by the table, 0 if it is wrong."""
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

    def _pose(self) -> Origin:
        element = self._element.find("pose")
        words = [] if element is None or not element.text else element.text.split()
        if element is None or not words:
            return Origin()
        fault = next(filter(None, map(number_fault, words)), None)
        if fault is not None or len(words) != 6:
            text = fault or f"holds {len(words)} numbers; write x y z roll pitch yaw"
            self.problem(text, element)
            return Origin()
        x, y, z, *angles = map(float, words)
        if element.get("degrees") == "true":
            angles = [*map(math.radians, angles)]
        return Origin((x, y, z), (angles[0], angles[1], angles[2]))

    def _warn_of_unknown(self, element: Element) -> None:
        """Warn of elements that are not read: a name may be misspelt."""
        known_tags = _KNOWN.get(element.tag)
        if known_tags is None:
            return
        for child in element:
            if child.tag not in known_tags.split():
                hint = self._findings.hint(child.tag, known_tags.split(), "known here")
                text = f"is not simulated inside <{element.tag}>, so it is ignored{hint}"
                self._findings.warning(child, text)
            self._warn_of_unknown(child)
