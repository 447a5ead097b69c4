"""Find other nodes in a twentieth of a second instead of, every other time, in three.

A participant that Fast DDS (2.14) creates announces itself before it is ready to listen. Who hears
that answers at once, within a tenth of a millisecond on the same host; an answer that comes too
early is dropped, and the next chance is the other's periodic announcement, every 3 s. Here the
thread that receives only gets to run once the thread that creates is done: both share one
processor, and no thread preempts another (SCHED_BATCH). The answer waits in the socket till then.

OneBot's own nodes are found without this: they announce themselves five times a second (see
``use_quick_discovery``). It is for the nodes of others, and for a wider discovery range.
"""

import contextlib
import os
from collections.abc import Iterator


@contextlib.contextmanager
def undisturbed() -> Iterator[None]:
    """Create nodes within this context; a no-op where the system does not allow it."""
    if not hasattr(os, "sched_setaffinity"):
        yield
        return
    processors, policy = os.sched_getaffinity(0), os.sched_getscheduler(0)
    try:
        _set(0, {max(processors)}, os.SCHED_BATCH)
        yield
    finally:
        for thread in os.listdir("/proc/self/task"):
            _set(int(thread), processors, policy)


def _set(thread: int, processors: set[int], policy: int) -> None:
    with contextlib.suppress(OSError):  # it has ended, or a sandbox forbids it
        os.sched_setaffinity(thread, processors)
        os.sched_setscheduler(thread, policy, os.sched_param(0))
