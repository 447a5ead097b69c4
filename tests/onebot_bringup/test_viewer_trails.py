"""What is in the file after odometry was collected and flushed."""

import numpy as np
import pytest

from onebot_bringup.viewer.displays.odometry import JUMP, SPACING
from tests.onebot_bringup.drive_support import chunks, column, frames, odometry, strips
from tests.onebot_bringup.viewer_support import START_NS, Shown, take_odometry, take_tf, transforms


def _flushed(tmp_path, samples, settings="color: [255, 0, 0]"):
    """The pieces in the file after ``samples``, (time, message) each."""
    shown = Shown(tmp_path, f"trails: {{way: {{topic: odom, {settings}}}}}", robot=False)
    for frame in ("base", "map"):
        take_tf(shown.view, transforms("odom", frame, 0.0))
    for stamp, sample in samples:
        take_odometry(shown.view, "odom", stamp, sample)
    return strips(shown.end(), "way")


def test_a_piece_begins_where_the_last_one_ended_at_its_own_time(tmp_path):
    """One call carries all pieces, in the message's frame, in the trail's colour and width."""
    samples = [(START_NS + i, odometry(0.1 * i, 0.2 * i)) for i in range(5)]
    pieces = _flushed(tmp_path, samples, "color: [255, 0, 0], height: -0.5, width: 0.02")
    ends = [[0.1 * i, 0.2 * i, -0.5] for i in range(5)]
    np.testing.assert_allclose(pieces, list(zip(ends, ends[1:], strict=False)), atol=1e-6)
    style, moving = chunks(tmp_path / "x.rrd", "/trails/way")
    assert style.is_static and moving.num_rows == 4
    times = moving.to_record_batch().column("ros_time").cast("int64").to_pylist()
    assert times == [START_NS + i for i in range(1, 5)]
    assert frames(tmp_path / "x.rrd", "/trails/way") == ["odom"]
    [[color]] = column(tmp_path / "x.rrd", "/trails/way", "LineStrips3D:colors")
    assert color == 0xFF0000FF
    [[radius]] = column(tmp_path / "x.rrd", "/trails/way", "LineStrips3D:radii")
    assert radius == pytest.approx(0.01)


def test_the_trail_grows_by_the_way_not_by_the_messages(tmp_path):
    """A robot that stands, or trembles by less than the spacing, adds nothing."""
    rng = np.random.default_rng(1)
    still = [(START_NS + i, odometry(*rng.uniform(-0.4, 0.4, 2) * SPACING)) for i in range(500)]
    assert _flushed(tmp_path, still) == []
    slow = [(START_NS + i, odometry(0.0005 * i)) for i in range(2001)]
    assert 90 <= len(_flushed(tmp_path, slow)) <= 100, "a metre, a piece a centimetre"


@pytest.mark.parametrize(
    ("stamp", "sample"),
    [
        (5, odometry(1.0)),  # a teleport
        (-1, odometry(0.2)),  # a simulation that begins anew
        (5, odometry(0.2, frame="map")),
    ],
)
def test_a_jump_breaks_the_line(tmp_path, stamp, sample):
    """No piece leads there; the line goes on from there."""
    after = sample._replace(translation=sample.translation + np.array([0.1, 0, 0]))
    samples = [
        (START_NS, odometry(0.0)),
        (START_NS + 1, odometry(0.1)),
        (START_NS + stamp, sample),
        (START_NS + stamp + 1, after),
    ]
    pieces = _flushed(tmp_path, samples)
    wanted = np.array([sample.translation, after.translation])
    assert any(np.allclose(piece, wanted, atol=1e-6) for piece in pieces)
    assert max(np.linalg.norm(piece[1] - piece[0]) for piece in pieces) < 0.11


def test_nothing_that_is_not_finite_is_drawn(tmp_path):
    """NaN, infinity and what is that in 32 bits break the line, and leave no trace."""
    places = [0.0, 0.1, np.nan, 0.2, 0.3, 1e300, 0.4, 0.5]
    samples = [(START_NS + i, odometry(x)) for i, x in enumerate(places)]
    pieces = _flushed(tmp_path, samples)
    assert np.isfinite(pieces).all()
    np.testing.assert_allclose([p[:, 0] for p in pieces], [[0, 0.1], [0.2, 0.3], [0.4, 0.5]])


@pytest.mark.parametrize(
    ("step", "pieces"),
    [(SPACING, 1), (SPACING * 0.999, 0), (JUMP, 1), (JUMP * 1.001, 0)],
)
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_how_far_a_piece_may_lead(tmp_path, step, pieces, axis):
    """From the spacing on, up to the longest way that is driven between two messages."""
    place = np.zeros(3)
    for sign in (1, -1):
        place[axis] = sign * step
        samples = [(START_NS, odometry(0.0)), (START_NS + 1, odometry(*place))]
        assert len(_flushed(tmp_path, samples)) == pieces


def test_a_jump_is_measured_from_the_last_message(tmp_path):
    """Not from where the last piece ended; nor is the piece from there across the jump drawn."""
    near = SPACING * 0.9
    samples = [
        (START_NS, odometry(0.0)),
        (START_NS + 1, odometry(near)),
        (START_NS + 2, odometry(near + JUMP * 0.999)),
        (START_NS + 3, odometry(near + JUMP * 2.1)),
        (START_NS + 4, odometry(near + JUMP * 2.2)),
    ]
    pieces = _flushed(tmp_path, samples)
    ends = [[0.0, near + JUMP * 0.999], [near + JUMP * 2.1, near + JUMP * 2.2]]
    np.testing.assert_allclose([piece[:, 0] for piece in pieces], ends, rtol=1e-6)


def test_a_message_without_a_frame_breaks_the_line(tmp_path):
    """It says nothing of where the robot is."""
    samples = [
        (START_NS, odometry(0.0)),
        (START_NS + 1, odometry(0.1, frame="")),
        (START_NS + 2, odometry(0.2)),
        (START_NS + 3, odometry(0.3)),
    ]
    pieces = _flushed(tmp_path, samples)
    np.testing.assert_allclose([piece[:, 0] for piece in pieces], [[0.2, 0.3]])
