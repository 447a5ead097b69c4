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
