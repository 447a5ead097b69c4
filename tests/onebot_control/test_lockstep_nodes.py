"""Nodes in lockstep, whatever they and their tests do."""

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
import rclpy
from geometry_msgs.msg import Twist, TwistStamped
from nav_msgs.msg import Odometry
from rclpy.action import ActionClient, ActionServer
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.executors import MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from rclpy.time_source import TimeSource
from rclpy.wait_for_message import wait_for_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Int64, String
from std_srvs.srv import Trigger

from onebot_control import OneBotError, RobotSetup, Simulation
from onebot_control.nodes.lockstep import Lockstep
from onebot_description.ros.topic_qos import LATCHED
from tests.onebot_control.arm_support import ArmClient, goal, point
from tests.support import run_to_end

pytestmark = pytest.mark.usefixtures("ros_domain")

MRM = "package://mrm_description/urdf/mrm.xacro"


@pytest.fixture
def ros() -> Iterator[Lockstep[Simulation]]:
    with Simulation() as simulation, simulation.ros(callback_timeout=0.5) as ros:
        yield ros


class Ticker(Node):
    """Counts the ticks of a timer of 10 Hz, with their times."""

    def __init__(self, name: str = "ticker", tick: Callable[[], object] = lambda: None) -> None:
        super().__init__(name)
        self.ticks: list[float] = []
        self._then = tick
        self.timer = self.create_timer(0.1, self.tick)

    def tick(self) -> None:
        self.ticks.append(self.get_clock().now().nanoseconds / 1e9)
        self._then()


TENTHS = pytest.approx([0.1 * count for count in range(1, 11)])


# The promise --------------------------------------------------------------------------------------


