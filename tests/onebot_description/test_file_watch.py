"""onebot_description.file_watch: saves are noticed, however an editor makes them."""

import os
from collections.abc import Iterable
from pathlib import Path

import pytest

from onebot_description.file_watch import FileWatch


class Watched:
    """Files that are polled at times which the test sets."""

    def __init__(self, files: Iterable[Path], **options: object) -> None:
        self.now = 100.0
        self.watch = FileWatch(files, clock=lambda: self.now, **options)  # type: ignore[arg-type]

    def after(self, seconds: float) -> list[Path]:
        """Poll some time later."""
        self.now += seconds
        return self.watch.poll()

    def rest(self) -> list[Path]:
        """What is found when a change is noticed, and the files are long at rest."""
        assert self.after(0.01) == []
        return self.after(5.0)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """A file with something in it."""
    (tmp_path / "a.yaml").write_text("one")
    return tmp_path / "a.yaml"


def test_a_save_is_noticed_once(file: Path) -> None:
    watched = Watched([file])
    assert watched.rest() == []
    file.write_text("other")
    assert watched.rest() == [file]
    assert watched.rest() == []


def test_a_rename_over_the_file_is_noticed(file: Path) -> None:
    fresh = file.with_name("a.yaml~")
    watched = Watched([file])
    fresh.write_text("two")
    status = file.stat()
    os.utime(fresh, ns=(status.st_atime_ns, status.st_mtime_ns))
    fresh.replace(file)
    assert watched.rest() == [file]


def test_a_file_being_written_is_awaited(file: Path) -> None:
    watched = Watched([file])
    for text in ("h", "ha", "hal", "half"):
        file.write_text(text)
        assert watched.after(0.15) == []
    assert watched.after(0.1) == []
    assert watched.after(0.15) == [file]


@pytest.mark.parametrize("absent", [False, True])
def test_an_empty_or_absent_file_is_awaited_longer(file: Path, absent: bool) -> None:
    watched = Watched([file])
    if absent:
        file.unlink()
    else:
        file.write_text("")
    assert watched.after(0.01) == []
    assert watched.after(0.9) == []
    file.write_text("the rest")
    assert watched.after(0.01) == []
    assert watched.after(0.2) == [file]
    assert watched.rest() == []


def test_files_saved_together_are_reported_together(tmp_path: Path) -> None:
    one, two = tmp_path / "one", tmp_path / "two"
    watched = Watched([one, two])
    one.write_text("1")
    assert watched.after(0.15) == []
    two.write_text("2")
    assert watched.after(0.15) == []
    assert watched.after(0.2) == [one, two]


def test_a_file_that_goes_and_comes_back(file: Path) -> None:
    watched = Watched([file])
    file.unlink()
    assert watched.rest() == [file]
    assert watched.rest() == []
    file.write_text("back")
    assert watched.rest() == [file]


def test_other_files_can_be_watched(tmp_path: Path) -> None:
    one, two = tmp_path / "one", tmp_path / "two"
    one.write_text("1")
    two.write_text("2")
    watched = Watched([one])
    one.write_text("1 changed")
    watched.watch.watch([one, two])
    assert watched.rest() == [one]
    assert watched.watch.files == (one, two)


def test_a_file_written_after_it_was_read(file: Path) -> None:
    written_ns = file.stat().st_mtime_ns
    assert Watched([file], since_ns=written_ns).rest() == []
    watched = Watched([file], since_ns=written_ns - 1)
    assert watched.rest() == [file]
    assert watched.rest() == []
