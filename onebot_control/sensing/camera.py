"""Measures with cameras: rays, calibration, depths and clouds; ``painter`` computes colors."""

import math
from collections.abc import Set
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from onebot_control.sensing.clouds import cloud_of, point_layout
from onebot_control.sensing.instrument import Instrument, SensedWorld
from onebot_control.sensing.noise import add_noise
from onebot_control.sensing.rays import Hits, Rays, cast
from onebot_description.arrays import Bytes, Floats, Singles
from onebot_description.description.sensors.camera import Camera

# Rotation of a camera that looks along x, in its optical frame: z ahead, x right, y down (REP-103).
_OPTICAL = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
_INFOS = frozenset({"camera_info", "depth_camera_info"})
_FIELD_OF_VIEW, _FARTHEST = 1.0, 1e4  # rad, horizontally, and m, of pictures
_LEVEL = 1e-6  # sine of the minimum angle between a picture's axis and the vertical
_KEPT = 30_000_000  # bytes; glibc never reuses blocks above 32 MB


def focal_length(camera: Camera) -> float:
    """Return the focal length of a pinhole camera with square pixels, in pixels."""
    return camera.width / (2.0 * float(np.tan(camera.field_of_view / 2.0)))


def calibration(camera: Camera) -> dict[str, str | list[float]]:
    """Return the fields of a CameraInfo message that calibrate a camera without distortion."""
    focal, x, y = focal_length(camera), camera.width / 2.0, camera.height / 2.0
    shift = 0.0 - focal * camera.baseline  # shift of a pair's right camera, pixels times meters
    return {
        "distortion_model": "plumb_bob",
        "d": [0.0] * 5,
        "k": [focal, 0.0, x, 0.0, focal, y, 0.0, 0.0, 1.0],
        "r": [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        "p": [focal, 0.0, x, shift, 0.0, focal, y, 0.0, 0.0, 0.0, 1.0, 0.0],
    }


def camera_rays(camera: Camera) -> Rays:
    """Return the rays of the pixels, row by row from the top; their x, along the axis, is 1."""
    # glibc returns free memory to the system once it exceeds twice the largest block ever freed.
    # Freeing a large block once avoids this: requesting memory again for each image would take a
    # third of the time.
    np.empty(_KEPT, np.uint8)
    focal = focal_length(camera)
    # Coordinates of the pixels from the camera matrix K, with the principal point at the center.
    across = (camera.width / 2.0 - np.arange(camera.width)) / focal
    up = (camera.height / 2.0 - np.arange(camera.height)) / focal
    z, y = np.meshgrid(up, across, indexing="ij")
    return Rays(np.stack([np.ones_like(y), y, z], axis=-1).reshape(-1, 3))


def reach(camera: Camera) -> float:
    """Return the length of a camera's rays along its axis, m."""
    return max(camera.far, camera.depth_far)


def depths(camera: Camera, hits: Hits, generator: "np.random.Generator | None" = None) -> Singles:
    """Return the measured depths (H, W) along the axis, m (REP-117, REP-118).

    Depths beyond the far clip are infinite, depths below the near clip are minus infinity.

    Args:
        camera: the sensor.
        hits: hits of its rays.
        generator: generator of the noise; None for no noise.
    """
    measured = hits.distances
    if generator is not None:
        measured = add_noise(measured, camera.noise, 0.0, generator)
    result = hits.within(camera.depth_near, camera.depth_far, measured)
    return result.reshape(camera.height, camera.width)


COLORED_POINT = point_layout(("rgb", "<u4", 16))
"""Layout of a colored point in a cloud, as in depth_image_proc."""


def cloud(
    rays: Rays,
    depth_image: Singles,
    picture: Bytes | None,
    pose: tuple[Floats, Floats],
    nowhere: float = np.inf,
) -> NDArray[np.void]:
    """Return the point cloud of a depth image, (H, W) of COLORED_POINT.

    Args:
        rays: rays of the camera.
        depth_image: (H, W), m.
        picture: (H, W, 3), colors of the points; None for black.
        pose: rotation (3, 3) and position (3,) of the camera in the frame of the points.
        nowhere: x, y and z of points whose depth is not finite.
    """
    height, width = depth_image.shape
    points = cloud_of(COLORED_POINT, (height, width), rays, depth_image, pose, nowhere)
    if picture is not None:
        red, green, blue = np.moveaxis(picture.astype(np.uint32), -1, 0)
        points["rgb"] = red << 16 | green << 8 | blue
    return points


def picture_from(world: SensedWorld, eye: Floats, target: Floats, width: int, height: int) -> Bytes:
    """Return a picture (H, W, 3) of a world, sRGB.

    Args:
        world: the world.
        eye: (3,), position of the camera, m.
        target: (3,), another point, at the center of the picture, m.
        width: width of the picture, pixels.
        height: height of the picture, pixels.
    """
    ahead = (target - eye) / np.linalg.norm(target - eye)
    # From straight above, y is up, as on a map.
    left = np.cross([0.0, 0.0, 1.0] if math.hypot(*ahead[:2]) > _LEVEL else [0.0, 1.0, 0.0], ahead)
    left /= np.linalg.norm(left)
    rotation = np.stack([ahead, left, np.cross(ahead, left)], axis=1)
    camera = Camera(_FIELD_OF_VIEW, width, height, 0.0, _FARTHEST, 0.0, _FARTHEST)
    rays, placed = camera_rays(camera), world.placed
    hits = cast(rays, rotation, eye, placed.surroundings.still, placed.targets, _FARTHEST)
    return world.painter.picture(camera, rays, eye, hits, placed.targets)


class CameraInstrument(Instrument[Camera]):
    """Measures with a camera: colors, depths, and clouds of both."""

    waiting = 1
    needs_embree = True

    @cached_property
    def _rays(self) -> Rays:
        return camera_rays(self.model)

    def measure(self, world: SensedWorld, wanted: Set[str]) -> dict[str, Any]:
        camera, topics = self.model, self.sensor.topics.keys()
        outputs: dict[str, Any] = dict.fromkeys(topics & _INFOS)
        if wanted <= _INFOS:
            return outputs
        pose, generator = self.pose(world.placed), self.generator(world.frame)
        hits = self.hits(world, pose, self._rays, camera.near, reach(camera))
        if wanted & {"image", "points"} and "image" in topics:
            outputs["image"] = world.painter.picture(
                camera, self._rays, pose.position, hits, world.placed.targets, generator
            )
        if wanted & {"depth", "points"}:
            outputs["depth"] = depths(camera, hits, generator)
        if "points" in wanted:
            seen_from = self.seen_from(world, pose, _OPTICAL)
            outputs["points"] = cloud(
                self._rays, outputs["depth"], outputs.get("image"), seen_from, camera.blank
            )
        return outputs
