"""Laser scans: the points, colors, frames and times in the file."""

import numpy as np
import pytest
from sensor_msgs.msg import LaserScan

from tests.onebot_bringup.drive_support import column, frames, stamps
from tests.onebot_bringup.viewer_support import (
    START_NS,
    Shown,
    drawn,
    show,
    stamped,
    take,
    take_tf,
    transforms,
)

NAN, INF = float("nan"), float("inf")
ENTITY = "/laser_scan/scan"
RED, MAGENTA = 0xFF0000FF, 0xFF00FFFF
ORANGE = 0xFFB020FF  # the first of our colors


def scan(ranges=(1.0, 2.0), frame="base", at=0, **fields) -> LaserScan:
    """A scan that begins to the right and turns left."""
    message = LaserScan(
        angle_min=-np.pi / 2, angle_increment=np.pi / 2, range_min=0.5, range_max=8.0, **fields
    )
    message.ranges = list(ranges)
    return stamped(message, START_NS + at, frame)


def points(file, entity=ENTITY):
    """The positions of each row, (N, 3)."""
    rows = column(file, entity, "Points3D:positions")
    return [np.array(row).reshape(-1, 3) for row in rows]


def colors(file, entity=ENTITY):
    """The colors of each row."""
    return column(file, entity, "Points3D:colors")


def test_ranges_are_points_around_the_sensor(tmp_path):
    """At its time, three pixels wide; the next scan takes their place."""
    sent = scan((1.0, 2.0, 3.0)), scan((4.0,), at=7000)
    file = drawn(tmp_path, "", *(("/scan", each) for each in sent))
    first, second = points(file)
    np.testing.assert_allclose(first, [(0, -1, 0), (2, 0, 0), (0, 3, 0)], atol=1e-6)
    np.testing.assert_allclose(second, [(0, -4, 0)], atol=1e-6)
    assert colors(file) == [[ORANGE], [ORANGE]]
    assert frames(file, ENTITY) == ["base"]
    assert column(file, ENTITY, "Points3D:radii") == [[-1.5]]
    assert stamps(file, ENTITY) == [START_NS, START_NS + 7000]


class Moving(Shown):
    """A sensor "tip" that moves at 2 m/s along y of odom."""

    def __init__(self, folder):
        self._now = 0.0
        clock = {"clock": lambda: self._now, "live": True}
        super().__init__(folder, "fixed_frame: odom", robot=False, **clock)
        self.view.offer({"/scan": "sensor_msgs/msg/LaserScan"})

    def move(self, seconds):
        """Publish its transforms at a time."""
        at = START_NS + round(seconds * 1e9)
        take_tf(self.view, transforms("odom", "base", seconds * 2.0, at))
        take_tf(self.view, transforms("base", "tip", 1.0, at))

    def scan(self, seconds, frame="tip"):
        """Publish a scan of that time."""
        take(self.view, "/scan", scan(frame=frame, at=round(seconds * 1e9)))

    def tick(self, seconds):
        """Show what has come until then; returns the warnings."""
        self._now = seconds
        return super().tick(START_NS + round(seconds * 1e9))


def test_points_stay_where_they_were_measured(tmp_path):
    """By the transform at the time of the message, whatever comes before it is logged."""
    moving = Moving(tmp_path)
    for seconds in range(3):
        moving.move(seconds)
    moving.scan(0.5)
    file = moving.end()
    np.testing.assert_allclose(points(file), [[(0, 1, 0), (2, 2, 0)]], atol=1e-6)
    assert frames(file, ENTITY) == ["odom"]


def test_a_scan_newer_than_the_transforms_waits_for_the_next(tmp_path):
    """A moment only: the second is drawn by those that there are, and the last at the end."""
    moving = Moving(tmp_path)
    for seconds in (0.0, 0.1):
        moving.move(seconds)
    moving.scan(0.15)
    moving.tick(0.16)
    moving.move(0.2)
    moving.scan(0.3)
    for seconds in (0.31, 0.55):
        moving.tick(seconds)
    moving.move(0.6)
    moving.scan(0.65)
    moving.tick(0.66)
    first = [rows[0, 1] for rows in points(moving.end())]
    np.testing.assert_allclose(first, [0.3, 0.4, 1.2], atol=1e-6)


