"""A driving robot as Rerun itself shows it: trails, speeds and the camera."""

from onebot_bringup.viewer.robot_view import RobotView
from onebot_bringup.viewer.shown_robot import RobotToShow
from tests.onebot_bringup.drive_support import odometry, strips
from tests.onebot_bringup.viewer_support import (
    START_NS,
    Shown,
    take_command,
    take_odometry,
    take_tf,
    transforms,
)

# From behind and above: +y is to the left in the picture, +x up.
VIEW = """
fixed_frame: odom
axes: {visible: false}
grid: {visible: false}
camera: {eye: [-3.0, 2.0, 8.0], target: [0.0, 2.0, 0.0]}
joint_plot: {positions: false, velocities: false}
trails:
  way: {topic: odom, color: [0, 220, 60], width: 0.2, length: 100}
  truth: {topic: truth, color: [230, 20, 200], width: 0.2, length: 100}
"""
TENTH = 10**8


def _drive(live: RobotView, frame="odom", steps=41, truth="odom") -> list[str]:
    """Drive 0.1 m along y every tenth of a second; the truth is a metre further along x."""
    said = []
    for step in range(steps):
        stamp, y = START_NS + step * TENTH, 0.1 * step
        take_tf(live, transforms("base", "tip", 0.5, stamp))
        take_tf(live, transforms(frame, "base", y, stamp))
        take_odometry(live, "odom", stamp, odometry(0, y, frame=frame, speed=1.0, turn=0.2))
        take_odometry(live, "truth", stamp, odometry(1, y, frame=truth))
        take_command(live, "cmd_vel", stamp, 1.5, 0.3)
        said += live.tick(stamp)
    live.finish()
    return said


def test_a_trail_in_another_frame_waits_for_it_and_says_so(tmp_path):
    """A truth in "world" appears, from its start, once the static transform comes."""
    now = [0.0]
    shown = Shown(tmp_path, VIEW, clock=lambda: now[0])
    live = shown.view
    assert _drive(live, truth="world") == []
    assert live.tick(START_NS) == []
    now[0] = 4.0
    [message] = live.tick(START_NS)
    assert 'trail "truth" is in the frame "world"' in message and '"odom"' in message
    assert live.tick(START_NS) == [], "said once"
    take_tf(live, transforms("world", "odom", 0.0), static=True)
    assert len(strips(shown.end(), "truth")) == 40


def test_the_fixed_frame_is_found_under_the_prefix(tmp_path):
    """A view for odom serves a robot whose frames carry a prefix."""
    live = Shown(tmp_path, VIEW, robots=[RobotToShow("", "r1/")]).view
    take_tf(live, transforms("r1/odom", "r1/base", 1.0))
    live.tick(START_NS)
    assert live.stage.fixed_frame == "r1/odom"
    take_tf(live, transforms("odom", "base", 2.0))
    live.tick(START_NS)
    assert live.stage.fixed_frame == "r1/odom"  # the other robot's is no frame of this one
    take_tf(live, transforms("odom", "r1/odom", 2.0))
    live.tick(START_NS)
    assert live.stage.fixed_frame == "odom"