def test_timers_start_at_once_although_clock_is_discovered_late(
    ros: Lockstep[Simulation], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The node subscribes to /clock 2 s late, so that nothing of it can be discovered before."""
    subscribe, threads = TimeSource._subscribe_to_clock_topic, list[threading.Timer]()

    def late(source: TimeSource) -> None:
        threads.append(threading.Timer(2.0, subscribe, [source]))
        threads[-1].start()

    monkeypatch.setattr(TimeSource, "_subscribe_to_clock_topic", late)
    ros.add(node := Ticker())
    ros.simulation.run(1.0)
    [thread] = threads
    thread.join()
    assert node.ticks == TENTHS


def test_nothing_is_lost_of_what_is_created_in_a_callback(ros: Lockstep[Simulation]) -> None:
    """The first message of a new publisher, latched ones, a service, and a new type of commands."""

    class Late(Ticker):
        def tick(self) -> None:
            super().tick()
            if len(self.ticks) > 1:
                return
            self.numbers, self.texts, self.joints = list[Int64](), list[String](), list[Any]()
            self.answers = list[float]()
            other.create_publisher(String, "text", LATCHED).publish(String(data="latched"))
            self.create_subscription(String, "text", self.texts.append, LATCHED)
            self.create_subscription(Int64, "number", self.numbers.append, 10)
            self.create_subscription(JointState, "joint_states", self.joints.append, 100)
            other.create_publisher(Int64, "number", 10).publish(Int64(data=1))
            client = self.create_client(Trigger, "velocity_controller/reset_odometry")
            assert client.service_is_ready()
            future = client.call_async(Trigger.Request())
            future.add_done_callback(lambda _: self.answers.append(self.ticks[-1]))
            command = TwistStamped()
            command.header.stamp = self.get_clock().now().to_msg()
            command.twist.linear.x = 0.5
            publisher = self.create_publisher(TwistStamped, "velocity_controller/cmd_vel", 10)
            assert publisher.get_subscription_count() == 1
            publisher.publish(command)

    other, node = Node("other"), Late()
    ros.add(node, other)
    ros.simulation.run(0.1)
    assert [message.data for message in node.numbers] == [1]
    assert [message.data for message in node.texts] == ["latched"]
    assert node.answers == [node.ticks[0]] and not node.joints
    ros.simulation.run(0.1)
    assert len(node.joints) == 10 and ros.simulation.robot.command.linear > 0.0


def test_nodes_run_in_the_order_in_which_they_were_added(ros: Lockstep[Simulation]) -> None:
    """Rclpy's executors keep nodes in a set: their order differs from process to process."""
    order = list[str]()
    names = [f"node{number}" for number in (5, 2, 9, 1, 7, 3, 8, 4, 6, 0)]
    nodes = [Ticker(name, lambda name=name: order.append(name)) for name in names]
    ros.add(*nodes)
    ros.simulation.run(0.2)
    assert order == names * 2


def test_rclpy_that_was_initialized_before(capfd: pytest.CaptureFixture[str]) -> None:
    """As session fixtures do: the node's time is simulated, and that it was not is logged."""
    rclpy.init()
    try:
        domain = rclpy.get_default_context().get_domain_id()
        with Simulation() as simulation:
            with pytest.raises(OneBotError, match=f"initialized in domain {domain} before ros"):
                simulation.ros((domain + 1) % 100)
            with pytest.raises(OneBotError, match="initialized before ros.*remap"):
                simulation.ros(remap={"a": "b"})
            with simulation.ros() as ros:
                ros.add(node := Ticker())
                simulation.run(1.0)
                assert node.ticks == TENTHS
        assert "use_sim_time was false" in capfd.readouterr().err
        assert rclpy.ok()
    finally:
        rclpy.shutdown()


def test_one_simulation_of_a_process_is_on_topics(ros: Lockstep[Simulation]) -> None:
    with Simulation() as other:
        with pytest.raises(OneBotError, match="another simulation in this process"):
            other.ros()
        ros.close()
        with other.ros() as ros:
            ros.add(node := Ticker())
            other.run(1.0)
            assert node.ticks == TENTHS


def test_another_executor_is_refused(ros: Lockstep[Simulation]) -> None:
    ros.add(node := Ticker())
    for spin in (
        lambda: rclpy.spin_once(node, timeout_sec=0.0),
        lambda: SingleThreadedExecutor().add_node(node),
        lambda: MultiThreadedExecutor(2).add_node(node),
        lambda: EventsExecutor().add_node(node),
    ):
        with pytest.raises(OneBotError, match='"ticker" is in lockstep.*Executor'):
            spin()
    ros.simulation.run(1.0)
    assert node.ticks == TENTHS


def test_a_node_of_another_executor_is_refused(
    ros: Lockstep[Simulation], capfd: pytest.CaptureFixture[str]
) -> None:
    node, executor = Ticker(), MultiThreadedExecutor(2)
    executor.add_node(node)
    assert '"ticker" runs in a separate MultiThreadedExecutor' in capfd.readouterr().err
    with pytest.raises(OneBotError, match='"ticker" runs in a separate MultiThreadedExecutor'):
        ros.add(node)
    executor.remove_node(node)
    ros.add(node)


def test_a_timer_on_wall_time_is_warned_of(
    ros: Lockstep[Simulation], capfd: pytest.CaptureFixture[str]
) -> None:
    """Also if it is created in a callback; one on simulated time is not."""
    kinds = [ClockType.STEADY_TIME, ClockType.SYSTEM_TIME]

    def make() -> None:
        if kinds:
            node.create_timer(7.0, node.tick, clock=Clock(clock_type=kinds.pop()))

    ros.add(node := Ticker(tick=make))
    assert "wall" not in capfd.readouterr().err
    ros.simulation.run(1.0)
    log = capfd.readouterr().err
    assert log.count("[ticker]: a timer of 7 s, Ticker.tick (") == log.count("is on wall time") == 2


def blocked_by_sleep(_: Node) -> None:
    time.sleep(60.0)


def blocked_by_waiting(_: Node) -> None:
    threading.Event().wait()


def blocked_by_a_call(node: Node) -> None:
    client = node.create_client(Trigger, "velocity_controller/reset_odometry")
    client.call(Trigger.Request())


def blocked_by_spinning(_: Node) -> None:
    rclpy.spin_once(Node("helper"))


def blocked_by_waiting_for_a_message(node: Node) -> None:
    wait_for_message(String, node, "nothing")


def blocked_although_it_catches(_: Node) -> None:
    while True:
        with suppress(Exception):
            time.sleep(60.0)


BLOCKS = (
    *(blocked_by_sleep, blocked_by_waiting, blocked_by_a_call, blocked_by_spinning),
    *(blocked_by_waiting_for_a_message, blocked_although_it_catches),
)


def test_a_callback_that_blocks_is_an_error(ros: Lockstep[Simulation]) -> None:
    class Blocked(Ticker):
        def tick(self) -> None:
            self._then(self)

    expected = r'node "ticker": .*Blocked\.tick has not returned in 0\.5 s.*test_lockstep_nodes\.py'
    if sys.version_info < (3, 11):
        expected = expected.replace(r".*Blocked\.", "")
    for block in BLOCKS:
        node = Blocked(block.__name__, block)
        with pytest.raises(OneBotError, match=expected.replace("ticker", block.__name__)):
            ros.add(node)  # a timer of a time that has passed is called at once
            ros.simulation.run(1.0)
        node.timer.cancel()
        ros.simulation.run(0.05)
        node.destroy_node()


def test_a_callback_in_a_debugger_may_take_any_time(ros: Lockstep[Simulation]) -> None:
    ros.add(node := Ticker(tick=lambda: time.sleep(1.0)))
    traced = sys.gettrace()
    sys.settrace(lambda *_: None)
    try:
        ros.simulation.run(0.2)
    finally:
        sys.settrace(traced)
    assert len(node.ticks) == 2


def test_nothing_sleeps_on_simulated_time_where_it_passes(ros: Lockstep[Simulation]) -> None:
    """It would sleep for ever, and no signal would end that."""

    def sleep() -> None:
        node.get_clock().sleep_for(Duration(seconds=0.1))

    ros.add(node := Ticker(tick=sleep))
    with pytest.raises(OneBotError, match="time only passes in Simulation.run"):
        sleep()
    with pytest.raises(OneBotError, match=r'node "ticker": .*tick sleeps on simulated time \('):
        ros.simulation.run(1.0)


@pytest.mark.parametrize("spins", [False, True], ids=["sleeps", "spins"])
def test_an_action_that_blocks_is_an_error(
    ros_simulation: Callable[..., Lockstep[Simulation]], spins: bool
) -> None:
    """Although rclpy catches what an action raises, and aborts its goal."""
    ros = ros_simulation(MRM, callback_timeout=0.5)

    def execute(_: Any) -> Any:
        while True:
            if spins:
                rclpy.spin_once(server)
            time.sleep(0.01)

    client, server = ArmClient(), Node("server")
    ActionServer(server, client.action._action_type, "slow", execute)
    slow = ActionClient(client, client.action._action_type, "slow")
    ros.add(client, server)
    slow.send_goal_async(goal(point(1.0, 0.3)))
    text = 'node "server" is in lockstep' if spins else r'node "server": .*execute has not returned'
    with pytest.raises(OneBotError, match=text):
        ros.simulation.run(1.0)


# The life of a node -------------------------------------------------------------------------------


def test_a_node_that_is_destroyed_or_removed(ros: Lockstep[Simulation]) -> None:
    destroyed, removed, itself, stays = map(Ticker, ("destroyed", "removed", "itself", "stays"))
    itself._then = itself.destroy_node
    ros.add(destroyed, removed, itself, stays)
    ros.simulation.run(0.5)
    destroyed.destroy_node()
    ros.remove(removed)
    ros.simulation.run(0.5)
    nodes = destroyed, removed, itself, stays
    assert [len(node.ticks) for node in nodes] == [5, 5, 1, 10]
    with pytest.raises(OneBotError, match='"removed" is not in lockstep'):
        ros.remove(removed)
    with pytest.raises(OneBotError, match="destroyed"):
        ros.add(destroyed)
    rclpy.spin_once(removed, timeout_sec=0.0)
    ros.add(removed)
    ros.simulation.run(0.5)
    assert removed.ticks[5] == pytest.approx(1.0) and removed.ticks[-1] == pytest.approx(1.5)


@pytest.mark.parametrize(
    "shut_down",
    [rclpy.shutdown, lambda: threading.Timer(0.001, rclpy.try_shutdown).start()],
    ids=["at once", "by a thread"],
)
def test_shutdown_in_a_callback(
    ros: Lockstep[Simulation], capfd: pytest.CaptureFixture[str], shut_down: Callable[[], None]
) -> None:
    """The nodes end, and the simulation continues."""
    ros.add(node := Ticker(tick=shut_down))
    ros.simulation.robot.drive(0.5)
    for _ in range(100):
        ros.simulation.run(1.0)
        if not rclpy.ok():
            break
    ros.simulation.run(1.0)
    assert len(node.ticks) == 1 or shut_down is not rclpy.shutdown
    assert ros.simulation.robot.pose.x > 0.1
    assert capfd.readouterr().err.count("rclpy was shut down: the simulation continues") == 1
    with pytest.raises(OneBotError, match="context"):
        ros.add(node)


def test_an_exception_in_a_timer(ros: Lockstep[Simulation]) -> None:
    """It is raised by run, after a whole cycle; the next run goes on."""

    def fail() -> None:
        if len(node.ticks) == 3:
            raise ZeroDivisionError

    ros.add(node := Ticker(tick=fail))
    with pytest.raises(ZeroDivisionError):
        ros.simulation.run(1.0)
    assert ros.simulation.time == pytest.approx(0.3)
    ros.simulation.run(0.7)
    assert node.ticks == TENTHS


def test_after_close_each_method_says_so(ros: Lockstep[Simulation]) -> None:
    ros.close()
    for call in (ros.add, lambda: ros.add(None), lambda: ros.remove(None)):
        with pytest.raises(OneBotError, match=r"have been closed; call simulation\.ros\(\) again"):
            call()
    ros.close()


def test_what_is_no_node_is_refused() -> None:
    with Simulation() as simulation:
        ros = simulation.ros()
        for thing in (None, Node, "node"):
            with pytest.raises(OneBotError, match="add needs nodes, such as"):
                ros.add(thing)
            with pytest.raises(OneBotError, match="is not in lockstep"):
                ros.remove(thing)
        ros.add(node := Ticker())
        simulation.run(1.0)
        assert node.ticks == TENTHS
    assert not rclpy.ok()


WRONG: list[tuple[dict[str, Any], str]] = [
    ({"domain_id": 300}, "domain_id: 300 is above 232; write a number from 0 to 232"),
    ({"domain_id": -1}, "domain_id"),
    ({"domain_id": "1"}, "domain_id"),
    ({"domain_id": True}, "domain_id"),
    ({"remap": ["cmd_vel"]}, "remap: .* write a dict"),
    ({"remap": {"cmd vel": "a"}}, 'remap: "cmd vel" is not valid; write a topic name'),
    ({"remap": {"a": 1}}, "remap.a: 1 is a number"),
    ({"nav2_topics": 1}, "nav2_topics: 1 is a number; write True or False"),
    ({"callback_timeout": 0.0}, "callback_timeout"),
    ({"callback_timeout": "1"}, "callback_timeout"),
]


def test_bad_arguments_of_ros(monkeypatch: pytest.MonkeyPatch) -> None:
    """So is the domain of the environment; afterwards it starts nevertheless."""
    with Simulation() as simulation:
        for arguments, text in WRONG:
            with pytest.raises(OneBotError, match=text):
                simulation.ros(**arguments)
            assert not rclpy.ok()
        with monkeypatch.context() as patch, pytest.raises(OneBotError, match="ROS_DOMAIN_ID.*300"):
            patch.setenv("ROS_DOMAIN_ID", "300")
            simulation.ros()
        simulation.ros().close()


INTERRUPTED = """
import os, signal, pytest, rclpy
from rclpy.node import Node

@pytest.mark.parametrize("early", [False, True])
def test_interrupted(ros_simulation, early):
    if early:
        rclpy.init()
    ros = ros_simulation()
    node = Node("node")
    node.create_timer(0.1, lambda: os.kill(os.getpid(), signal.SIGINT))
    ros.add(node)
    with pytest.raises(KeyboardInterrupt):
        for _ in range(1000):
            ros.simulation.run(1.0)
    ros.close()
    ros.simulation.run(1.0)
    rclpy.try_shutdown()

def test_interrupts_pytest(ros_simulation):
    ros = ros_simulation()
    node = Node("node")
    node.create_timer(0.1, lambda: os.kill(os.getpid(), signal.SIGINT))
    ros.add(node)
    ros.simulation.run(1.0)
"""


def test_ctrl_c_is_a_keyboard_interrupt(tmp_path: Path) -> None:
    """Also if rclpy, which the user has initialized, handles the signal."""
    (tmp_path / "test_interrupted.py").write_text(INTERRUPTED)
    plugin = ("-p", "onebot_bringup.testing.plugin", "-p", "no:cacheprovider")
    done = run_to_end([sys.executable, "-m", "pytest", *plugin], cwd=tmp_path)
    output = done.stdout + done.stderr
    assert "2 passed" in output and "KeyboardInterrupt" in output and "RCLError" not in output
    assert done.returncode == 2 and "Traceback" not in output, output


# What others' nodes need --------------------------------------------------------------------------


class Follower(Node):
    """Publishes cmd_vel and reads odom, as most nodes do."""

    def __init__(self) -> None:
        super().__init__("follower")
        self.odometry: list[Odometry] = []
        self.commands = self.create_publisher(Twist, "cmd_vel", 10)
        self.create_subscription(Odometry, "odom", self.odometry.append, 10)
        self.create_timer(0.1, self.drive)

    def drive(self) -> None:
        command = Twist()
        command.linear.x = 0.3
        self.commands.publish(command)


@pytest.mark.parametrize(
    "arguments",
    [
        {"nav2_topics": True},
        {"remap": {name: f"velocity_controller/{name}" for name in ("cmd_vel", "odom")}},
        {"remap": {f"velocity_controller/{name}": name for name in ("cmd_vel", "odom")}},
    ],
    ids=["nav2_topics", "of the node", "of the robot"],
)
def test_topics_are_renamed(
    ros_simulation: Callable[..., Lockstep[Simulation]],
    arguments: dict[str, Any],
    capfd: pytest.CaptureFixture[str],
) -> None:
    ros = ros_simulation(**arguments)
    ros.add(node := Follower())
    ros.simulation.run(2.0)
    assert len(node.odometry) == 100 and ros.simulation.robot.pose.x > 0.2
    assert "nobody" not in capfd.readouterr().err


def test_nav2_topics_are_in_the_robots_namespaces(
    ros_simulation: Callable[..., Lockstep[Simulation]],
) -> None:
    setups = {"one": RobotSetup(), "two": RobotSetup(y=2.0)}
    ros = ros_simulation(robots=setups, nav2_topics=True)
    node = Node("driver")
    publisher = node.create_publisher(Twist, "two/cmd_vel", 10)
    ros.add(node)
    command = Twist()
    command.linear.x = 0.5
    publisher.publish(command)
    ros.simulation.run(0.3)
    one, two = ros.simulation.robots.values()
    assert two.pose.x > 0.01 > one.pose.x


def test_topics_without_another_end_are_warned_of(
    ros: Lockstep[Simulation], capfd: pytest.CaptureFixture[str]
) -> None:
    ros.add(Follower())
    log = capfd.readouterr().err
    assert 'no node subscribes to /cmd_vel (did you mean "/velocity_controller/cmd_vel"?' in log
    assert 'no node publishes /odom (did you mean "/velocity_controller/odom"?' in log
    assert log.count("no node") == 2
