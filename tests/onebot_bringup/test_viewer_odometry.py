"""Odometry: arrows, trails, and how sure the pose is."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from nav_msgs.msg import Odometry

from onebot_bringup.viewer.displays.pose import ellipse_outline, sector_outline
from tests.onebot_bringup.drive_support import chunks, column, frames, odometry, stamps, strips
from tests.onebot_bringup.viewer_support import (
    START_NS,
    Shown,
    describe,
    show,
    stamped,
    take_odometry,
    take_tf,
    transforms,
)

# --- arrows ---------------------------------------------------------------------------------------


def driven(x, yaw=0.0, number=0, frame="base") -> Odometry:
    """A robot on the x axis."""
    message = stamped(odometry(x), START_NS + number, frame)
    turn = message.pose.pose.orientation
    turn.z, turn.w = np.sin(yaw / 2), np.cos(yaw / 2)
    return message


def _shown(folder, settings, *messages):
    """Where the arrows of each row begin, and what is warned of."""
    sent = [("/odom", message) for message in messages]
    file, warnings = show(folder, f"odometry: {settings}", *sent)
    rows = column(file, "/odometry/odom", "Arrows3D:origins")
    return [[x for x, _, _ in row] for row in rows], warnings


def test_an_arrow_each_eighth_of_a_meter(tmp_path):
    """The last ones, each with those before it."""
    drive = [driven(x / 16, number=x) for x in range(9)]
    rows, warnings = _shown(tmp_path, "{keep: 3, position_tolerance: 0.125}", *drive)
    last = [[0], [0, 1], [0, 1, 2], [1, 2, 3], [2, 3, 4]]
    assert rows == [[eighths / 8 for eighths in row] for row in last]
    assert warnings == []


@pytest.mark.parametrize(
    ("view", "visible"),
    [
        ("", True),
        ("trails: {a: {topic: odom}}", False),
        ("covariance: {a: {topic: odom}}", False),
        ("speeds: {lines: {a: {topic: odom, type: Odometry}}}", True),
        ("{trails: {a: {topic: odom}}, shown: [odom]}", True),
    ],
)
def test_what_has_a_trail_is_not_shown_by_itself(tmp_path, view, visible):
    """It would be there twice; it may be asked for."""
    shown = Shown(tmp_path, view, resolve=lambda name: f"/{name.lstrip('/')}")
    shown.send("/odom", driven(0))
    assert [each.visible for each in shown.view.offered] == [visible]
    shown.end()


def test_arrows_are_in_proportion_to_the_robot(tmp_path):
    """Once it is known; without one they are as RViz's."""
    box = '<visual><geometry><box size="0.03 0.04 0.12"/></geometry></visual>'
    shown = Shown(tmp_path, robot=False)
    take_tf(shown.view, transforms("base", "tip", 0.5))
    shown.send("/odom", driven(0))
    shown.tick()
    describe(shown.view, f'<robot name="small"><link name="base">{box}</link></robot>')
    shown.tick()
    shown.send("/odom", driven(1, number=1))
    vectors = column(shown.end(), "/odometry/odom", "Arrows3D:vectors")
    assert np.concatenate(vectors).ravel() == pytest.approx([1.3, 0, 0, *[0.65 * 0.13, 0, 0] * 2])


def test_another_look_keeps_the_arrows(tmp_path):
    """All that were there."""
    shown = Shown(tmp_path)
    shown.send("/odom", *(driven(number, number=number) for number in range(3)))
    shown.tick()
    shown.look("odometry: {color: [1, 2, 3]}")
    file = shown.end()
    rows = column(file, "/odometry/odom", "Arrows3D:origins")
    assert [len(row) for row in rows] == [1, 2, 3, 3]
    assert column(file, "/odometry/odom", "Arrows3D:colors")[-1] == [0x010203FF]


# --- trails ---------------------------------------------------------------------------------------


def _flushed(tmp_path, samples, settings="color: [255, 0, 0]"):
    """The pieces in the file after ``samples``, (time, message) each."""
    shown = Shown(tmp_path, f"trails: {{way: {{topic: odom, {settings}}}}}", robot=False)
    for frame in ("base", "map"):
        take_tf(shown.view, transforms("odom", frame, 0.0))
    for stamp, sample in samples:
        take_odometry(shown.view, "odom", stamp, sample)
    return strips(shown.end(), "way")


