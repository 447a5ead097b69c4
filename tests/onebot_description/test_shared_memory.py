"""onebot_description.ros.shared_memory: what keeps nodes from starting is removed."""

import os
import sys
from pathlib import Path

from onebot_description.ros.shared_memory import FOLDER, remove_broken_ports
from tests.support import run_to_end

READY = b"\2\0\0\0"
START = """
import rclpy
from onebot_description.ros.discovery import configure_discovery
configure_discovery()
rclpy.init()
rclpy.create_node("started")
print("started")
"""


def test_only_old_and_unfinished_ports_are_removed(tmp_path: Path) -> None:
    """Whatever else is in the folder, and where there is none."""
    broken = {"fastrtps_port7000": b"", "fastrtps_port7412": b"\0", "fastrtps_port7413": bytes(99)}
    sound = {
        "fastrtps_port7410": READY + bytes(99),
        "fastrtps_port7410_el": b"",
        "sem.fastrtps_port7410_mutex": bytes(32),
        "fastrtps_0123456789abcdef": bytes(99),
    }
    for name, content in (broken | sound).items():
        (tmp_path / name).write_bytes(content)
        os.utime(tmp_path / name, (0, 0))
    (tmp_path / "fastrtps_port7415").touch()  # being made just now
    remove_broken_ports(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {*sound, "fastrtps_port7415"}
    remove_broken_ports(tmp_path / "none")


def test_a_node_starts_where_ports_were_never_finished(ros_domain: int) -> None:
    """It would wait for minutes."""
    first = 7400 + 250 * ros_domain  # RTPS 2.2, section 9.6.1.1
    contents = {11: b"", 13: bytes(52400)}
    files = {FOLDER / f"fastrtps_port{first + offset}": data for offset, data in contents.items()}
    try:
        for file, content in files.items():
            file.write_bytes(content)
            os.utime(file, (0, 0))
        done = run_to_end([sys.executable, "-c", START])
    finally:
        for file in files:
            file.unlink(missing_ok=True)
    assert done.stdout == "started\n", done.stderr
