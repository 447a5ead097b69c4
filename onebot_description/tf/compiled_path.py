"""The usual JointState in one compiled call: see _state_converter.c.

It handles messages whose layout it was told of, with moderate positions and a stamp, while the
clock goes forward. All others take the long way in Python, to the same result.
"""

import ctypes
from collections.abc import Callable

from onebot_description.tf import kernel
from onebot_description.tf.layouts import Layout
from onebot_description.tf.published_times import PublishedTimes

ConvertBytes = Callable[[bytes, int], bytes | None]

_KNOWN = 8  # as in _state_converter.c


class _Layout(ctypes.Structure):
    """struct layout in _state_converter.c."""

    _fields_ = (
        ("block", ctypes.c_char_p),
        ("mask", ctypes.c_void_p),
        ("size", ctypes.c_uint64),
        ("first", ctypes.c_uint64),
        ("positions", ctypes.c_uint64),
        ("joints", ctypes.c_void_p),
        ("count", ctypes.c_uint64),
        ("rows", ctypes.c_void_p),
        ("message", ctypes.c_void_p),
        ("message_size", ctypes.c_uint64),
    )


class _State(ctypes.Structure):
    """struct state in _state_converter.c."""

    _fields_ = (
        ("interval", ctypes.c_int64),
        ("ignore_timestamp", ctypes.c_int64),
        ("newest_call", ctypes.c_void_p),
        ("times", ctypes.c_void_p),
        ("known", ctypes.c_uint64),
        ("recent", ctypes.c_uint64),
        ("layouts", _Layout * _KNOWN),
    )


class CompiledPath:
    """Makes the builtin and tells it of layouts; holds the memory that it works on."""

    def __init__(self, library: ctypes.PyDLL, times: PublishedTimes) -> None:
        """Know no layout yet; ``times`` are shared with the long way."""
        self._library, self._times = library, times
        self._state = _State(
            times.interval_ns,
            times.ignore_timestamp,
            times.newest_call.ctypes.data,
            times.stamps.ctypes.data,
        )
        self._layouts: list[Layout] = []
        self._next = 0

    def bind(self, long_way: ConvertBytes) -> ConvertBytes:
        """Return the builtin, which calls ``long_way`` for what it does not handle."""
        address = ctypes.addressof(self._state)
        convert: ConvertBytes = self._library.onebot_state_converter((address, long_way, self))
        return convert

    def learn(self, layout: Layout) -> None:
        """Handle messages of this layout from now on; the oldest of too many is forgotten.

        Args:
            layout: moves joints, and finitely if positions are moderate.
        """
        writer, template = layout.plan.kernel, layout.plan.template
        if writer is None or any(known is layout for known in self._layouts):
            return
        place = self._next % _KNOWN
        self._next += 1
        # The place is written before the layout whose memory it held may go.
        self._state.layouts[place] = _Layout(
            layout.block,
            layout.mask.ctypes.data,
            len(layout.block),
            layout.first,
            len(layout.names),
            *writer.joints,
            layout.plan.rows.ctypes.data,
            template.address,
            template.size,
        )
        self._layouts[place : place + 1] = [layout]
        self._state.known = len(self._layouts)


def make_compiled_path(times: PublishedTimes) -> CompiledPath | None:
    """Return the compiled way for ``times``; None where nothing is compiled."""
    library = kernel.compiled()
    return None if library is None else CompiledPath(library, times)
