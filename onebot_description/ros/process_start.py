"""Prepares a node's process before anything slow is imported."""

import gc
import os
import signal
import sys
from collections.abc import Mapping
from types import FrameType

_BLAS_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS")  # the first is only for OpenBLAS


def find_silently() -> None:
    """Make Ctrl-C end the process silently while ``python -m`` looks for one of our modules."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _while_looking)


def _while_looking(number: int, frame: FrameType | None) -> None:
    if sys.argv[:1] == ["-m"]:  # until it is found
        os._exit(0)
    signal.default_int_handler(number, frame)


def start_node() -> None:
    """Prepare the process of a node, which ``run_node`` then runs.

    Until the node runs, Ctrl-C ends the process silently, and no garbage is collected: imported
    objects stay, and scanning them repeatedly would take a tenth of the start. Numpy starts no
    threads.
    """
    gc.disable()
    # Leave it alone if it is handled (in the launcher) or ignored (in a shell's background job).
    if signal.getsignal(signal.SIGINT) in (signal.default_int_handler, _while_looking):
        signal.signal(signal.SIGINT, lambda *_: os._exit(0))
    os.environ.update(blas_variables())


def blas_variables() -> Mapping[str, str]:
    """Return the environment variables that keep numpy from starting threads when it is imported.

    No node multiplies matrices large enough to benefit, and starting the threads takes longer than
    importing all of numpy. Variables that the user has set are left out.
    """
    is_set = any(variable in os.environ for variable in _BLAS_THREADS)
    return {} if is_set else {_BLAS_THREADS[0]: "1"}
