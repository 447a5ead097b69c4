"""Occupancy grids (nav_msgs/OccupancyGrid) and their updates (map_msgs/OccupancyGridUpdate)."""

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from onebot_bringup.viewer.core.columns import ReadyColumn, bytes_maker, empty, one_row
from onebot_bringup.viewer.core.drawing import AUTO, Drawing, TopicSettings
from onebot_bringup.viewer.core.inbox import WantedTopic, known_type
from onebot_bringup.viewer.core.rerun_limits import SELDOM, is_drawable
from onebot_bringup.viewer.core.settings import fraction, one_of, setting
from onebot_bringup.viewer.core.stage import Stage
from onebot_description.geometry.quaternions import normalized

UPDATE = known_type("map_msgs/msg/OccupancyGridUpdate")
_COLORMAPS = {
    "map": rr.components.Colormap.RvizMap,
    "costmap": rr.components.Colormap.RvizCostmap,
    "raw": rr.components.Colormap.Grayscale,
}
_data = bytes_maker(rr.GridMap.columns(data=[b"0"]))


@dataclass(frozen=True)
class MapSettings(TopicSettings):
    """Occupancy grids."""

    alpha: float = setting(0.7, "opacity", fraction)
    color_scheme: str = setting(
        AUTO,
        "auto: costmap if the topic's name has that word, else map",
        one_of(AUTO, *_COLORMAPS),
    )
    draw_behind: bool = setting(False, "draw it below the other maps")


class CurrentMap(NamedTuple):
    """A map with the updates so far."""

    header: Any
    info: Any
    cells: NDArray[np.int8]  # (height, width), the lowest y first


class MapDrawing(Drawing[MapSettings]):
    """The map of one topic, with its updates; a map without cells clears it."""

    key = "map"
    message_types = ("nav_msgs/msg/OccupancyGrid",)
    stamped_when_sent, repeat_when_silent = False, True
    newest_only = True
    period_ns = SELDOM
    _grid: CurrentMap | None = None

    @classmethod
    def further_topics(cls, stage: Stage, topic: str) -> Sequence[WantedTopic]:
        topic = f"{topic}_updates"
        kinds = (UPDATE,)
        return [
            WantedTopic(topic, kinds, optional=True, as_published=True, replaces_previous=False)
        ]

    def style(self) -> Sequence[rr.AsComponents]:
        scheme = self.settings.color_scheme
        if scheme == AUTO:
            scheme = "costmap" if "costmap" in self.entity else "map"
        layer = -1.0 if self.settings.draw_behind else float(scheme == "costmap")
        colors, alpha = _COLORMAPS[scheme], self.settings.alpha
        return [rr.GridMap.from_fields(colormap=colors, opacity=alpha, draw_order=layer)]

    def add(self, stamp_ns: int, message: Any) -> None:
        """Add a map, or an update, which is ignored before there is a map.

        Their stamps are not compared, as in RViz, since the clock may have been set back.
        """
        if hasattr(message, "info"):
            self._grid = _grid(message)
        elif self._grid is None:
            return
        else:
            self._grid = _updated(self._grid, message)
        super().add(stamp_ns, self._grid)

    def draw(self, message: Any) -> Sequence[rr.AsComponents | ReadyColumn]:
        """Return the cells, the highest y first, and the map's pose and cell size."""
        if not message.cells.size:
            self.stage.clear(self.entity, self.stamp_ns, self.entity_frame)
            self._logged_at = time.monotonic()
            return ()
        info = message.info
        place = info.origin.array().tobytes()
        return [_cells(message.cells), *_placed(info.width, info.height, info.resolution, place)]


def _updated(grid: CurrentMap, update: Any) -> CurrentMap:
    """Return a map with an update applied."""
    cells = grid.cells.copy()
    inside = cells[update.y : update.y + update.height, update.x : update.x + update.width]
    if min(update.x, update.y) < 0 or inside.shape != (update.height, update.width):
        raise ValueError(
            f"an update of {update.width} x {update.height} cells at ({update.x}, {update.y}) "
            f"is not within the map of {cells.shape[1]} x {cells.shape[0]}"
        )
    inside[:] = update.data.reshape(inside.shape)
    return grid._replace(cells=cells)


def _cells(cells: NDArray[np.int8]) -> ReadyColumn:
    """Return cells as an image, whose first row has the highest y."""
    image = empty(cells.shape, np.uint8)
    image[...] = np.flipud(cells).view(np.uint8)
    return _data(image.reshape(-1))


@lru_cache(maxsize=16)
def _placed(width: int, height: int, cell_size: float, origin: bytes) -> Sequence[ReadyColumn]:
    """Return a map's geometry as columns that can be logged many times."""
    place, rotation = np.split(np.frombuffer(origin), [3])
    kind = rr.components.ImageFormat(width, height, color_model="L", channel_datatype="U8")
    turn = rr.Quaternion(xyzw=normalized(rotation))
    return one_row(
        rr.GridMap.from_fields(format=kind, cell_size=cell_size, translation=place, quaternion=turn)
    )


def _grid(message: Any) -> CurrentMap:
    """Check an OccupancyGrid message and return it as a map."""
    info = message.info
    origin = info.origin.array()
    if len(message.data) and not (0 < info.resolution < math.inf and is_drawable(origin)):
        raise ValueError(f"its resolution is {info.resolution:g} m, its origin {origin.tolist()}")
    return CurrentMap(message.header, info, message.data.reshape(info.height, info.width))
