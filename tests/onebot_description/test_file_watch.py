"""onebot_description.file_watch: saves are noticed, however an editor makes them."""

import os
from pathlib import Path

from onebot_description.file_watch import FileWatch, file_states


def polled(watch: FileWatch) -> list[Path]:
    """Two polls, as it takes two to find a file at rest."""
    return watch.saved() + watch.saved()


def test_a_save_is_noticed_once(tmp_path: Path) -> None:
    """In place."""
    file = tmp_path / "a.yaml"
    file.write_text("one")
    watch = FileWatch([file])
    assert polled(watch) == []
    file.write_text("other")
    assert polled(watch) == [file]
    assert polled(watch) == []


def test_a_rename_over_the_file_is_noticed(tmp_path: Path) -> None:
    """Even to the same size and time."""
    file, fresh = tmp_path / "a.yaml", tmp_path / "a.yaml~"
    file.write_text("one")
    watch = FileWatch([file])
    fresh.write_text("two")
    status = file.stat()
    os.utime(fresh, ns=(status.st_atime_ns, status.st_mtime_ns))
    fresh.replace(file)
    assert polled(watch) == [file]


def test_a_file_being_written_is_awaited(tmp_path: Path) -> None:
    """It counts only when two polls see the same."""
    file = tmp_path / "a.yaml"
    file.write_text("one")
    watch = FileWatch([file])
    file.write_text("")
    assert watch.saved() == []
    file.write_text("half")
    assert watch.saved() == []
    assert watch.saved() == [file]


def test_files_saved_together_are_reported_together(tmp_path: Path) -> None:
    """While one of them is still being written, the others wait."""
    one, two = tmp_path / "one", tmp_path / "two"
    watch = FileWatch([one, two])
    one.write_text("1")
    assert watch.saved() == []
    two.write_text("2")
    assert watch.saved() == []
    assert watch.saved() == [one, two]


def test_a_file_that_goes_and_comes_back(tmp_path: Path) -> None:
    """Its absence is a change but no save; its return is both."""
    file = tmp_path / "a.yaml"
    file.write_text("one")
    watch = FileWatch([file])
    file.unlink()
    assert polled(watch) == []
    file.write_text("back")
    assert polled(watch) == [file]
    file.unlink()
    assert watch.changed() + watch.changed() == [file]


def test_other_files_can_be_watched(tmp_path: Path) -> None:
    """Those kept stay as they were known."""
    one, two = tmp_path / "one", tmp_path / "two"
    one.write_text("1")
    two.write_text("2")
    watch = FileWatch([one])
    one.write_text("1 changed")
    watch.watch([one, two])
    assert polled(watch) == [one]
    assert watch.files == (one, two)


def test_what_was_known_before(tmp_path: Path) -> None:
    """A save between the reading of a file and the watch counts; so does an unread file."""
    file, absent = tmp_path / "a", tmp_path / "absent"
    file.write_text("1")
    read = file_states([file, absent])
    assert polled(FileWatch([file, absent], known=read)) == []
    file.write_text("changed")
    assert polled(FileWatch([file, absent], known=read)) == [file]
    watch = FileWatch([file, absent], unread=True)
    assert watch.changed() + watch.changed() == [file, absent]
    assert watch.changed() == []
