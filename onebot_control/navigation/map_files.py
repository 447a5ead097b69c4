"""Map files in the format of Nav2's map_server: a YAML file and an image.

Example:
    >>> import tempfile
    >>> grid = OccupancyGrid(np.array([[0, 100, -1]], np.int8), 0.05, (-1.0, 2.0))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = save_map(grid, Path(folder, "office"))
    ...     read = load_map(file)
    >>> read.data.tolist(), read.origin
    ([[0, 100, -1]], (-1.0, 2.0))
"""

import math
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import numpy as np
from PIL import Image, UnidentifiedImageError

from onebot_control.occupancy_grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from onebot_description.atomic_write import write_whole
from onebot_description.errors import OneBotError, listing
from onebot_description.parameters.files import read_map, read_text
from onebot_description.parameters.reader import REQUIRED, ConfigError, parameter, read

_BLACK, _GREY, _WHITE = 0, 205, 254  # occupied, unknown, free
_FORMATS = {"pgm": "PPM", "png": "PNG"}
_MAX_CELLS = 16_000_000


@dataclass(frozen=True)
class MapFile:
    """The content of a map's YAML file, with its names."""

    image: str = parameter(REQUIRED, "image file, relative to the YAML file", not_empty=True)
    resolution: float = parameter(REQUIRED, "edge of a cell, m", above=0.0)
    origin: tuple[float, float, float] = parameter(
        REQUIRED, "x, y, m, and yaw, rad, of the lower left corner"
    )
    negate: int = parameter(0, "1: white is occupied", at_least=0, at_most=1)
    occupied_thresh: float = parameter(0.65, "a cell is occupied from this value", at_least=0.0)
    free_thresh: float = parameter(0.196, "a cell is free up to this value", at_least=0.0)
    mode: str = parameter("trinary", "meaning of shades", choices=("trinary", "scale", "raw"))


def load_map(file: str | Path) -> OccupancyGrid:
    """Read a map from its YAML file and the image named in it.

    Raises:
        OneBotError: a file is missing or wrong; the text names it and how to fix it.
    """
    path = Path(file)
    content = read_map(read_text(path), str(path)).values
    if isinstance(content.get("negate"), bool):
        content["negate"] = int(content["negate"])
    try:
        values = read(MapFile, content)
    except ConfigError as error:
        raise OneBotError(f"{path}: {error}") from None
    if values.free_thresh >= values.occupied_thresh:
        raise OneBotError(f"{path}: free_thresh must be below occupied_thresh")
    if abs(math.remainder(values.origin[2], math.tau)) > 1e-6:
        text = f"origin has a yaw of {values.origin[2]:g} rad; only 0 is supported"
        raise OneBotError(f"{path}: {text}")
    data = _cells(_picture(path.parent / values.image), values)
    return OccupancyGrid(data[::-1].copy(), values.resolution, values.origin[:2])


def _picture(path: Path) -> Image.Image:
    """Return the image in a file.

    Raises:
        OneBotError: it is missing, not an image, or too large.
    """
    try:
        with Image.open(path) as picture:
            if picture.width * picture.height > _MAX_CELLS:
                raise Image.DecompressionBombError
            picture.load()
            return picture.copy()
    except Image.DecompressionBombError:
        raise OneBotError(f"{path}: has more than {_MAX_CELLS:,} pixels") from None
    except UnidentifiedImageError:
        raise OneBotError(f"{path}: is not an image; write a PGM or PNG file") from None
    except (OSError, ValueError, SyntaxError) as error:
        raise OneBotError(f"{path}: cannot be read: {_why(error)}") from None


def _why(error: Exception) -> str:
    return str(getattr(error, "strerror", None) or error)


def _cells(picture: Image.Image, values: MapFile) -> np.ndarray[tuple[int, ...], np.dtype[np.int8]]:
    """Return the values of the cells, with rows from the top."""
    shades = np.asarray(picture.convert("RGB"), float).mean(axis=2)
    if values.mode == "raw":
        return np.where(shades <= OCCUPIED, np.rint(shades), UNKNOWN).astype(np.int8)
    share = (shades if values.negate else 255.0 - shades) / 255.0
    between = np.full(share.shape, float(UNKNOWN))
    if values.mode == "scale":
        span = values.occupied_thresh - values.free_thresh
        between = np.rint((share - values.free_thresh) / span * 100.0)
        between[np.asarray(picture.convert("RGBA"))[..., 3] < 255] = UNKNOWN
    occupied, free = share >= values.occupied_thresh, share <= values.free_thresh
    return np.select([occupied, free], [OCCUPIED, FREE], between).astype(np.int8)


def save_map(grid: OccupancyGrid, name: str | Path, picture: str = "pgm") -> Path:
    """Write a map as NAME.yaml and NAME.pgm, or NAME.png, and return the YAML file.

    Raises:
        OneBotError: a file cannot be written.
    """
    if picture not in _FORMATS:
        raise OneBotError(f"{picture}: not an image format; write {listing(_FORMATS)}")
    base = Path(name)
    base = base.with_suffix("") if base.suffix in (".yaml", ".pgm", ".png") else base
    yaml_file, image_file = (Path(f"{base}.{ending}") for ending in ("yaml", picture))
    shades = np.select([grid.data == UNKNOWN, grid.data > 50], [_GREY, _BLACK], _WHITE)
    x, y = grid.origin
    text = (
        f"image: {image_file.name}\nmode: trinary\nresolution: {grid.resolution:.6g}\n"
        f"origin: [{x:.6g}, {y:.6g}, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    try:
        buffer = BytesIO()
        Image.fromarray(shades[::-1].astype(np.uint8)).save(buffer, _FORMATS[picture])
        write_whole(image_file, buffer.getvalue())
        write_whole(yaml_file, text.encode())
    except (OSError, ValueError) as error:
        raise OneBotError(f"{base}: cannot be written: {_why(error)}") from None
    return yaml_file
