"""The controller without ROS, on an ideal plant: diff_drive_controller's own checklist."""

import math
from collections.abc import Sequence
from typing import Any

import pytest

from onebot_control.drive.drive import Drive
from onebot_control.drive.kinematics import DriveCommand
from onebot_control.drive.speed_limiter import SpeedLimiter
from tests.onebot_control.control_support import RADIUS, SEPARATION, config, robot

REST = (0.0, 0.0)


def controller(**values: Any) -> Drive:
    """A drive with wheels 0.3 m apart, of radius 0.06 m."""
    chosen = config(wheel_separation=SEPARATION, **values)
    wheels = chosen.wheels(robot())
    return Drive(wheels, wheels.names, chosen)


def update(
    drive: Drive,
    positions: Sequence[float] = REST,
    dt: float = 0.01,
    velocities: Sequence[float] = REST,
) -> DriveCommand:
    """One cycle with these states of the wheels."""
    drive.observe(positions, velocities, dt)
    return drive.decide(dt)


def updates(drive: Drive, count: int, dt: float = 0.01) -> DriveCommand:
    """The last of several cycles at rest."""
    return [update(drive, dt=dt) for _ in range(count)][-1]


def test_timeout_brakes_through_the_limiter() -> None:
    """When commands stop, it goes on for the timeout and then slows down by the limit."""
    drive = controller(linear_x_max_acceleration=1.0, cmd_vel_timeout=0.5)
    for _ in range(100):
        drive.accept(0.2, 0.0)
        update(drive, REST, 0.01)
    speeds = [update(drive, REST, 0.01).linear for _ in range(100)]
    assert speeds[:50] == [0.2] * 50
    braking = [0.2 - 0.01 * step for step in range(1, 20)]
    assert speeds[50:69] == pytest.approx(braking)
    assert speeds[70:] == pytest.approx([0.0] * 30, abs=1e-12)


def test_time_without_cycles_counts() -> None:
    """Neither a pause nor a stall lets a command live longer; it brakes through the limiter."""
    drive = controller(linear_x_max_acceleration=10.0)
    drive.accept(0.2, 0.0)
    assert updates(drive, 5).linear == 0.2
    drive.wait(0.3)
    assert updates(drive, 15).linear == 0.2
    drive.wait(0.3)
    assert drive.timed_out
    assert updates(drive, 1).linear == pytest.approx(0.1)
    assert updates(drive, 2).linear == 0.0


def test_timeout_of_zero_keeps_a_command_for_ever() -> None:
    drive = controller(cmd_vel_timeout=0.0)
    assert drive.accept(0.2, 0.0, age=1e6) is None
    assert updates(drive, 10_000).linear == 0.2


@pytest.mark.parametrize("wrong", [math.nan, math.inf, -math.inf])
def test_a_command_that_is_not_finite_is_dropped_whole(wrong: float) -> None:
    drive = controller()
    drive.accept(0.2, 0.1)
    for _ in range(60):
        assert drive.accept(wrong, 0.0) is not None
        assert drive.accept(0.0, wrong) is not None
        command = update(drive, REST, 0.01)
        assert all(map(math.isfinite, (*command[:3], *command.wheels)))
    assert (command.linear, command.angular) == (0.0, 0.0)


@pytest.mark.parametrize("axis", ["linear", "angular"])
def test_open_loop_with_clamped_input(axis: str) -> None:
    """5 clamped to 0.5 gives a velocity of 0.5, and 0.05 after 0.1 s."""
    name = "linear_x_max_velocity" if axis == "linear" else "angular_z_max_velocity"
    drive = controller(open_loop=True, **{name: 0.5})
    drive.accept(*((5.0, 0.0) if axis == "linear" else (0.0, 5.0)))
    update(drive, REST, 0.1)
    odometry = drive.odometry
    assert getattr(odometry.twist, axis) == 0.5
    assert (odometry.x if axis == "linear" else odometry.heading) == pytest.approx(0.05)


@pytest.mark.parametrize("open_loop", [True, False])
@pytest.mark.parametrize("command", [(1.7e308, 1.7e308), (-1e300, 0.0), (0.0, -1.7e308)])
def test_what_follows_from_a_finite_command_is_finite(
    command: tuple[float, float], open_loop: bool
) -> None:
    drive = controller(open_loop=open_loop, cmd_vel_timeout=0.0)
    assert drive.accept(*command) is None
    for _ in range(1000):
        done = update(drive, REST, 0.01)
        assert all(map(math.isfinite, done.wheels))
        clamped = [math.copysign(1e6, speed) if speed else 0.0 for speed in command]
        assert [done.linear, done.angular] == clamped
    odometry = drive.odometry
    assert all(
        map(math.isfinite, (odometry.x, odometry.y, odometry.heading, odometry.twist.linear))
    )


def test_nothing_of_before_is_left_after_halt() -> None:
    """It starts as a new one does: no jerk, no speed, no command and no age are left over."""
    drive = controller(linear_x_max_jerk=10.0, angular_z_max_jerk=10.0, cmd_vel_timeout=0.5)
    drive.accept(1.0, 1.0)
    updates(drive, 60)
    assert drive.timed_out
    drive.halt()
    assert not drive.timed_out
    assert updates(drive, 1, dt=1.0)[:4] == (0.0, 0.0, 0.0, REST)
    assert not drive.timed_out
    assert updates(drive, 1, dt=0.6) and drive.timed_out
    drive.halt()
    drive.accept(1.0, 1.0)
    new = controller(linear_x_max_jerk=10.0, angular_z_max_jerk=10.0)
    new.accept(1.0, 1.0)
    for _ in range(5):
        assert update(drive, REST, 0.01) == update(new, REST, 0.01)


