from pathlib import Path

import pytest

from onebot_bringup.viewer.view_config import ViewConfig, load_view, view_for
from onebot_description.errors import OneBotError


def _load(tmp_path: Path, text: str) -> ViewConfig:
    path = tmp_path / "view.yaml"
    path.write_text(text)
    return load_view(path)


def test_the_example_in_the_module_is_valid(tmp_path):
    """The documentation can be copied."""
    from onebot_bringup.viewer import view_config

    text = view_config.__doc__.partition("::\n")[2]
    assert _load(tmp_path, text).camera.follow == "base_link"


def test_the_views_of_our_robots_are_valid():
    """They lie in the config/ of the packages that describe the robots."""
    onebot, mrm = map(view_for, ("onebot", "mrm"))
    assert onebot is not None
    assert onebot.parts[-3:] == ("onebot_description", "config", "view.yaml")
    assert load_view(onebot).fixed_frame == "odom"
    assert all(view_for(robot) is None for robot in ("nobody", "", "../mrm", "my robot", "é"))
    assert mrm is not None and load_view(mrm).fixed_frame == "base_link"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("fixed_fram: odom", ':1: fixed_fram: no such parameter (did you mean "fixed_frame"?'),
        ("camera: {eye: [1, 2]}", "eye: 2 numbers; write three meters, such as [3.0, -3.0, 2.0]"),
        ("axes: 3", "axes: 3 is a number; write a map with visible, length, names, names_up_to,"),
        ("trails: [odom]", "is a list; write a map"),
        ("trails: {a: {topic: a b}}", '"a b" is not valid; write a topic, such as'),
        ("speeds: {lines: {a: {topic: b, type: twist}}}", 'a.type: no "twist" (did you mean "Twi'),
        ("curves: {lines: {a: {topic: t, field: a..b}}}", "write a field, such as pose.position.x"),
        ("background: [1, 2, 300]", "background: 300 is above 255; write three bytes, such as"),
    ],
)
def test_a_mistake_is_named_with_what_would_be_right(tmp_path, text, said):
    """The error names file and key, and says what to write."""
    with pytest.raises(OneBotError) as caught:
        _load(tmp_path, text)
    assert said in str(caught.value) and "view.yaml" in str(caught.value)
