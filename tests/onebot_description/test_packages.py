"""Packages are found with no variable set, and a sourced workspace stays ahead."""

import os
import sys
from pathlib import Path

import pytest

from onebot_description.description.packages import (
    package_names,
    package_share,
    use_environment_prefix,
)
from onebot_description.errors import OneBotError


def _prefixes() -> list[str]:
    return os.environ["AMENT_PREFIX_PATH"].split(os.pathsep)


def test_packages_are_found_with_no_variable_set(monkeypatch):
    """Ours lie in this checkout, those of the wheels in the environment."""
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)
    assert (package_share("mrm_description") / "urdf/mrm.xacro").is_file()
    assert package_share("geometry_msgs") == Path(sys.prefix) / "share/geometry_msgs"
    assert {"mrm_description", "onebot_description", "std_msgs"} <= set(package_names())


def test_a_checkout_is_found_ahead_of_its_installed_copy(monkeypatch):
    """An edit in the checkout takes effect at once; the environment may hold older copies."""
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)
    checkout = Path(__file__).parents[2]
    for name in ("mrm_description", "onebot_description", "onebot_control", "onebot_bringup"):
        assert package_share(name) == checkout / name


def test_sourced_workspace_stays_first(monkeypatch, tmp_path):
    """What the user sourced goes before the environment, however often this is called."""
    index = tmp_path / "share/ament_index/resource_index/packages"
    index.mkdir(parents=True)
    (index / "mrm_description").touch()
    monkeypatch.setenv("AMENT_PREFIX_PATH", os.pathsep.join([str(tmp_path), sys.prefix]))
    use_environment_prefix()
    once = _prefixes()
    use_environment_prefix()
    assert _prefixes() == once
    assert once[0] == str(tmp_path) and once[-1] == sys.prefix
    assert package_share("mrm_description") == tmp_path / "share/mrm_description"


def test_unknown_package_names_the_nearest():
    """The error says which package was probably meant."""
    with pytest.raises(OneBotError, match='"mrm_descripton".*did you mean "mrm_description"'):
        package_share("mrm_descripton")
