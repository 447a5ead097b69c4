"""A page drives a simulated robot through DDS; and it stops, whatever happens to the page."""

import signal
from collections.abc import Iterator
from typing import Any

import pytest
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry

from tests.onebot_bringup.steering_support import PageClient, steering
from tests.onebot_control.control_support import urdf
from tests.ros_support import NodeProcess, Peer, ros_args
from tests.support import wait_for

WHEELS = {"left_wheel_names": "[left_wheel_joint]", "right_wheel_names": "[right_wheel_joint]"}
LIMITS = {"linear.x.max_velocity": 0.5}  # the others are those of control.yaml
SPEED = 0.3  # m/s


@pytest.fixture(scope="module")
def odometry(domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[list[Any]]:
    """What a robot publishes that stops by itself after half a second without a command."""
    model = tmp_path_factory.mktemp("robot") / "bot.urdf"
    model.write_text(urdf())
    args = [str(model), *ros_args(cmd_vel_timeout=0.5, **WHEELS, **LIMITS)]
    with NodeProcess("onebot_control.velocity_controller", *args), Peer(domain) as peer:
        heard = peer.hear(Odometry, "/velocity_controller/odom")
        wait_for(lambda: heard, "odometry")
        yield heard


def _speed(odometry: list[Any]) -> float:
    return float(odometry[-1].twist.twist.linear.x)


def _drive(page: PageClient, odometry: list[Any]) -> None:
    wait_for(lambda: page.state["listeners"] == 1, "the robot")
    page.hold(SPEED)
    wait_for(lambda: abs(_speed(odometry) - SPEED) < 0.01, "the robot to drive")


def _come_to_rest(odometry: list[Any]) -> None:
    wait_for(lambda: abs(_speed(odometry)) < 1e-3, "the robot to stop")


def test_stop_stops_the_robot_whoever_drives_it(odometry, domain):
    """Beside a script that drives on; also when the server dies, until a page drives again."""
    command = Twist()
    command.linear.x = SPEED
    with Peer(domain, "script") as script:
        publisher = script.publisher(Twist, "/velocity_controller/cmd_vel")
        timer = script.node.create_timer(0.05, lambda: publisher.publish(command))
        with steering(check=False) as node:
            with PageClient(node.address) as page:
                wait_for(lambda: page.state["others"] == ["/script"], "the other publisher")
                wait_for(lambda: page.state["controllers"], "the robot")
                assert page.state["limits"] == {"linear": 0.5, "angular": 3.0, "lateral": 0.0}
                braking = {"deceleration": 0.5, "jerk": None}
                assert page.state["braking"] == {"linear": braking, "lateral": None}
                wait_for(lambda: abs(_speed(odometry) - SPEED) < 0.01, "the robot to drive")
                assert not page.state["locked"]

                def locked() -> bool:
                    page.send("stop")  # as a page does while Stop is held
                    return bool(page.state["locked"])

                wait_for(locked, "the lock")
                _come_to_rest(odometry)
            node.process.send_signal(signal.SIGKILL)
        with steering() as node, PageClient(node.address) as page:
            wait_for(lambda: page.state["locked"], "the state of the lock")
            count = len(odometry)
            wait_for(lambda: len(odometry) > count + 25, "half a second at rest")
            assert all(abs(m.twist.twist.linear.x) < 1e-3 for m in odometry[count:])
            timer.cancel()
            _drive(page, odometry)
            assert not page.state["locked"]


def test_the_robot_stops_when_the_server_hangs(odometry):
    """By the controller's timeout."""
    with steering(check=False) as node, PageClient(node.address) as page:
        _drive(page, odometry)
        node.process.send_signal(signal.SIGSTOP)
        _come_to_rest(odometry)
        node.process.send_signal(signal.SIGKILL)
        wait_for(lambda: page.closed, "the end of the connection")
