"""onebot_description.parameters.files: saves are noticed, however an editor makes them."""

import os
from pathlib import Path

from onebot_description.parameters.files import FileWatch


def looks(watch: FileWatch) -> list[Path]:
    """Two looks, as it takes two to see a file at rest."""
    return watch.saved() + watch.saved()


def test_a_save_is_noticed_once(tmp_path: Path) -> None:
    """In place."""
    file = tmp_path / "a.yaml"
    file.write_text("one")
    watch = FileWatch([file])
    assert looks(watch) == []
    file.write_text("other")
    assert looks(watch) == [file]
    assert looks(watch) == []


def test_a_rename_over_the_file_is_noticed(tmp_path: Path) -> None:
    """Even to the same size and time."""
    file, fresh = tmp_path / "a.yaml", tmp_path / "a.yaml~"
    file.write_text("one")
    watch = FileWatch([file])
    fresh.write_text("two")
    status = file.stat()
    os.utime(fresh, ns=(status.st_atime_ns, status.st_mtime_ns))
    fresh.replace(file)
    assert looks(watch) == [file]


def test_a_file_being_written_is_awaited(tmp_path: Path) -> None:
    """It counts only when two looks see the same."""
    file = tmp_path / "a.yaml"
    file.write_text("one")
    watch = FileWatch([file])
    file.write_text("")
    assert watch.saved() == []
    file.write_text("half")
    assert watch.saved() == []
    assert watch.saved() == [file]


def test_a_file_that_goes_and_comes_back(tmp_path: Path) -> None:
    """Its absence is nothing; its return is a save."""
    file = tmp_path / "a.yaml"
    file.write_text("one")
    watch = FileWatch([file])
    file.unlink()
    assert looks(watch) == []
    file.write_text("back")
    assert looks(watch) == [file]


def test_other_files_can_be_watched(tmp_path: Path) -> None:
    """Those kept stay as they were known."""
    one, two = tmp_path / "one", tmp_path / "two"
    one.write_text("1")
    two.write_text("2")
    watch = FileWatch([one])
    one.write_text("1 changed")
    watch.watch([one, two])
    assert looks(watch) == [one]
    assert watch.files == (one, two)
