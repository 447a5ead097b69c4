"""Occupancy grids: their cells, place and colors, updates, and what is bad."""

import struct

import numpy as np
import pytest
import rerun as rr
from nav_msgs.msg import OccupancyGrid

from onebot_bringup.viewer.displays.map import UPDATE
from onebot_bringup.viewer.view_config import parse_view
from tests.onebot_bringup import viewer_support as support
from tests.onebot_bringup.drive_support import column, frames, stamps
from tests.onebot_bringup.viewer_support import (
    START_NS,
    drawn,
    show,
    stamped,
    take,
)

MAP = "nav_msgs/msg/OccupancyGrid"
SECOND = 10**9


def grid(cells, *, resolution=0.5, x=0.0, frame="base", stamp_ns=START_NS) -> OccupancyGrid:
    """A map of these cells, the row of the lowest y first."""
    cells = np.array(cells, np.int8)
    message = stamped(OccupancyGrid(data=cells.ravel().tolist()), stamp_ns, frame)
    message.info.height, message.info.width = cells.shape
    message.info.resolution, message.info.origin.position.x = resolution, x
    message.info.origin.orientation.w = 1.0
    return message


def update(x, y, cells, stamp_ns, cut=0) -> bytes:
    """An OccupancyGridUpdate, which need not be installed."""
    cells = np.array(cells, np.int8)
    header = struct.pack("<iiI4s", *divmod(stamp_ns, SECOND), 4, b"map\0")
    body = struct.pack("<iiIII", x, y, *cells.shape[::-1], cells.size - cut)
    return b"\0\1\0\0" + header + body + cells.tobytes()[: cells.size - cut]


class Shown(support.Shown):
    """A view with one map topic."""

    def __init__(self, folder):
        super().__init__(folder)
        assert self.view.offer({"/map": MAP}) == []
        self.now, self.warnings = START_NS, []

    def take(self, message: OccupancyGrid) -> None:
        take(self.view, "/map", message, self.now)

    def update(self, *arguments, **options) -> None:
        data = update(*arguments, self.now, **options)
        self.view.take("/map_updates", UPDATE.name, data, self.now)

    def tick(self) -> None:
        self.warnings += self.view.tick(self.now)
        self.now += SECOND

    def cells(self) -> list:
        """The cells of each row, the lowest y first; None for none."""
        self.end()
        data = column(self.file, "/map/map", "GridMap:data")
        forms = column(self.file, "/map/map", "GridMap:format")
        return [
            np.flipud(np.array(blob[0], np.uint8).view(np.int8).reshape(form[0]["height"], -1))
            for blob, form in zip(filter(None, data), filter(None, forms), strict=True)
        ]


def test_a_map_is_where_its_origin_is(tmp_path):
    """Its cells by rows, the upper one first; turned, and in its frame at its time."""
    message = grid([[0, 100, -1], [1, 2, 3]], x=2.0, frame="tip")
    turn = message.info.origin.orientation
    turn.z, turn.w = 2.0, 2.0  # of any length
    file = drawn(tmp_path, "map: {alpha: 0.5}", ("/map", message))
    [[data]] = column(file, "/map/map", "GridMap:data")
    assert data == [1, 2, 3, 0, 100, 255]
    [[form]] = column(file, "/map/map", "GridMap:format")
    assert (form["width"], form["height"]) == (3, 2)
    assert column(file, "/map/map", "GridMap:cell_size") == [[0.5]]
    assert column(file, "/map/map", "GridMap:translation") == [[[2.0, 0.0, 0.0]]]
    [[quaternion]] = column(file, "/map/map", "GridMap:quaternion")
    assert quaternion == pytest.approx([0.0, 0.0, 0.5**0.5, 0.5**0.5])
    assert column(file, "/map/map", "GridMap:opacity") == [[0.5]]
    assert frames(file, "/map/map") == ["tip"]
    assert stamps(file, "/map/map") == [START_NS]