@pytest.mark.parametrize(("age", "cycles"), [(0.1, 5), (-0.3, 6)])
def test_a_command_is_as_old_as_it_says(age: float, cycles: int) -> None:
    """Its age replaces that of the last one; its first cycle adds nothing; one ahead is new."""
    drive = controller(cmd_vel_timeout=0.5)
    drive.accept(0.1, 0.0, age=0.4)
    updates(drive, 5)
    drive.accept(0.2, 0.0, age=age)
    speeds = [update(drive, REST, 0.1).linear for _ in range(8)]
    assert speeds == [0.2] * cycles + [0.0] * (8 - cycles)
    assert drive.timed_out


def test_a_refused_command_leaves_the_one_before() -> None:
    """Neither its speed nor its age counts; one just within the timeout is taken."""
    drive = controller(cmd_vel_timeout=0.5)
    drive.accept(0.2, 0.1)
    assert drive.accept(0.7, 0.7, age=0.5) == "0.500 s old, but cmd_vel_timeout is 0.5 s"
    assert drive.accept(0.7, 0.7, age=0.6) == "0.600 s old, but cmd_vel_timeout is 0.5 s"
    assert update(drive, REST, 0.1)[:3] == (0.2, 0.0, 0.1)
    assert drive.accept(0.7, 0.7, age=0.499) is None
    assert update(drive, REST, 0.1)[:3] == (0.7, 0.0, 0.7)


def test_configure_keeps_command_age_speed_and_pose() -> None:
    """Only the parameters change, of both axes: no jump and no second life for a command."""
    drive = controller(linear_x_max_jerk=1.0, angular_z_max_jerk=1.0, cmd_vel_timeout=0.5)
    twin = controller(linear_x_max_jerk=1.0, angular_z_max_jerk=1.0, cmd_vel_timeout=0.5)
    wheels = [(0.1 * i, 0.12 * i) for i in range(100)]
    for one in (drive, twin):
        one.accept(1.0, 1.0)
        for state in wheels[:30]:
            update(one, state)
    chosen = config(linear_x_max_jerk=1.0, angular_z_max_jerk=1.0, cmd_vel_timeout=0.5)
    drive.configure(chosen)
    for state in wheels[30:]:
        assert update(drive, state) == update(twin, state)
        assert (drive.odometry.x, drive.odometry.twist) == (twin.odometry.x, twin.odometry.twist)


@pytest.mark.parametrize("other", [{"open_loop": True}, {"position_feedback": False}])
def test_configure_changes_the_feedback_without_a_jump(other: dict[str, bool]) -> None:
    """The way since the positions were last used is in the odometry already; the twist goes on."""
    speed, dt, cycles = 2.0, 0.01, 300
    drive = controller(cmd_vel_timeout=0.0)
    drive.accept(speed * RADIUS, 0.0)
    chosen = {
        100: config(cmd_vel_timeout=0.0, **other),
        200: config(cmd_vel_timeout=0.0),
    }
    for cycle in range(cycles):
        if cycle in chosen:
            drive.configure(chosen[cycle])
        before, at = drive.odometry.x, speed * dt * cycle
        update(drive, (at, at), dt, (speed, speed))
        assert drive.odometry.x - before <= 1.001 * speed * RADIUS * dt
        assert cycle == 0 or drive.odometry.twist.linear == pytest.approx(speed * RADIUS)
    assert drive.odometry.x == pytest.approx(speed * RADIUS * dt * cycles, rel=0.01)


def test_configure_changes_limits_timeout_geometry_and_window() -> None:
    drive = controller(velocity_rolling_window_size=10, cmd_vel_timeout=0.0)
    drive.accept(1.0, 1.0)
    update(drive, (0.0, 0.0), 0.1)
    update(drive, (0.1, 0.1), 0.1)
    chosen = config(
        linear_x_max_velocity=0.5,
        angular_z_max_velocity=0.25,
        velocity_rolling_window_size=1,
        cmd_vel_timeout=0.5,
        wheel_separation_multiplier=2.0,
        left_wheel_noise=0.1,
        right_wheel_noise=0.3,
    )
    drive.configure(chosen)
    command = update(drive, (0.2, 0.4), 0.1)
    assert command[:3] == (0.5, 0.0, 0.25)
    across = 0.25 * 2.0 * SEPARATION / 2.0
    assert command.wheels == pytest.approx(((0.5 - across) / RADIUS, (0.5 + across) / RADIUS))
    assert drive.odometry.twist.linear == pytest.approx(0.2 * RADIUS / 0.1)
    assert drive.odometry.twist.angular == pytest.approx(0.2 * RADIUS / 0.1 / (2.0 * SEPARATION))
    assert drive.odometry.noise == pytest.approx((0.01, 0.09))
    assert updates(drive, 10, dt=0.1).linear == 0.0


def test_both_axes_are_limited_each_on_its_own() -> None:
    values = {"linear_x_max_jerk": 10.0, "linear_x_max_acceleration": 0.9}
    values |= {"angular_z_max_jerk": 30.0, "angular_z_max_acceleration": 2.7}
    drive, chosen = controller(**values), config(**values)
    limiters = SpeedLimiter(chosen.linear), SpeedLimiter(chosen.angular)
    last = before = [0.0, 0.0]
    for step in range(60):
        wanted = (1.0, -0.5) if step < 30 else (-1.0, 2.0)
        drive.accept(*wanted)
        axes = zip(limiters, wanted, last, before, strict=True)
        before, last = last, [limiter.limit(*speeds, 0.01) for limiter, *speeds in axes]
        assert [*update(drive, REST, 0.01)[:3:2]] == last
