"""Colors the hits of camera rays, with the light of the sun and the sky, without shadows."""

import numpy as np
from numpy.typing import NDArray

from onebot_control.sensing.noise import add_noise
from onebot_control.sensing.rays import GROUND, NOTHING, Hits, Rays, Surface, Targets
from onebot_description.arrays import Bytes, Floats, Singles
from onebot_description.description.sensors.camera import Camera
from onebot_description.description.sensors.noise import Noise

_SUN = np.array([0.35, 0.5, 0.79]) / np.linalg.norm([0.35, 0.5, 0.79])  # direction to the sun
_SUNLIGHT, _SKYLIGHT, _REFLECTED = 0.55, 0.55, 0.30  # brightness of sun, sky and ground
_ZENITH = np.array([0.45, 0.64, 0.86], np.float32)  # sRGB
_HORIZON = np.array([0.86, 0.90, 0.94], np.float32)
_GROUND = np.array([0.56, 0.57, 0.58], np.float32)
_TILE, _CONTRAST = 0.5, 0.07  # m; tiles make distance and motion of the ground visible
_BLURRED, _FADED = 4.0, 32.0  # m, distances at which tiles start to fade, and at which they end


class Painter:
    """Computes color images from the hits of camera rays."""

    def __init__(self, still: Surface) -> None:
        """Compute the lit colors of the fixed surface once."""
        self._still, self._lit = still, _lit(still, np.eye(3))

    def picture(
        self,
        camera: Camera,
        rays: Rays,
        position: Floats,
        hits: Hits,
        targets: Targets,
        generator: "np.random.Generator | None" = None,
    ) -> Bytes:
        """Return the image (H, W, 3), sRGB, of the hits.

        Args:
            camera: the sensor.
            rays: its rays.
            position: (3,), of the sensor in the world, m.
            hits: hits of the rays.
            targets: the moving surfaces at the time of the image.
            generator: generator of the noise; None for no noise.
        """
        seen, distances = hits.surfaces, hits.distances
        if camera.depth_far > camera.far:  # the rays are longer than the range of the image
            seen = np.where(distances > np.float32(camera.far), np.int16(NOTHING), seen)
        pixels = np.zeros(len(seen), np.uint32)
        masks = seen == NOTHING, seen == GROUND
        high, low = (_rows(mask, camera.width) for mask in masks)
        sky = _sky(hits.directions[high, 2], rays.inverse_lengths[high])
        np.copyto(pixels[high], sky, where=masks[0][high])
        ground = _ground(position, hits.directions[low], distances[low])
        np.copyto(pixels[low], ground, where=masks[1][low])
        if len(self._lit):
            still = seen == 0
            np.copyto(pixels, np.take(self._lit, hits.faces, mode="clip"), where=still)
            _add_textures(pixels, still, hits, self._still, np.eye(3))
        for index in np.unique(seen[seen > 0]) - 1:
            mask = seen == index + 1
            surface, turn = targets.surfaces[index], targets.rotations[index]
            pixels[mask] = _lit(surface, turn)[hits.faces[mask]]
            _add_textures(pixels, mask, hits, surface, turn)
        colors = np.empty((camera.height, camera.width, 3), np.uint8)
        for channel in range(3):  # faster than copying all channels at once
            colors[..., channel] = pixels.view(np.uint8)[channel::4].reshape(colors.shape[:2])
        if generator is None or camera.noise == Noise():
            return colors
        grey = np.zeros((camera.height, camera.width, 1), np.float32)
        shift = 255.0 * add_noise(grey, camera.noise, 0.0, generator)
        return np.clip(np.rint(colors + shift), 0.0, 255.0).astype(np.uint8)


def _rows(mask: NDArray[np.bool_], width: int) -> slice:
    """Return the pixels from the first to the last row of an image in which ``mask`` is true."""
    rows = np.flatnonzero(mask.reshape(-1, width).any(axis=1))
    return slice(rows[0] * width, (rows[-1] + 1) * width) if len(rows) else slice(0)


