"""Provides PyBullet as ``engine``, and its worlds; logs what its C code prints."""

import contextlib
import ctypes
import logging
import math
import os
import re
import sys
import tempfile
import threading
import weakref
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import IO, Any, NoReturn

from onebot_description.errors import OneBotError

__all__ = ["Bullet", "PhysicsSettings", "captured", "engine", "log", "logger", "scratch_file"]

logger = logging.getLogger("onebot_control.physics")

# m; farther out, rounding errors are not small compared to a wheel's contact depth (micrometers).
FARTHEST = 10_000.0
_SLAB = (FARTHEST, FARTHEST, 1.0)  # half the size of the ground's visual, m

# File descriptors belong to the process: two captures at once would restore each other's.
_lock = threading.RLock()
# The C library that PyBullet prints with; on Windows, it is not among the process's own symbols.
_LIBC = ctypes.CDLL("ucrtbase" if os.name == "nt" else None)
# Bullet's prefix of each warning names a line of its sources.
_ORIGIN = re.compile(r"b3(?:Warning|Error|Printf)\[[^\]]*\]:\s*")


@contextlib.contextmanager
def scratch_file() -> Iterator[tuple[IO[bytes], str]]:
    """Yield an empty file, and a path that opens it again.

    On Linux the file is in memory, so that a killed process leaves nothing behind.
    """
    if sys.platform == "linux":
        with open(os.memfd_create("onebot"), "w+b") as file:
            yield file, f"/proc/self/fd/{file.fileno()}"
    else:
        with tempfile.TemporaryDirectory() as folder, open(f"{folder}/scratch", "w+b") as file:
            yield file, file.name


@contextlib.contextmanager
def captured(*descriptors: int) -> Iterator[list[str]]:
    """Capture everything that the process writes to ``descriptors`` (default: 1, stdout).

    Output of other threads is captured too, so the lines should be logged. Closed descriptors are
    skipped.

    Yields:
        A list, which is filled with the captured lines when the block ends, even by an exception.
    """
    lines: list[str] = []
    with _lock, scratch_file() as (file, _), contextlib.ExitStack() as restoring:
        _flush()
        for descriptor in descriptors or (1,):
            # A closed descriptor can neither be captured nor restored.
            with contextlib.suppress(OSError):
                saved = os.dup(descriptor)
                restoring.callback(_restore, saved, descriptor)
                os.dup2(file.fileno(), descriptor)
        try:
            yield lines
        finally:
            _flush()
            restoring.close()
            file.seek(0)
            text = _ORIGIN.sub("\n", file.read().decode(errors="replace"))
            lines += filter(None, map(str.strip, text.split("\n")))


def log(lines: list[str]) -> None:
    """Log captured lines as warnings."""
    for line in lines:
        logger.warning("PyBullet: %s", line)


def _flush() -> None:
    """Flush the buffers of C and Python to the current descriptors."""
    for stream in (sys.stdout, sys.stderr):
        # In a test runner or without a terminal, a stream may be None or closed.
        with contextlib.suppress(AttributeError, ValueError, OSError):
            stream.flush()
    _LIBC.fflush(None)


def _restore(saved: int, descriptor: int) -> None:
    os.dup2(saved, descriptor)
    os.close(saved)


class _Engine:
    """The module pybullet, imported at its first use, because the import takes 0.3 s."""

    def __getattr__(self, name: str) -> Any:
        # PyBullet prints a line when it is imported.
        with captured(1, 2):
            import pybullet
        value = getattr(pybullet, name)
        setattr(self, name, value)  # cached: __getattr__ is not called for it again
        return value


engine = _Engine()


@dataclass(frozen=True)
class PhysicsSettings:
    """Settings of the simulated physics; the defaults were determined by measurements.

    Attributes:
        rate: physics steps per simulated second, Hz.
        iterations: iterations of the constraint solver in each step.
        gravity: downwards, m/s^2.
        friction: coefficient of the ground, and of links without <contact><lateral_friction> in
            the URDF; the friction of a contact is the product of both.
        settling: maximum simulated time for a robot to come to rest before it starts, s.
    """

    # A control period must be a whole number of steps, unlike PyBullet's default of 240 Hz with
    # 100 Hz control; ``fitted`` ensures this for any control rate. 400 Hz takes twice as long.
    # OneBot is equally accurate with both; the odometry of tall robots with arms (Stretch) is
    # within 0.04 % of the exact value, with 400 Hz within 0.02 %.
    rate: float = 200.0
    # The solver never stops early, so that a robot at rest drifts by nanometers, not millimeters.
    iterations: int = 200
    gravity: float = 9.81
    friction: float = 1.0
    settling: float = 2.0

    def fitted(self, cycles: float) -> "PhysicsSettings":
        """Return these settings for ``cycles`` control periods per second.

        The rate becomes the smallest multiple of ``cycles`` that is not below the current rate.
        """
        return replace(self, rate=cycles * math.ceil(self.rate / cycles * (1.0 - 1e-9)))

    def steps(self, duration: float) -> int:
        """Return the number of physics steps in ``duration`` (s)."""
        return round(duration * self.rate)


class Bullet:
    """A PyBullet world, with the functions of ``engine`` without their physicsClientId.

    Attributes:
        settings: settings of its physics.
        client: its physicsClientId.
        ground: PyBullet's index of the ground; ``set_up`` adds it.
        close: frees the world, as garbage collection does.
    """

    ground: int

    def __init__(
        self,
        settings: PhysicsSettings = PhysicsSettings(),  # noqa: B008 - it is frozen
    ) -> None:
        """Create an empty world."""
        self.settings = settings
        self.client: int = engine.connect(engine.DIRECT)
        self.close = weakref.finalize(self, engine.disconnect, self.client)

    def set_up(self, residual: float = 0.0) -> None:
        """Set up the physics and the ground of an empty world.

        Args:
            residual: the solver stops early once an iteration changes no velocity (rad/s or m/s) by
                more than its square root; 0: never.
        """
        settings = self.settings
        self.setTimeStep(1.0 / settings.rate)
        self.setGravity(0.0, 0.0, -settings.gravity)
        self.setPhysicsEngineParameter(
            numSolverIterations=settings.iterations,
            solverResidualThreshold=residual,
            # With the cache, PyBullet would load the old version of an edited file.
            enableFileCaching=0,
        )
        plane = self.createCollisionShape(engine.GEOM_PLANE)
        # Without a visual shape, PyBullet would load a textured plane, which takes 7 ms and 6 MB.
        slab = self.createVisualShape(
            engine.GEOM_BOX, halfExtents=_SLAB, visualFramePosition=(0.0, 0.0, -_SLAB[2])
        )
        self.ground = self.createMultiBody(0, plane, slab)
        self.changeDynamics(self.ground, -1, lateralFriction=settings.friction)

    def __getattr__(self, name: str) -> Any:
        function = partial(getattr(engine, name), physicsClientId=self.client)
        setattr(self, name, function)  # cached: __getattr__ is not called for it again
        return function

    def __reduce__(self) -> NoReturn:
        # A copy would use another world with this number, or none.
        raise OneBotError("a simulation can neither be copied nor sent to another process")