@pytest.mark.parametrize(
    ("topic", "settings", "colormap", "layer"),
    [
        ("/map", "{}", "RvizMap", 0),
        ("/local_costmap/costmap", "{}", "RvizCostmap", 1),
        ("/map", "{color_scheme: raw}", "Grayscale", 0),
        ("/costmap", "{color_scheme: map, draw_behind: true}", "RvizMap", -1),
    ],
)
def test_colors_are_rviz_s(tmp_path, topic, settings, colormap, layer):
    """A costmap is seen above the map that it is of."""
    file, _ = show(tmp_path, f"map: {settings}", (topic, grid([[0]])))
    expected = rr.components.Colormap[colormap].value
    assert column(file, f"/map{topic}", "GridMap:colormap") == [[expected]]
    assert column(file, f"/map{topic}", "GridMap:draw_order") == [[layer]]


def test_updates_change_the_map(tmp_path):
    """Each after the one before; of those that come together only the last is logged."""
    shown = Shown(tmp_path)
    shown.update(0, 0, [[9]])  # of no map yet
    shown.tick()
    shown.take(grid(np.zeros((3, 4))))
    shown.tick()
    shown.update(1, 2, [[5, 6]])
    shown.tick()
    shown.update(0, 0, [[7], [8]])
    shown.update(3, 0, [[9]])
    shown.tick()
    shown.take(grid([[1, 1]], stamp_ns=shown.now))
    shown.update(0, 0, [[2]])
    shown.tick()
    first, second, third, fourth = shown.cells()
    assert not first.any()
    np.testing.assert_array_equal(second, [[0] * 4, [0] * 4, [0, 5, 6, 0]])
    np.testing.assert_array_equal(third, [[7, 0, 0, 9], [8, 0, 0, 0], [0, 5, 6, 0]])
    np.testing.assert_array_equal(fourth, [[2, 1]])
    assert shown.warnings == []


@pytest.mark.parametrize(
    ("place", "cells", "cut", "reported"),
    [
        ((-1, 0), [[1]], 0, "an update of 1 x 1 cells at (-1, 0) is not within the map of 4 x 3"),
        ((3, 0), [[1, 1]], 0, "an update of 2 x 1 cells at (3, 0) is not within"),
        ((2**31 - 1, 2**31 - 1), [[1, 1]], 0, "is not within"),
        ((0, 0), [[1, 1]], 1, "cannot reshape array of size 1 into shape (1,2)"),
    ],
)
def test_bad_updates_are_refused(tmp_path, place, cells, cut, reported):
    """Outside of the map, or with too few cells; the map stays, and others come through."""
    shown = Shown(tmp_path)
    shown.take(grid(np.zeros((3, 4))))
    shown.tick()
    shown.update(*place, cells, cut=cut)
    shown.tick()
    shown.update(9, 9, [[1]])
    shown.tick()
    shown.update(0, 0, [[1]])
    shown.tick()
    assert [cells.sum() for cells in shown.cells()] == [0, 1]
    [warning] = shown.warnings
    assert warning.startswith('map "/map": ') and reported in warning


def test_an_empty_map_clears(tmp_path):
    """Its resolution may be anything; another map is shown again."""
    empty = grid([[0, 0]], resolution=0.0, stamp_ns=START_NS + 1)
    empty.info.width, empty.data = 0, []
    shown = Shown(tmp_path)
    for message in (grid([[7]]), empty, grid([[8]], stamp_ns=START_NS + 2)):
        shown.take(message)
        shown.tick()
    assert [cells.tolist() for cells in shown.cells()] == [[[7]], [[8]]]
    assert column(tmp_path / "x.rrd", "/map/map", "Clear:is_recursive") == [[False]]


def test_updates_are_subscribed_with_their_map(tmp_path):
    """Once they are published."""
    shown = Shown(tmp_path)
    assert shown.view.topics["/map_updates"].optional
    shown.view.set_view(parse_view("hidden: [/map]"))
    assert not {"/map", "/map_updates"} & set(shown.view.topics)
    shown.cells()
