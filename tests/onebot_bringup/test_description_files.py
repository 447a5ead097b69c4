"""What is known of a robot's files when they have been read, and what counts as an edit."""

from pathlib import Path

import pytest

from onebot_bringup.launch.description_watcher import Known
from onebot_description.description.places import digest_of
from onebot_description.file_watch import file_states


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """A file of a robot."""
    (tmp_path / "a.xacro").write_text("one")
    return tmp_path / "a.xacro"


def test_what_is_known_survives_a_command_line(file: Path) -> None:
    """As text, with files that are gone; whoever reads it finds nothing edited."""
    gone = file.parent / "gone.xacro"
    known = Known.of("<robot/>", [file, gone], {})
    again = Known.from_json(known.to_json())
    assert again == known
    assert again.files == file_states([file, gone])
    assert again.files[gone] is None and again.digest == digest_of("<robot/>")


def test_an_edit_while_the_files_were_read_is_one(file: Path) -> None:
    """How a file was before counts, if it was looked at then; else how it is now."""
    before = file_states([file])
    file.write_text("longer than before")
    known = Known.of("<robot/>", [file], before)
    assert known.files == before and known.files != file_states([file])
    assert Known.of("<robot/>", [file], {}).files == file_states([file])
    known.wait_for_edit()  # returns, as it is an edit


def test_a_digest_is_that_of_the_text() -> None:
    """Its length and its contents."""
    assert digest_of("ab") == digest_of("ab")
    assert len({digest_of(text) for text in ("", "ab", "ba", "abc", "é")}) == 5
