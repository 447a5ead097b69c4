"""onebot_description.parameters.files: what a saved file changes."""

from pathlib import Path

import pytest

from onebot_description.joints.config import JointsConfig
from onebot_description.parameters.files import LiveParameters
from onebot_description.parameters.reader import ConfigError, defaults

NODE = "/jsp"
DEFAULTS = defaults(JointsConfig)


def write(file: Path, parameters: str) -> Path:
    """Write parameters for the node."""
    file.write_text(f"jsp:\n  ros__parameters: {{{parameters}}}\n")
    return file


def test_a_save_makes_everything_as_the_file_says(tmp_path: Path) -> None:
    """Set, changed and unset; what was set live goes, what is not about joints stays."""
    file = write(tmp_path / "a.yaml", "rate: 5, zeros: {a: 1.0}")
    live = LiveParameters([file], NODE, JointsConfig)
    current = {**DEFAULTS, **live.file.values, "pose": "up", "robot_description": "x"}
    write(file, "rate: 6, zeros: {b: 1.0}")
    changes = live.changes(live.read(), current)
    assert changes == {"rate": 6, "zeros.b": 1.0, "pose": "", "zeros.a": None}


def test_the_command_line_comes_first(tmp_path: Path) -> None:
    """And it is known what was edited in vain."""
    file = write(tmp_path / "a.yaml", "rate: 5, delta: 0.1")
    live = LiveParameters([file], NODE, JointsConfig)
    current = {**DEFAULTS, "rate": 50, "delta": 0.1}
    live.pin(["rate", "delta"], current)
    write(file, "rate: 6, delta: 0.2")
    fresh = live.read()
    assert live.changes(fresh, current) == {"delta": 0.2}
    assert live.overridden(fresh) == ["rate"]


def test_places_are_only_of_what_the_file_decided(tmp_path: Path) -> None:
    """A value set live was not written on any line."""
    file = write(tmp_path / "a.yaml", "rate: 5, delta: 0.1")
    live = LiveParameters([file], NODE, JointsConfig)
    assert live.places({"rate": 5, "delta": 0.3}) == {"rate": f"{file}:2"}


def test_config_file_comes_last_and_can_change(tmp_path: Path) -> None:
    """A file that cannot be read leaves things as they were."""
    one = write(tmp_path / "one.yaml", "rate: 1")
    two = write(tmp_path / "two.yaml", "rate: 2")
    live = LiveParameters([one], NODE, JointsConfig)
    live.add(str(two))
    assert live.file.values == {"rate": 2}
    with pytest.raises(ConfigError, match="cannot be read"):
        live.add(str(tmp_path / "none.yaml"))
    assert live.files == (one, two)
    live.add("")
    assert live.file.values == {"rate": 1}
    assert live.names == str(one)
