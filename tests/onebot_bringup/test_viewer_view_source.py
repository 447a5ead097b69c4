"""A view that its user edits, switches and saves."""

from contextlib import suppress
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onebot_bringup.viewer.view_config import (
    ViewConfig,
    load_view,
    parse_view,
    view_for,
    view_text,
)
from onebot_bringup.viewer.view_source import ViewSource
from onebot_description.errors import OneBotError
from onebot_description.parameters.reader import ConfigError, replaced, values_of

TEXT = """# how I look at it
collision: false   # shapes
camera:
  eye: [1, 2, 3]   # from there
grid: {visible: true}  # flow
trails:
  way: {topic: odom}
"""


def _source(tmp_path: Path, text: str = TEXT) -> ViewSource:
    (tmp_path / "view.yaml").write_text(text)
    return ViewSource(str(tmp_path / "view.yaml"))


@given(robot=st.sampled_from(["onebot", "mrm"]), data=st.data())
def test_any_settings_of_our_views_can_be_saved_and_read_again(robot, data):
    """Every setting; of a word or a fraction, that may have few values, the one that it has."""
    path = view_for(robot)
    assert path is not None
    view = load_view(path)
    drawn = {bool: st.booleans(), float: st.floats(0, 1e6), str: st.sampled_from(["a", "b: c"])}
    settings = values_of(view)
    names = [n for n, v in settings.items() if type(v) in drawn and "panels" not in n]
    for name in data.draw(st.lists(st.sampled_from(names), unique=True)):
        with suppress(ConfigError):
            view = replaced(view, name, data.draw(drawn[type(settings[name])]))
    assert parse_view(view_text(view)) == view


def test_saving_replaces_the_file(tmp_path):
    """It holds what was read and what was changed since, and nothing that is as by default."""
    source = _source(tmp_path)
    source.change("collision", True)
    source.change("grid.spacing", 1e-7)
    assert source.save() == tmp_path / "view.yaml"
    assert load_view(tmp_path / "view.yaml") == source.view
    assert "visible" not in (tmp_path / "view.yaml").read_text()
    assert not source.reload(), "it is what is in force"


def test_a_view_without_a_file_is_saved_where_the_user_says(tmp_path):
    """Whole, with trails and all; without a name, the error says how to give one."""
    source = ViewSource("none")
    source.change("collision", True)
    with pytest.raises(OneBotError, match="save_view_to"):
        source.save()
    with pytest.raises(OneBotError, match=r"must end in \.yaml"):
        source.save(tmp_path / "view.txt")
    with pytest.raises(OneBotError, match="cannot be written: No such file"):
        source.save(tmp_path / "none/view.yaml")
    source.save(tmp_path / "own.yaml")
    assert (tmp_path / "own.yaml").read_text() == "collision: true\n"
    named = _source(tmp_path)
    named.change("collision", True)
    named.save(tmp_path / "copy.yaml")
    assert load_view(tmp_path / "copy.yaml") == named.view
    assert (tmp_path / "view.yaml").read_text() == TEXT


def test_an_edit_counts_where_it_changes_something(tmp_path):
    """What was switched meanwhile stays, unless the edit is of the same setting."""
    source, file = _source(tmp_path), tmp_path / "view.yaml"
    source.change("collision", True)
    source.change("axes.visible", False)
    file.write_text(TEXT.replace("true", "false") + "axes: {length: 2}\n")
    assert source.reload()
    assert source.view.collision and not source.view.axes.visible
    assert source.view.axes.length == 2.0 and not source.view.grid.visible
    file.write_text("axes: {visible: true, length: 3}\ncollision: true\n")
    assert source.reload()
    assert not source.view.axes.visible, "the file says nothing new of it"
    assert source.view.trails == {} and source.view.axes.length == 3.0
    file.write_text("axes: {visible: maybe}")
    with pytest.raises(
        OneBotError, match=r'axes\.visible: "maybe" is a string; write true or false'
    ):
        source.reload()
    assert source.view.axes.length == 3.0


def test_without_a_file_the_robot_s_own_view_is_taken(tmp_path):
    """Of each robot that comes, and none where there is none; but never in the place of a file."""
    source = ViewSource("")
    source.change("collision", True)
    assert source.set_robot("onebot") and not source.set_robot("onebot")
    assert source.file == view_for("onebot")
    assert source.view.collision and source.view.camera.follow == "base_link"
    assert source.set_robot("mrm") and source.view.joint_plot.limits
    assert source.set_robot("nobody") and source.view == replaced(ViewConfig(), "collision", True)
    assert not ViewSource("none").set_robot("onebot")
    assert not _source(tmp_path).set_robot("onebot")
