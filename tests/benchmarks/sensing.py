"""Sensors against the bare calls of Embree with the same rays.

In a world of 50 boxes with one OneBot; ranges are checked against the bare call's.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from onebot_control.sensing import camera, lidar
from onebot_control.sensing.painter import Painter
from onebot_control.sensing.rays import cast
from onebot_control.sensing.surroundings import Placed, SensedRobot, VisibleSurfaces
from onebot_description.description import Description, load_description, parse_description
from onebot_description.description.sensors.camera import Camera
from onebot_description.description.sensors.lidar import Fan, Lidar
from onebot_description.geometry.poses import Transform
from tests.benchmarks.measuring import MODEL, WrongAnswer, cpu_of, in_turn, over
from tests.benchmarks.report import Report, Result

_SLICE = 0.1  # s of processor time


def run(quick: bool) -> Report:
    """Measure a scan and a picture."""
    ratios = _ratios(quick)
    return [
        Result("360 ranges: CPU over the bare call", ratios["scan"], 3.0),
        Result(
            "picture of 320 x 240, color and depth: CPU over the bare call", ratios["picture"], 1.5
        ),
    ]


def _boxes() -> Description:
    rng = np.random.default_rng(50)
    visuals = []
    for number in range(50):
        around, away = number * math.tau / 50, rng.uniform(1.5, 8.0)
        xyz = f"{away * math.cos(around):.3f} {away * math.sin(around):.3f} 0.2"
        visuals.append(
            f'<visual><origin xyz="{xyz}" rpy="0 0 {number}"/><geometry><box size="0.4 0.3 0.5"/>'
            "</geometry></visual>"
        )
    return parse_description(
        f'<robot name="w"><link name="world">{"".join(visuals)}</link></robot>'
    )


def _ratios(quick: bool) -> dict[str, float]:
    """CPU of a scan and of a picture over that of the bare calls."""
    onebot = load_description(MODEL, {"sensors_enabled": "true"})
    robot = SensedRobot(onebot, [joint.name for joint in onebot.moving_joints], {})
    scene = VisibleSurfaces(_boxes(), [robot])
    at = Transform((0.0, 0.0, 0.06), (0.0, 0.0, 0.0, 1.0)), np.zeros(len(robot.joints))
    placed = Placed(scene, [], [at])
    targets = placed.targets
    base, eye = (scene.target(0, link) for link in ("base_link", "camera_link"))
    ranger = Lidar(Fan(360, -math.pi, math.pi * 179 / 180), Fan(), 0.05, 12.0)
    lens = Camera(1.2, 320, 240, 0.05, 50.0, 0.05, 8.0)
    painter = Painter(scene.still)
    turn, (place, face) = np.eye(3), _places(placed)
    fan, pixels = lidar.lidar_rays(ranger), camera.camera_rays(lens)

    def scan() -> Any:
        hits = cast(fan, turn, place, scene.still, targets, lidar.reach(ranger), [base])
        return lidar.ranges(ranger, hits)

    def picture() -> Any:
        hits = cast(pixels, turn, face, scene.still, targets, camera.reach(lens), [eye])
        return painter.picture(lens, pixels, face, hits, targets), camera.depths(lens, hits)

    def bare(rays: Any, origin: Any) -> Callable[[], Any]:
        origins = np.broadcast_to(origin.astype(np.float32), rays.singles.shape).copy()
        caster = scene.still._caster
        return lambda: caster.run(origins, rays.singles, output=True)  # type: ignore

    found, true = scan(), bare(fan, place)()["tfar"]
    both = true < 12.0
    if not both.any() or np.abs(found - true)[both].max() > 1e-4:
        raise WrongAnswer("the ranges are not those of the bare call")
    variants = {
        "scan": scan,
        "bare scan": bare(fan, place),
        "picture": picture,
        "bare picture": bare(pixels, face),
    }
    slices = {name: (lambda each=each: cpu_of(each, _SLICE)) for name, each in variants.items()}
    took = in_turn(slices, 1 if quick else 15)
    return {name: over(took[name], took[f"bare {name}"]) for name in ("scan", "picture")}


def _places(placed: Placed) -> Sequence[Any]:
    """Positions of OneBot's lidar and camera."""
    links = [placed.link(0, name) for name in ("lidar_link", "camera_link")]
    return [link.position for link in links if link is not None]
