"""Other processes in step with velocity_controller, by the services of simulation_interfaces."""

import random
import time
from pathlib import Path
from typing import Any

import pytest
from geometry_msgs.msg import Twist, TwistStamped
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import LaserScan
from std_srvs.srv import SetBool, Trigger

from onebot_description.ros.wire.interfaces import load_interface
from tests.onebot_control.node_support import MODULE, NODE
from tests.ros_support import NodeProcess, Peer, ros_args
from tests.support import wait_for

STEP, RESET, SET_STATE, GET_STATE, FEATURES = (
    load_interface(f"simulation_interfaces/srv/{name}")
    for name in (
        "StepSimulation",
        "ResetSimulation",
        "SetSimulationState",
        "GetSimulationState",
        "GetSimulatorFeatures",
    )
)
STATE = load_interface("simulation_interfaces/msg/SimulationState")
RESULT = load_interface("simulation_interfaces/msg/Result")
ROBOT = "package://onebot_description/urdf/onebot.urdf.xacro"
BLOCK = """
<robot name="sensors">
  <gazebo reference="base_link"><sensor name="lidar" type="gpu_lidar">
    <update_rate>10</update_rate><topic>scan</topic><pose>0 0 0.1 0 0 0</pose>
    <lidar><scan><horizontal><samples>180</samples>
      <min_angle>-3.14</min_angle><max_angle>3.14</max_angle></horizontal></scan>
      <range><min>0.25</min><max>8.0</max></range>
      <noise><type>gaussian</type><stddev>0.01</stddev></noise></lidar>
  </sensor></gazebo>
</robot>
"""


@pytest.fixture
def sensors(tmp_path: Path) -> str:
    path = tmp_path / "sensors.urdf"
    path.write_text(BLOCK)
    return str(path)


def paused(*arguments: str, **parameters: Any) -> NodeProcess:
    parameters = {"use_sim_time": True, "paused": True, **parameters}
    return NodeProcess(MODULE, ROBOT, *arguments, *ros_args(**parameters))


def step(peer: Peer, steps: int) -> Any:
    return call(peer, STEP, "/step_simulation", steps=steps)


def call(peer: Peer, kind: Any, name: str, **request: Any) -> Any:
    """Call once, however long it takes."""
    client = peer.node.create_client(kind, name)
    assert client.wait_for_service(60.0), name
    future = client.call_async(kind.Request(**request))
    return wait_for(lambda: future.done() and future.result(), f"the answer of {name}")


def ok(answer: Any) -> bool:
    assert answer.result.result == RESULT.RESULT_OK, answer
    return True


def test_states_of_the_simulation(peer: Peer) -> None:
    """It starts before its first cycle, and moves by steps."""
    clocks = peer.hear(Clock, "/clock", 1000)

    def set_state(state: int) -> Any:
        return call(peer, SET_STATE, "/set_simulation_state", state=STATE(state=state))

    def state() -> int:
        return int(call(peer, GET_STATE, "/get_simulation_state").state.state)

    with paused():
        assert state() == STATE.STATE_PAUSED
        again = set_state(STATE.STATE_PAUSED)
        assert again.result.result == again.ALREADY_IN_TARGET_STATE
        wait_for(lambda: peer.node.count_publishers("/clock"), "the clock")
        assert ok(step(peer, 41)) and peer.call(Trigger, f"{NODE}/step").success
        wait_for(lambda: len(clocks) >= 42, "42 cycles")
        times = [clock.clock.sec * 10**9 + clock.clock.nanosec for clock in clocks]
        assert times == [10_000_000 * (count + 1) for count in range(42)]
        assert ok(set_state(STATE.STATE_PLAYING)) and state() == STATE.STATE_PLAYING
        wait_for(lambda: len(clocks) > 50, "time to pass")
        refused = step(peer, 1)
        assert refused.result.result == RESULT.RESULT_OPERATION_FAILED
        assert "pause it first" in refused.result.error_message
        assert ok(set_state(STATE.STATE_STOPPED)) and state() == STATE.STATE_STOPPED
        count = len(wait_for(lambda: clocks[-1:] == settled(clocks) and clocks, "silence"))
        assert peer.call(Trigger, f"{NODE}/step").success and state() == STATE.STATE_PAUSED
        first = wait_for(lambda: len(clocks) > count and clocks[-1], "the first cycle")
        assert (first.clock.sec, first.clock.nanosec) == (0, 10_000_000)
        assert peer.call(SetBool, f"{NODE}/pause", data=False).success
        assert state() == STATE.STATE_PLAYING
        unknown = set_state(3)
        assert unknown.result.result == RESULT.RESULT_FEATURE_UNSUPPORTED
        assert "state 3 is not supported" in unknown.result.error_message
        features = call(peer, FEATURES, "/get_simulator_features").features
        assert list(features.features) == [20, 21, 22, 24, 25, 26, 31, 32]


