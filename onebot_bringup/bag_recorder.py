#!/usr/bin/env python3
"""Records topics as ``ros2 bag record`` does: a rosbag2 in MCAP that survives being killed.

The folder is complete about once a second: whatever ends the recorder, all but the last second can
be read, by ``ros2 bag info`` and ``play`` (Jazzy or newer), Foxglove and ``onebot replay``.

Subscribes:
    /tf, /tf_static, joint_states, robot_description, velocity_controller/odom: from the start.
    every other topic that turns up, but hidden ones, /rosout and /parameter_events; its QoS is
        adapted to what its publishers offer.

Parameters:
    folder (string): the recording, a new folder; required.
    topics (string[], []): record only these, absolute or relative names.
    compression (string, "zstd"): of the messages; or none.
    use_sim_time (bool, false): stamp the messages with simulated time.
"""

import sys
import time
from pathlib import Path

from rcl_interfaces.msg import ParameterDescriptor
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.parameter import Parameter

from onebot_bringup.bag.writer import BagWriter
from onebot_bringup.bag_topics import BagTopics
from onebot_description.errors import OneBotError
from onebot_description.ros import run_node
from onebot_description.text import did_you_mean

COMPRESSIONS = ("zstd", "none")
_LOOK_EVERY = 0.2  # seconds
_WRITE_EVERY = 1.0  # seconds, and rarer where writing takes long:
_LEAST_IDLE = 50.0  # of the time at least 49/50 are left for listening


class BagRecorder(Node):
    """The node; see the module's docstring."""

    def __init__(self) -> None:
        """Make the recording and start to listen.

        Raises:
            OneBotError: a parameter is wrong, or the folder cannot be made.
        """
        super().__init__("bag_recorder")
        self._bag: BagWriter | None = None
        for name, default, descriptor in (
            ("folder", "", ParameterDescriptor(description="the recording, a new folder")),
            # No default: rclpy takes an empty list for one of bytes.
            ("topics", Parameter.Type.STRING_ARRAY, ParameterDescriptor(description="if not all")),
            ("compression", "zstd", ParameterDescriptor(description="zstd or none")),
        ):
            descriptor.read_only = True
            self.declare_parameter(name, default, descriptor)
        self._bag = BagWriter(self._folder(), compress=self._compression() == "zstd")
        wanted = self.get_parameter_or("topics", Parameter("topics")).value or []
        self._topics = BagTopics(self, self._bag, wanted)
        self._next_write = 0.0
        # Not ROS time: it may stand still or run fast.
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(_LOOK_EVERY, self._topics.watch, clock=steady)
        self.create_timer(_WRITE_EVERY, self._write, clock=steady)
        self._topics.watch()
        self.get_logger().info(f"recording to {self._bag.folder}")

    def _folder(self) -> Path:
        text = str(self.get_parameter("folder").value)
        if not text:
            raise OneBotError("folder: say where to record to, as in -p folder:=run1")
        return Path(text).expanduser().absolute()

    def _compression(self) -> str:
        text = str(self.get_parameter("compression").value)
        if text not in COMPRESSIONS:
            known = did_you_mean(text, COMPRESSIONS, "choices")
            raise OneBotError(f"compression:={text}: there is no such compression{known}")
        return text

    def _write(self) -> None:
        assert self._bag is not None
        start = time.monotonic()
        if start >= self._next_write:
            self._bag.checkpoint()
            now = time.monotonic()
            self._next_write = now + _LEAST_IDLE * (now - start) - _WRITE_EVERY

    def destroy_node(self) -> None:
        """Write what is left, say how much it was, and end the node."""
        if self._bag is not None:
            self._finish(self._bag)
            self._bag = None
        super().destroy_node()

    def _finish(self, bag: BagWriter) -> None:
        if not bag.open:
            return  # it failed, and that was said
        try:
            bag.close()
        except OneBotError as error:
            self.get_logger().error(str(error))
            return
        said = f"recorded {bag.message_count} messages of {bag.topic_count} topics"
        self.get_logger().info(f"{said} to {bag.folder}")


def main(args: list[str] | None = None) -> int:
    """Run the node until Ctrl-C."""
    return run_node(BagRecorder, args, events=True)


if __name__ == "__main__":
    sys.exit(main())