def test_scans_in_two_frames_are_placed_by_the_transforms_of_the_same_tick(tmp_path):
    """All that has come is in the tree before any is drawn; one in an unknown frame is not."""
    moving = Moving(tmp_path)
    moving.move(0.0)
    moving.tick(0.0)
    moving.move(0.5)
    for frame in ("tip", "nowhere", "base"):
        moving.scan(0.5, frame)
    said = moving.tick(0.5)
    file = moving.end()
    placed = points(file)
    np.testing.assert_allclose([rows[0, 1] for rows in placed], [1.0, 0.0], atol=1e-6)
    assert [text for text in said if '"nowhere"' in text] == [
        'laser scan "/scan": messages in "nowhere" are not shown'
    ]


def test_ranges_that_are_none_are_left_out(tmp_path):
    """As RViz does: range_min is a range, range_max is none; intensities stay with theirs."""
    ranges = (0.5, 0.49, 8.0, 7.9, NAN, INF, -INF, -1.0)
    intensities = [0.0, 9.0, 9.0, 1.0, 9.0, 9.0, 9.0, NAN]
    file = drawn(tmp_path, "", ("/scan", scan(ranges, intensities=intensities)))
    [found] = points(file)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), [0.5, 7.9], rtol=1e-6)
    assert colors(file) == [[RED, MAGENTA]]


@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        ("", [RED, 0x00FF7FFF, MAGENTA]),
        ("invert_rainbow: true", [MAGENTA, 0x00FF7FFF, RED]),
        ("use_rainbow: false, max_color: [200, 100, 0]", [0x000000FF, 0x643200FF, 0xC86400FF]),
        (
            "use_rainbow: false, autocompute_intensity_bounds: false, max_intensity: 200",
            [0x000000FF, 0x404040FF, 0x808080FF],
        ),
        ("color_transformer: FlatColor, color: [1, 2, 3]", [0x010203FF]),
        ("color_transformer: Intensity, channel_name: none", [ORANGE]),
        ("color_transformer: AxisColor, axis: Y", [RED, 0x00FF7FFF, MAGENTA]),
    ],
)
def test_colors_are_those_of_rviz(settings, expected, tmp_path):
    """The lowest value is red, the highest magenta, unless the settings name something else."""
    sent = scan((1.0, 1.0, 1.0), intensities=[0.0, 50.0, 100.0])
    file, _ = show(tmp_path, f"laser_scan: {{{settings}}}", ("/scan", sent))
    [found] = colors(file)
    channels = np.array(found, np.uint32).view(np.uint8).astype(int)
    wanted = np.array(expected, np.uint32).view(np.uint8).astype(int)
    assert np.abs(channels - wanted).max() <= 3  # of 256 colors the nearest lower one


def test_points_stay_for_the_decay_time(tmp_path):
    """In the fixed frame, since the sensor moves on."""
    view = "{fixed_frame: base, laser_scan: {decay_time: 2.0, size: 0.1}}"
    file = drawn(tmp_path, view, ("/scan", scan((1.0,), "tip")))
    np.testing.assert_allclose(points(file), [[(0, -0.5, 0)]], atol=1e-6)
    assert frames(file, ENTITY) == ["base"]
    assert column(file, ENTITY, "Points3D:radii") == [[pytest.approx(0.05)]]


def test_a_scan_without_a_frame_is_warned_of(tmp_path):
    """It cannot be drawn; one that follows others is in theirs."""
    file, said = show(tmp_path, "", ("/scan", scan(frame="")), ("/scan", scan(at=1000)))
    assert said == ['laser scan "/scan": its header has no frame_id']
    assert len(points(file)) == 1
