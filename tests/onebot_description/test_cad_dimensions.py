from pathlib import Path

import pytest
import yaml

from onebot_description.cad.dimensions import read_dimensions
from onebot_description.description.packages import package_share
from onebot_description.errors import OneBotError

SOURCE = package_share("onebot_description") / "config/dimensions.yaml"


def _spoilt(tmp_path: Path, change) -> Path:
    data = yaml.safe_load(SOURCE.read_text())
    change(data)
    path = tmp_path / "dimensions.yaml"
    path.write_text(yaml.safe_dump(data))
    return path


def test_the_file_is_read_as_it_stands():
    """The values arrive under their names, and the base's mass is the one that was asked for."""
    dimensions = read_dimensions(SOURCE)
    assert (dimensions.wheel.radius, dimensions.wheel.separation) == (0.06, 0.3)
    assert dimensions.base_mass == 3.978
    assert dimensions.base_center_of_mass == (-0.108, 0.0, -0.02579)
    assert dimensions.densities.keys() == dimensions.colors.keys()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d["wheel"].pop("radius"), ": wheel: has no radius"),
        (
            lambda d: d["wheel"].update(radiu=1.0),
            'radiu: no such parameter (did you mean "radius"',
        ),
        (
            lambda d: d["caster"]["wheel"].update(width="wide"),
            'caster.wheel.width: "wide" is a string; write a number',
        ),
        (
            lambda d: d["wheel"].update(spokes=5.5),
            "wheel.spokes: 5.5 is a number; write an integer",
        ),
        (lambda d: d["wheel"].update(width=True), "wheel.width: true is a bool; write a number"),
        (lambda d: d["base"].update(deck=float("nan")), "base.deck: nan is not finite"),
        (lambda d: d.update(base=3), "base: 3 is a number; write a map with front, rear"),
        (
            lambda d: d.update(densities=[1]),
            "densities: [1] is a list; write a map",
        ),
        (lambda d: d["colors"].update(shell=[1, 1]), "colors.shell: 2 numbers; write 3"),
    ],
)
def test_a_wrong_key_is_named(tmp_path, change, message):
    """A mistake in the file gives one error with the file, the key and what would be right."""
    path = _spoilt(tmp_path, change)
    with pytest.raises(OneBotError) as caught:
        read_dimensions(path)
    assert message in str(caught.value)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize("text", [None, "a: [", "just words"])
def test_an_unreadable_file_is_one_error(tmp_path, text):
    """No file, invalid YAML, or no mapping: an error that names the file."""
    path = tmp_path / "dimensions.yaml"
    if text is not None:
        path.write_text(text)
    with pytest.raises(OneBotError, match="dimensions.yaml"):
        read_dimensions(path)
