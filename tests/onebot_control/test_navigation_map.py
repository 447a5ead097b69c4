"""The map that scans make, and maps as files."""

import math

import numpy as np
import pytest
from PIL import Image

from onebot_control.navigation.grid import GridMap, LevelScan, Window
from onebot_control.navigation.map_files import load_map, save_map
from onebot_control.occupancy_grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from onebot_description.errors import OneBotError
from onebot_description.geometry.poses import PlanarPose

ORIGIN = PlanarPose()
RAYS, STEP = 360, math.tau / 360
BEARINGS = -math.pi + STEP * np.arange(RAYS)


def room_scan(pose: PlanarPose = ORIGIN, half: float = 2.02, reach: float = 12.0) -> LevelScan:
    """The ranges in a square room around the origin, seen from a pose in it."""
    angles = BEARINGS + pose.yaw
    cos, sin = np.cos(angles), np.sin(angles)
    with np.errstate(divide="ignore"):
        x = (np.copysign(half, cos) - pose.x) / cos
        y = (np.copysign(half, sin) - pose.y) / sin
    return LevelScan(np.minimum(x, y).astype(np.float32), -math.pi, STEP, reach)


def entered(*poses: PlanarPose, times: int = 3, **room: float) -> GridMap:
    grid = GridMap()
    for pose in poses:
        for _ in range(times):
            scan = room_scan(pose, **room)
            grid.enter(scan, scan.points, pose)
    return grid


def value(grid: GridMap, x: float, y: float) -> int:
    data = grid.occupancy().data
    row, column = grid.cells(np.array([(x, y)]))[0]
    return int(data[row, column])


def test_rays_clear_and_their_ends_fill():
    grid = entered(PlanarPose(0.3, -0.2, 0.7))
    assert value(grid, 0.3, -0.2) == value(grid, 1.8, 1.8) == value(grid, -1.7, 0.0) == FREE
    assert (
        value(grid, 2.02, 0.5) == value(grid, -2.02, -1.01) == value(grid, 0.61, 2.02) == OCCUPIED
    )
    assert value(grid, 2.3, 0.0) == UNKNOWN


def test_what_is_gone_is_cleared_within_three_scans():
    grid = entered(PlanarPose(), half=1.02)
    assert value(grid, 1.02, 0.3) == OCCUPIED
    scan = room_scan()
    for _ in range(10):
        grid.enter(scan, scan.points, PlanarPose())
    assert value(grid, 1.02, 0.3) == FREE
    assert value(grid, 2.02, 0.3) == OCCUPIED


def test_what_comes_later_is_an_obstacle_but_no_wall():
    """Something where the map was free moves, so that no scan is matched to it."""
    grid = entered(PlanarPose(), times=8)
    assert not grid.moved().any() and len(walls := grid.walls()) > 300
    scan = room_scan(half=1.02)
    grid.enter(scan, scan.points, PlanarPose())
    assert value(grid, 1.02, 0.3) == OCCUPIED
    assert grid.moved().sum() == (grid.log_odds > 0.0).sum() - len(walls)
    assert grid.walls().tolist() == walls.tolist()


