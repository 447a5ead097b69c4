"""Recordings as they come: whole, cut short by a crash, or of ROS messages."""

import subprocess
from collections.abc import Callable
from pathlib import Path

from onebot_bringup.rrd_file import NOTHING
from onebot_bringup.viewer.processes import program
from onebot_bringup.viewer.recording import open_recording
from onebot_description.errors import OneBotError

_COPYING = 120.0  # seconds


def salvage(rrd: Path, copy: Path) -> None:
    """Copy what is whole of a recording that was cut short, or is still being written.

    Raises:
        OneBotError: nothing is.
    """
    command = [str(program()), "rrd", "merge", "--continue-on-error", "-o", str(copy)]
    done = subprocess.run(
        [*command, str(rrd.absolute())], capture_output=True, timeout=_COPYING, check=False
    )
    if done.returncode or not copy.is_file() or copy.stat().st_size < NOTHING:
        raise OneBotError(f"{rrd} was cut short before anything was in it")


def record_bag(
    source: Path,
    view: str,
    rrd: Path,
    say: Callable[[str], None],
    warn: Callable[[str], None],
    frame_prefix: str = "",
    namespace: str = "",
) -> None:
    """Record what a bag of ROS messages holds of a robot into the file ``rrd``.

    Args:
        source: a .mcap or .db3 file, or the folder of one.
        view: a view file (.yaml), a layout saved in the viewer (.rbl), or "" for the robot's own.
        rrd: the recording to write.
        say: told how far it is, when that takes over two seconds.
        warn: told what cannot be shown.
        frame_prefix: put before link names to get their frames; "" to find it out.
        namespace: of the robot to draw; "" for the first.

    Raises:
        OneBotError: it cannot be read, or holds nothing of a robot.
    """
    from onebot_bringup.bag.reader import Bag
    from onebot_bringup.bag_replay import log_bag  # brings rclpy

    path = Path(view).expanduser().absolute() if view else None
    if path is not None and not path.is_file():
        raise OneBotError(f"view {path}: there is no such file")
    recording = open_recording(save=rrd)
    try:
        log_bag(
            Bag(source),
            recording.stream,
            view=path,
            frame_prefix=frame_prefix,
            namespace=namespace,
            from_start=False,
            progress=say,
            warn=warn,
        )
    finally:
        recording.close()
