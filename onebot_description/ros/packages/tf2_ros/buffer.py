"""``Buffer``: the transforms received, for nodes of rclpy."""

import threading
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import rclpy.logging
from geometry_msgs.msg import TransformStamped
from rclpy.clock import Clock, JumpThreshold, TimeJump
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.task import Future
from tf2_py import BufferCore
from tf2_ros.buffer_interface import NO_TIMEOUT, BufferInterface

_POLL = 0.02  # s


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
        self._waiting_lock = threading.RLock()
        self._waiting: list[Callable[[], bool]] = []  # checks of awaited transforms; true: done
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

    def _set(self, transform: TransformStamped, authority: str, static: bool) -> None:
        super()._set(transform, authority, static)
        with self._waiting_lock:
            waiting, self._waiting = self._waiting, []
            self._waiting += [is_done for is_done in waiting if not is_done()]

    # --- now ------------------------------------------------------------------------------------

    def lookup_transform(
        self, target_frame, source_frame, time, timeout=NO_TIMEOUT
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
        self, target_frame, target_time, source_frame, source_time, fixed_frame, timeout=NO_TIMEOUT
    ) -> TransformStamped:
        """Return the transform between two times, through a frame that is fixed in between."""
        arguments = target_frame, target_time, source_frame, source_time, fixed_frame
        self.can_transform_full(*arguments, timeout)
        return self.lookup_transform_full_core(*arguments)

    def can_transform(
        self, target_frame, source_frame, time, timeout=NO_TIMEOUT, return_debug_tuple=False
    ) -> Any:
        """Return whether there is a transform, or with ``return_debug_tuple`` also why not."""
        is_known = partial(self.can_transform_core, target_frame, source_frame, time)
        return _await(is_known, timeout, return_debug_tuple)

    def can_transform_full(
        self,
        target_frame,
        target_time,
        source_frame,
        source_time,
        fixed_frame,
        timeout=NO_TIMEOUT,
        return_debug_tuple=False,
    ) -> Any:
        """Return whether there is a transform between two times; see ``can_transform``."""
        arguments = target_frame, target_time, source_frame, source_time, fixed_frame
        is_known = partial(self.can_transform_full_core, *arguments)
        return _await(is_known, timeout, return_debug_tuple)

    # --- later ----------------------------------------------------------------------------------

    async def lookup_transform_async(self, *args: Any, **kwargs: Any) -> TransformStamped:
        """Return the transform from the source frame to the target frame, once it is known."""
        return await self.wait_for_transform_async(*args, **kwargs)

    async def lookup_transform_full_async(self, *args: Any, **kwargs: Any) -> TransformStamped:
        """Return the transform between two times, once it is known."""
        return await self.wait_for_transform_full_async(*args, **kwargs)

    def wait_for_transform_async(self, *args: Any, **kwargs: Any) -> Future:
        """Return a future whose result is the transform, once it is known.

        The arguments are those of lookup_transform, without the timeout.
        """
        is_known = partial(self.can_transform_core, *args, **kwargs)
        return self._future(is_known, partial(self.lookup_transform_core, *args, **kwargs))

    def wait_for_transform_full_async(self, *args: Any, **kwargs: Any) -> Future:
        """Return a future whose result is the transform between two times, once it is known."""
        is_known = partial(self.can_transform_full_core, *args, **kwargs)
        return self._future(is_known, partial(self.lookup_transform_full_core, *args, **kwargs))

    def _future(self, is_known: Callable[[], tuple[int, str]], lookup: Callable[[], Any]) -> Future:
        future = Future()

        def is_done() -> bool:
            try:
                if not future.done() and is_known()[0]:
                    future.set_result(lookup())
            except BaseException as error:  # it is raised where the future is awaited
                future.set_exception(error)
            return bool(future.done())

        with self._waiting_lock:  # no transform may arrive in between
            if not is_done():
                self._waiting.append(is_done)
        return future


def _await(
    is_known: Callable[[], tuple[int, str]], timeout: Duration, return_debug_tuple: bool
) -> Any:
    """Return whether a transform is known, after waiting for it in wall-clock time."""
    result, end = is_known(), time.monotonic() + timeout.nanoseconds / 1e9
    while not result[0] and time.monotonic() < end:
        time.sleep(_POLL)
        result = is_known()
    return result if return_debug_tuple else result[0]
