"""The conditions of a step of a paused simulation: commands in response to measurements."""

from collections.abc import Sequence, Set

from rclpy.node import Node

from onebot_control.nodes.commands import CommandGate
from onebot_control.nodes.robot_sensors import RobotSensors
from onebot_control.runtime.control_loop import LoopSlot
from onebot_description.errors import OneBotError
from onebot_description.timing import NS_PER_S


class StepTopics:
    """The topics of a robot's parameter step_topics; commands must respond to their messages."""

    def __init__(
        self, node: Node, slot: LoopSlot, sensors: RobotSensors, commands: CommandGate
    ) -> None:
        """Wait for nothing; call ``choose`` afterwards.

        Args:
            node: node of the robot.
            slot: slot of the robot.
            sensors: the publishers of the topics.
            commands: the commands in response to their messages.
        """
        self._node, self._slot, self._sensors, self._commands = node, slot, sensors, commands
        self._topics: frozenset[str] = frozenset()
        self._asked = 0  # stamp of the latest message that needs a response, ns

    def choose(self, topics: Sequence[str]) -> None:
        """Wait for responses to these ``topics`` from now on."""
        self._topics, self._asked = frozenset(map(self._node.resolve_topic_name, topics)), 0

    def restart(self) -> None:
        """Forget messages and responses, as time restarts."""
        self._asked = self._slot.answered = 0

    def measured(self, topics: Set[str], stamp: int) -> None:
        """Record that messages with ``stamp``, ns, are published on ``topics``."""
        if not self._topics.isdisjoint(topics):
            self._asked = stamp

    def missing(self) -> str:
        """Return what a step must wait for, as the start of a sentence; "" for nothing.

        Raises:
            OneBotError: step_topics contains a topic that no sensor publishes.
        """
        for topic in sorted(self._topics):
            if not (publisher := self._sensors.publisher(topic)):
                raise OneBotError(f'step_topics: "{topic}" is not the topic of a sensor')
            if not publisher.get_subscription_count():
                return f"no node subscribed to {topic}"
        commands = self._commands.subscription
        if commands is None:
            return ""
        cmd_vel = self._node.resolve_topic_name(self._commands.topic)
        if self._topics and not commands.connected:
            return f"no node offered commands on {cmd_vel}"
        if self._asked <= self._slot.answered:
            return ""
        stamp = f"{self._asked / NS_PER_S:.3f} s"
        return f"no command with the stamp {stamp} or a later one arrived on {cmd_vel}"