def test_a_piece_begins_where_the_last_one_ended_at_its_own_time(tmp_path):
    """One call carries all pieces, in the message's frame, in the trail's color and width."""
    samples = [(START_NS + i, odometry(0.1 * i, 0.2 * i)) for i in range(5)]
    pieces = _flushed(tmp_path, samples, "color: [255, 0, 0], height: -0.5, width: 0.02")
    ends = [[0.1 * i, 0.2 * i, -0.5] for i in range(5)]
    np.testing.assert_allclose(pieces, list(zip(ends, ends[1:], strict=False)), atol=1e-6)
    style, moving = chunks(tmp_path / "x.rrd", "/trails/way")
    assert style.is_static and moving.num_rows == 4
    assert stamps(tmp_path / "x.rrd", "/trails/way") == [START_NS + i for i in range(1, 5)]
    assert frames(tmp_path / "x.rrd", "/trails/way") == ["odom"]
    [[color]] = column(tmp_path / "x.rrd", "/trails/way", "LineStrips3D:colors")
    assert color == 0xFF0000FF
    [[radius]] = column(tmp_path / "x.rrd", "/trails/way", "LineStrips3D:radii")
    assert radius == pytest.approx(0.01)


@pytest.mark.parametrize(
    ("stamp", "x", "frame"),
    [
        (5, 1.0, "odom"),  # a teleport
        (-1, 0.2, "odom"),  # a simulation that begins anew
        (5, 0.2, "map"),
    ],
)
def test_a_jump_breaks_the_line(tmp_path, stamp, x, frame):
    """No piece leads there; the line goes on from there."""
    samples = [
        (START_NS, odometry(0.0)),
        (START_NS + 1, odometry(0.1)),
        (START_NS + stamp, odometry(x, frame=frame)),
        (START_NS + stamp + 1, odometry(x + 0.1, frame=frame)),
    ]
    pieces = _flushed(tmp_path, samples)
    wanted = np.array([[x, 0.0, 0.0], [x + 0.1, 0.0, 0.0]])
    assert any(np.allclose(piece, wanted, atol=1e-6) for piece in pieces)
    assert max(np.linalg.norm(piece[1] - piece[0]) for piece in pieces) < 0.11


def test_nothing_that_is_not_finite_is_drawn(tmp_path):
    """NaN, what is infinite in 32 bits, and no frame break the line, and leave no trace."""
    places = [0.0, 0.1, np.nan, 0.2, 0.3, 1e300, 0.4, 0.5]
    samples = [(START_NS + i, odometry(x)) for i, x in enumerate(places)]
    samples += [(START_NS + 8, odometry(0.6, frame="")), (START_NS + 9, odometry(0.7))]
    pieces = _flushed(tmp_path, samples)
    assert np.isfinite(pieces).all()
    np.testing.assert_allclose([p[:, 0] for p in pieces], [[0, 0.1], [0.2, 0.3], [0.4, 0.5]])


def test_a_trail_in_another_frame_waits_for_it_and_says_so(tmp_path):
    """It appears, from its start, once the static transform comes."""
    now = [0.0]
    view = "{fixed_frame: base, trails: {truth: {topic: truth}}}"
    shown = Shown(tmp_path, view, clock=lambda: now[0])
    for step in range(41):
        stamp = START_NS + step
        take_odometry(shown.view, "truth", stamp, odometry(0.1 * step, frame="world"))
        assert shown.tick(stamp) == []
    now[0] = 4.0
    [message] = shown.tick()
    assert 'trail "truth" is in the frame "world"' in message and '"base"' in message
    assert shown.tick() == [], "said once"
    take_tf(shown.view, transforms("world", "base", 0.0), static=True)
    assert len(strips(shown.end(), "truth")) == 40


# --- covariances ----------------------------------------------------------------------------------


def _covariance(xx=0.0, yy=0.0, xy=0.0, yaw=0.0):
    matrix = np.zeros((6, 6))
    matrix[0, 0], matrix[1, 1], matrix[0, 1], matrix[1, 0] = xx, yy, xy, xy
    matrix[5, 5] = yaw
    return matrix.ravel()


