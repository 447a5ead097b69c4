"""``Buffer``: the transforms received, for nodes of rclpy."""

import threading
from collections.abc import Callable
from time import sleep
from typing import Any

import rclpy
import rclpy.clock
import rclpy.logging
from geometry_msgs.msg import TransformStamped
from rclpy.clock import Clock, JumpThreshold, TimeJump
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.task import Future
from rclpy.time import Time
from tf2_py import BufferCore
from tf2_ros.buffer_interface import BufferInterface

_NO_TIMEOUT = Duration()
_POLL = 0.02  # s
_LONGEST_JUMP = Duration(seconds=3.0)  # backwards, during which waiting continues


class Buffer(BufferCore, BufferInterface):
    """Stores transforms over time, and computes the transform between two frames.

    It is cleared when its clock jumps back. Times may be rclpy's or messages; 0 is the latest.

    Args:
        cache_time: how long transforms are kept; 10 s by default.
        node: the node for the service ``tf2_frames``, which returns the frames as YAML.
    """

    def __init__(self, cache_time: Duration | None = None, node: Node | None = None) -> None:
        BufferCore.__init__(self, cache_time)
        BufferInterface.__init__(self)
        self._callbacks_lock = threading.RLock()
        self._new_data_callbacks: list[Callable[[], None]] = []
        self.clock = Clock() if node is None else node.get_clock()
        if node is not None:
            from tf2_msgs.srv import FrameGraph  # slow to import

            self.srv = node.create_service(FrameGraph, "tf2_frames", self._get_frames)
        threshold = JumpThreshold(
            min_forward=None, min_backward=Duration(seconds=-1), on_clock_change=True
        )
        self.jump_handle = self.clock.create_jump_callback(
            threshold, post_callback=self.time_jump_callback
        )

    def _get_frames(self, request: Any, response: Any) -> Any:
        response.frame_yaml = self.all_frames_as_yaml()
        return response

    def time_jump_callback(self, time_jump: TimeJump) -> None:
        """Clear the buffer, since its clock was set back."""
        logger = rclpy.logging.get_logger("tf2_buffer")
        logger.warning("Detected jump back in time. Clearing tf buffer.")
        self.clear()

    def set_transform(self, transform: TransformStamped, authority: str) -> None:
        """Add a transform at its time."""
        super().set_transform(transform, authority)
        self._call_new_data_callbacks()

    def set_transform_static(self, transform: TransformStamped, authority: str) -> None:
        """Add a transform that holds for all times."""
        super().set_transform_static(transform, authority)
        self._call_new_data_callbacks()

    # --- now ------------------------------------------------------------------------------------

    def lookup_transform(
        self, target_frame: str, source_frame: str, time: Time, timeout: Duration = _NO_TIMEOUT
    ) -> TransformStamped:
        """Return the transform from the source frame to the target frame.

        Args:
            target_frame: the frame to transform into.
            source_frame: the frame to transform from.
            time: the time of the transform.
            timeout: how long to wait for it. Waiting blocks, so another thread has to receive.

        Raises:
            TransformException: there is none.
        """
        self.can_transform(target_frame, source_frame, time, timeout)
        return self.lookup_transform_core(target_frame, source_frame, time)

    def lookup_transform_full(
        self, target_frame, target_time, source_frame, source_time, fixed_frame, timeout=_NO_TIMEOUT
    ) -> TransformStamped:
        """Return the transform between two times, through a frame that is fixed in between."""
        arguments = target_frame, target_time, source_frame, source_time, fixed_frame
        self.can_transform_full(*arguments, timeout)
        return self.lookup_transform_full_core(*arguments)

    def can_transform(
        self,
        target_frame: str,
        source_frame: str,
        time: Time,
        timeout: Duration = _NO_TIMEOUT,
        return_debug_tuple: bool = False,
    ) -> Any:
        """Return whether there is a transform, or with ``return_debug_tuple`` also why not."""
        return _await(
            lambda: self.can_transform_core(target_frame, source_frame, time),
            timeout,
            return_debug_tuple,
        )

    def can_transform_full(
        self,
        target_frame,
        target_time,
        source_frame,
        source_time,
        fixed_frame,
        timeout=_NO_TIMEOUT,
        return_debug_tuple=False,
    ) -> Any:
        """Return whether there is a transform between two times; see ``can_transform``."""
        arguments = target_frame, target_time, source_frame, source_time, fixed_frame
        return _await(lambda: self.can_transform_full_core(*arguments), timeout, return_debug_tuple)

    # --- later ----------------------------------------------------------------------------------

    async def lookup_transform_async(
        self, target_frame: str, source_frame: str, time: Time
    ) -> TransformStamped:
        """Return the transform from the source frame to the target frame, once it is known."""
        await self.wait_for_transform_async(target_frame, source_frame, time)
        return self.lookup_transform_core(target_frame, source_frame, time)

    async def lookup_transform_full_async(
        self, target_frame, target_time, source_frame, source_time, fixed_frame
    ) -> TransformStamped:
        """Return the transform between two times, once it is known."""
        arguments = target_frame, target_time, source_frame, source_time, fixed_frame
        await self.wait_for_transform_full_async(*arguments)
        return self.lookup_transform_full_core(*arguments)

    def wait_for_transform_async(self, target_frame: str, source_frame: str, time: Time) -> Future:
        """Return a future whose result is the transform, once it is known."""
        return self._future(
            lambda: self.can_transform_core(target_frame, source_frame, time),
            lambda: self.lookup_transform(target_frame, source_frame, time),
        )

    def wait_for_transform_full_async(
        self, target_frame, target_time, source_frame, source_time, fixed_frame
    ) -> Future:
        """Return a future whose result is the transform between two times, once it is known."""
        arguments = target_frame, target_time, source_frame, source_time, fixed_frame
        return self._future(
            lambda: self.can_transform_full_core(*arguments),
            lambda: self.lookup_transform_full_core(*arguments),
        )

    def _future(
        self, is_known: Callable[[], tuple[int, str]], lookup: Callable[[], TransformStamped]
    ) -> Future:
        future = Future()

        def try_now() -> None:
            try:
                if not future.done() and is_known()[0]:
                    future.set_result(lookup())
            except BaseException as error:  # it is raised where the future is awaited
                future.set_exception(error)

        with self._callbacks_lock:  # no transform may arrive in between
            try_now()
            if not future.done():
                self._new_data_callbacks.append(try_now)
                future.add_done_callback(lambda _: self._remove_callback(try_now))
        return future

    def _call_new_data_callbacks(self) -> None:
        with self._callbacks_lock:
            for callback in list(self._new_data_callbacks):
                callback()

    def _remove_callback(self, callback: Callable[[], None]) -> None:
        with self._callbacks_lock:
            if callback in self._new_data_callbacks:
                self._new_data_callbacks.remove(callback)


def _await(
    is_known: Callable[[], tuple[int, str]], timeout: Duration, return_debug_tuple: bool
) -> Any:
    """Return whether a transform is known, after waiting for it in wall-clock time."""
    result = is_known()
    if timeout != _NO_TIMEOUT:
        clock = rclpy.clock.Clock()
        start = clock.now()
        while not result[0] and start <= clock.now() + _LONGEST_JUMP:
            if clock.now() >= start + timeout:
                break
            sleep(_POLL)
            result = is_known()
    return result if return_debug_tuple else result[0]