def test_a_thin_thing_between_two_rays_is_not_cleared():
    """A ray clears a cell only if its neighbor goes as far."""
    grid = GridMap()
    ranges = np.full(RAYS, 4.0, np.float32)
    ranges[RAYS // 2] = 2.0  # straight ahead
    scan = LevelScan(ranges, -math.pi, STEP, 12.0)
    for _ in range(5):
        grid.enter(scan, scan.points, PlanarPose())
    assert value(grid, 2.01, 0.01) == OCCUPIED
    assert value(grid, 1.5, 0.0) == FREE


def test_rays_without_an_end():
    """Infinite ones clear up to the map's reach; NaN and too near ones clear nothing."""
    ranges = np.full(RAYS, np.inf, np.float32)
    ranges[BEARINGS > 0.0] = np.nan
    ranges[BEARINGS > 2.0] = -np.inf
    grid = GridMap(reach=3.0)
    scan = LevelScan(ranges, -math.pi, STEP, 12.0)
    grid.enter(scan, scan.points, PlanarPose())
    assert value(grid, 0.0, -2.5) == FREE
    assert value(grid, 0.0, 1.0) == value(grid, -1.0, 0.3) == UNKNOWN
    assert not len(grid.walls())


def test_walls_are_more_exact_than_cells():
    walls = entered(PlanarPose(0.1, 0.2, 0.3), times=5).walls()
    away = np.abs(np.abs(walls).max(axis=1) - 2.02)
    assert len(walls) > 200 and away.max() < 1e-3


def test_a_map_grows_and_keeps_what_it_has():
    grid = entered(PlanarPose())
    before, rows = value(grid, 2.02, 0.5), grid.shape[0]
    version = grid.version
    corner = np.ones(2)
    assert grid.cover(np.array([-20.0, -1.0]), 25.0 * corner) and not grid.cover(-corner, corner)
    assert grid.shape[0] > rows and grid.version == version + 1
    assert value(grid, 2.02, 0.5) == before == OCCUPIED and value(grid, -15.0, 20.0) == UNKNOWN
    with pytest.raises(ValueError, match="too large"):
        grid.cover(-1e4 * corner, 1e4 * corner)


def test_windows():
    assert Window(2, 3, 4, 5).grown(10, (8, 9)) == (0, 0, 8, 9)
    assert Window(1, 2, 3, 4).union(Window(2, 0, 7, 3)) == (1, 0, 7, 4)


# Files --------------------------------------------------------------------------------------------

GRID = OccupancyGrid(np.array([[0, 100, -1], [100, 0, 0]], np.int8), 0.05, (-1.25, 2.0))


@pytest.mark.parametrize("picture", ["pgm", "png"])
def test_a_map_is_read_as_it_was_written(tmp_path, picture):
    file = save_map(GRID, tmp_path / "office", picture)
    assert file == tmp_path / "office.yaml"
    read = load_map(file)
    assert read.data.tolist() == GRID.data.tolist()
    assert read.resolution == 0.05 and read.origin == (-1.25, 2.0)
    with Image.open(tmp_path / f"office.{picture}") as image:  # its first row is the top one
        assert np.asarray(image).tolist() == [[0, 254, 254], [254, 0, 205]]


def written(folder, text: str = "", shades=((0, 100, 205, 254),), mode: str = "L"):
    Image.fromarray(np.array(shades, np.uint8), mode).save(folder / "map.png")
    file = folder / "map.yaml"
    file.write_text(text or "image: map.png\nresolution: 0.1\norigin: [0, 0, 0]\n")
    return file


COMMON = "image: map.png\nresolution: 0.1\norigin: [0, 0, 0]\n"


@pytest.mark.parametrize(
    ("more", "cells"),
    [
        ("", [100, -1, -1, 0]),
        ("occupied_thresh: 0.6\nfree_thresh: 0.25\n", [100, 100, 0, 0]),
        ("mode: scale\noccupied_thresh: 0.9\nfree_thresh: 0.1\n", [100, 63, 12, 0]),
        ("mode: raw\n", [0, 100, -1, -1]),
        ("negate: true\n", [0, -1, 100, 100]),
    ],
)
def test_modes_and_thresholds(tmp_path, more, cells):
    """Shades 0, 100, 205, 254 as map_server reads them; the share is (255 - shade) / 255."""
    assert load_map(written(tmp_path, COMMON + more)).data.tolist() == [cells]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "image: is missing"),
        ("image: no.pgm\nresolution: 1\norigin: [0, 0, 0]", r"no\.pgm: cannot be read: No such"),
        ("image: map.yaml\nresolution: 1\norigin: [0, 0, 0]", "is not an image; write a PGM"),
        ("image: map.png\nresolution: 0\norigin: [0, 0, 0]", "resolution: 0 is not above 0"),
        ("image: map.png\nresolution: .nan\norigin: [0, 0, 0]", "resolution: nan is not finite"),
        ("image: map.png\nresolution: 1\norigin: [0, 0]", "origin: 2 numbers; write 3"),
        ("image: map.png\nresolution: 1\norigin: [0, 0, 1]", "a yaw of 1 rad; only 0 is supported"),
        ("image: map.png\norigin: [0, 0, 0]", "resolution"),
        (COMMON + "negat: 1", 'did you mean "negate"'),
        (COMMON + "free_thresh: 0.7", "free_thresh must be below occupied_thresh"),
        ("[", "invalid YAML"),
        ("- a", "a list is in place of a map"),
    ],
)
def test_bad_files_get_one_sentence(tmp_path, text, message):
    file = written(tmp_path)
    file.write_text(text)
    with pytest.raises(OneBotError, match=message) as error:
        load_map(file)
    assert str(tmp_path) in str(error.value) and "\n\n" not in str(error.value)


def test_files_that_are_missing_or_huge(tmp_path, monkeypatch):
    with pytest.raises(OneBotError, match=r"office\.yaml: cannot be read: No such file"):
        load_map(tmp_path / "office.yaml")
    file = written(tmp_path, COMMON)
    (tmp_path / "map.png").write_bytes(b"P5\n99999 99999\n255\n")
    with pytest.raises(OneBotError, match=r"map\.png: has more than 16,000,000 pixels"):
        load_map(file)
    with pytest.raises(OneBotError, match="cannot be written"):
        save_map(GRID, tmp_path / "no" / "office")
    with pytest.raises(OneBotError, match="bmp: not an image format; write pgm"):
        save_map(GRID, tmp_path / "office", "bmp")