def _packed(colors: Singles) -> NDArray[np.uint32]:
    """Pack colors (N, 3), 0 to 1, into one number each: the bytes red, green, blue, 0."""
    pixels = np.zeros((len(colors), 4), np.uint8)
    pixels[:, :3] = np.minimum(colors * np.float32(255.0) + np.float32(0.5), np.float32(255.0))
    return pixels.view(np.uint32)[:, 0]


def _light(normals: Singles, turn: Floats) -> Singles:
    """Return the brightness (N, 1) of faces with normals (N, 3) in a frame rotated by ``turn``."""
    up, sun = turn[2].astype(np.float32), (turn.T @ _SUN).astype(np.float32)
    middle, half = (_SKYLIGHT + _REFLECTED) / 2.0, (_SKYLIGHT - _REFLECTED) / 2.0
    direct = np.float32(_SUNLIGHT) * np.maximum(normals @ sun, np.float32(0.0))
    light: Singles = np.float32(middle) + np.float32(half) * (normals @ up) + direct
    return light[:, None]


def _lit(surface: Surface, turn: Floats) -> NDArray[np.uint32]:
    """Return the lit colors of a surface's faces."""
    return _packed(surface.solid.colors * _light(surface.normals, turn))


def _add_textures(
    pixels: NDArray[np.uint32],
    mask: NDArray[np.bool_],
    hits: Hits,
    surface: Surface,
    turn: Floats,
) -> None:
    """Color the pixels in ``mask`` that show a texture of ``surface``."""
    for first, places, image in surface.solid.textures:
        faces = hits.faces - first
        rows = np.flatnonzero(mask & (faces >= 0) & (faces < len(places)))
        v, w = hits.second[rows, None], hits.third[rows, None]
        corners = places[faces[rows]]
        x, y = ((1 - v - w) * corners[:, 0] + v * corners[:, 1] + w * corners[:, 2]).T % 1.0
        height, width = image.shape[:2]
        column = np.minimum((x * width).astype(np.intp), width - 1)
        row = np.minimum(((1.0 - y) * height).astype(np.intp), height - 1)
        light = _light(surface.normals[hits.faces[rows]], turn)
        pixels[rows] = _packed(image[row, column].astype(np.float32) / np.float32(255.0) * light)


def _ground(position: Floats, directions: Singles, distances: Singles) -> NDArray[np.uint32]:
    """Return the colors of the ground where rays from ``position`` hit it."""
    tiles = np.zeros(len(distances), np.int32)
    for axis in (0, 1):
        along = directions[:, axis] * distances
        along *= np.float32(1.0 / _TILE)
        along += np.float32(position[axis] / _TILE)
        tiles += np.floor(along, out=along).astype(np.int32)
    shades = np.minimum(distances * np.float32(127.0 / _FADED), np.float32(127.0)).astype(np.uint8)
    shades |= (tiles.astype(np.uint8) & 1) << 7
    colors: NDArray[np.uint32] = np.take(_GROUND_COLORS, shades)
    return colors


def _sky(upwards: Singles, inverse_lengths: Singles) -> NDArray[np.uint32]:
    """Return the colors of the sky for directions with these z and inverse lengths."""
    height = upwards * inverse_lengths
    np.maximum(height, np.float32(0.0), out=height)
    height *= np.float32(255.0)
    colors: NDArray[np.uint32] = np.take(_SKY_COLORS, height.astype(np.uint8))
    return colors


_SHADES = np.linspace(0.0, 1.0, 256, dtype=np.float32)[:, None]
_SKY_COLORS = _packed(_HORIZON + (_ZENITH - _HORIZON) * np.sqrt(_SHADES))
# Colors of the ground by distance: first of bright tiles, then of dark ones.
_FADES = 1.0 / (1.0 + np.linspace(0.0, _FADED / _BLURRED, 128, dtype=np.float32) ** 2)
_GROUND_COLORS = _packed(
    _GROUND * (1.0 + np.float32(_CONTRAST) * np.append(_FADES, -_FADES)[:, None])
)