@given(
    along=st.floats(0.01, 10.0),
    ratio=st.floats(0.0, 0.95),
    angle=st.floats(-math.pi, math.pi),
    sigma=st.floats(0.5, 4.0),
)
def test_the_ellipse_has_the_deviations_that_went_in(along, ratio, angle, sigma):
    """Of a covariance made of two deviations and a direction; a line if one direction is sure."""
    cos, sin = math.cos(angle), math.sin(angle)
    turn = np.array([[cos, -sin], [sin, cos]])
    matrix = turn @ np.diag([along**2, (ratio * along) ** 2]) @ turn.T
    points = ellipse_outline(_covariance(matrix[0, 0], matrix[1, 1], matrix[0, 1]), sigma)
    assert points.shape == (49, 3) and not points[:, 2].any()
    np.testing.assert_allclose(points[0], points[-1], atol=1e-9)
    ahead, aside = (points[:, :2] @ turn / (sigma * along)).T
    turns = np.linspace(0.0, math.tau, 49)
    np.testing.assert_allclose(ahead**2, np.cos(turns) ** 2, atol=1e-6)
    np.testing.assert_allclose(aside**2, (ratio * np.sin(turns)) ** 2, atol=1e-6)


def test_the_sector_is_as_wide_as_the_heading_is_unsure():
    """It opens to either side, at most all round; an unknown yaw has none."""
    points = sector_outline(0.04, 1.0, 3.0, 0.5)[1:-1]
    angles = np.arctan2(points[:, 1], points[:, 0])
    assert angles.min() == pytest.approx(0.4) and angles.max() == pytest.approx(1.6)
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), 0.5)
    whole = sector_outline(50.0, 0.0, 3.0, 0.5)[1:-1]
    assert np.ptp(np.unwrap(np.arctan2(*whole[:, 1::-1].T))) < 6.29
    for unknown in (0.0, -1.0, math.nan, math.inf):
        assert sector_outline(unknown, 0.0, 3.0, 0.5) is None
    assert sector_outline(0.04, math.nan, 3.0, 0.5) is None
    assert sector_outline(0.04, 0.0, 3.0, 0.0) is None


def _scattered(tmp_path, covariances, settings="heading: 0.5"):
    shown = Shown(tmp_path, f"covariance: {{pose: {{topic: odom, {settings}}}}}")
    for step, covariance in enumerate(covariances):
        stamp = START_NS + step * 10**8
        take_tf(shown.view, transforms("odom", "base", 0.0, stamp))
        message = odometry(0.5, -1.0 + step)
        message.pose.covariance = covariance
        turn = message.pose.pose.orientation
        turn.z = turn.w = 0.5**0.5  # to the left
        take_odometry(shown.view, "odom", stamp, message)
        shown.tick(stamp)
    return shown.end()


def _outlines(file):
    """The outlines of each row, (49, 3) each."""
    rows = column(file, "/covariance/pose", "LineStrips3D:strips")
    return [[np.array(line) for line in row] for row in rows]


def test_a_covariance_goes_with_the_robot(tmp_path):
    """The ellipse around its place as the frame lies, the sector turned with it, at each time."""
    file = _scattered(tmp_path, [_covariance(0.04, 0.01, yaw=0.01)] * 3, "sigma: 2.0, heading: 0.5")
    rows = _outlines(file)
    assert len(rows) == 3 and frames(file, "/covariance/pose") == ["odom"]
    for step, (ellipse, sector) in enumerate(rows):
        place = np.array([0.5, -1.0 + step, 0.0])
        np.testing.assert_allclose(np.ptp(ellipse, axis=0), [0.8, 0.4, 0.0], atol=1e-6)
        np.testing.assert_allclose(ellipse[:-1].mean(axis=0), place, atol=1e-6)
        np.testing.assert_allclose(sector[0], place, atol=1e-6)
        np.testing.assert_allclose(sector[1:-1].mean(axis=0)[0], place[0], atol=1e-6)
        assert sector[:, 1].max() == pytest.approx(place[1] + 0.5, abs=1e-3)
    times = [START_NS + step * 10**8 for step in range(3)]
    assert stamps(file, "/covariance/pose") == times


def test_it_goes_when_it_is_unknown(tmp_path):
    """Of one that is none, or as large as none, nothing is left."""
    for wrong in (-1.0, 1e6, math.nan, math.inf):
        last = _covariance(wrong, wrong)
        file = _scattered(tmp_path, [_covariance(), _covariance(0.36, 0.04), last])
        assert [len(row) for row in _outlines(file)] == [0, 1, 0]