def settled(messages: list[Any]) -> list[Any]:
    count = len(messages)
    time.sleep(0.2)
    return messages[-1:] if len(messages) == count else []


def test_what_follows_a_reset_is_as_after_the_start(peer: Peer, sensors: str) -> None:
    """Bit by bit: joints, odometry, and the noise of the scans; with no wish of the second."""
    scans = peer.hear(LaserScan, "/scan", 1000)
    odoms = peer.hear(Odometry, f"{NODE}/odom", 1000)
    topics = {"step_topics": "[scan]", "sensors": sensors, "world": "maze", "cmd_vel_timeout": 9.0}
    answerer = Answerer(peer)
    with paused(x=1.0, y=0.8, **topics):
        runs = []
        for _ in range(2):
            assert ok(step(peer, 100))
            wait_for(lambda: len(scans) >= 10 and len(odoms) >= 50, "a second of messages")
            runs.append(([bytes(scan.ranges) for scan in scans], list(map(pose_of, odoms))))
            refused = call(peer, RESET, "/reset_simulation", scope=1)
            assert refused.result.result == RESULT.RESULT_FEATURE_UNSUPPORTED
            scans.clear()
            odoms.clear()
            answerer.restart()
            assert ok(call(peer, RESET, "/reset_simulation", scope=0))
        assert runs[0] == runs[1] and len(set(runs[0][0])) == 10
        assert ok(call(peer, RESET, "/reset_simulation", scope=2))


def pose_of(odometry: Odometry) -> tuple[float, ...]:
    position, turn = odometry.pose.pose.position, odometry.pose.pose.orientation
    return position.x, position.y, turn.z, turn.w


class Answerer:
    """Answers each scan with a command, after a while that differs."""

    def __init__(self, peer: Peer, slowest: float = 0.02) -> None:
        self.dice, self._slowest = random.Random(), slowest
        self._commands = peer.node.create_publisher(TwistStamped, f"{NODE}/cmd_vel", 10)
        self.restart()
        peer.node.create_subscription(LaserScan, "/scan", self._on_scan, 10)

    def restart(self) -> None:
        self._turn = 0.3

    def _on_scan(self, scan: LaserScan) -> None:
        time.sleep(self.dice.uniform(0.0, self._slowest))
        command = TwistStamped()
        command.header.stamp = scan.header.stamp
        command.twist.linear.x = 0.1 * min(scan.ranges[90:92])
        command.twist.angular.z = self._turn = 0.9 * self._turn
        self._commands.publish(command)


def test_a_command_that_does_not_come_is_named(peer: Peer, sensors: str) -> None:
    """With its topic and stamp; a Twist has none."""
    topics = {"step_topics": "[scan]", "sensors": sensors, "step_timeout": 0.5}
    with paused(**topics):
        unheard = step(peer, 5)
        assert unheard.result.result == RESULT.RESULT_OPERATION_FAILED
        assert unheard.result.error_message == (
            "no node subscribed to /scan within 0.5 s (step_timeout)"
        )
        scans = peer.hear(LaserScan, "/scan", 10)
        twists = peer.publisher(Twist, f"{NODE}/cmd_vel")
        silent = step(peer, 5)
        wait_for(lambda: scans, "the scan")
        twists.publish(Twist())
        assert silent.result.error_message == (
            "no command with the stamp 0.010 s or a later one arrived on "
            f"{NODE}/cmd_vel within 0.5 s (step_timeout)"
        )
        peer.set_parameters(NODE, step_topics=["/scann"])
        unknown = step(peer, 1)
        assert 'step_topics: "/scann" is not the topic of a sensor' in unknown.result.error_message
        peer.set_parameters(NODE, step_topics=[])
        assert ok(step(peer, 1))


def test_a_long_step_ends_with_the_node(peer: Peer) -> None:
    clocks = peer.hear(Clock, "/clock", 10)
    with paused() as process:
        client = peer.node.create_client(STEP, "/step_simulation")
        assert client.wait_for_service(60.0)
        client.call_async(STEP.Request(steps=2**63))
        wait_for(lambda: len(clocks) > 10, "steps")
        begin = time.monotonic()
        assert process.interrupt() == 0
        assert time.monotonic() - begin < 5.0
