"""Packages are found with no variable set, and addresses of files lead to them."""

import os
import sys
from pathlib import Path

import pytest

from onebot_description.description.packages import (
    cache_folder,
    package_names,
    package_share,
    resolve,
    use_environment_prefix,
)
from onebot_description.errors import OneBotError

ROBOTS = Path(__file__).parents[1] / "robots"
CUBE = ROBOTS / "meshes" / "cube.stl"


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


@pytest.mark.parametrize("uri", ["meshes/cube.stl", str(CUBE), CUBE.as_uri(), f"file:{CUBE}"])
def test_paths_lead_to_the_file(uri: str) -> None:
    """Relative and absolute paths and file:// name the same file."""
    assert resolve(uri, ROBOTS) == CUBE


def test_percent_signs_of_a_file_uri_are_decoded(tmp_path: Path) -> None:
    """A file URI may escape a space."""
    path = tmp_path / "a cube.stl"
    assert resolve(path.as_uri(), None) == path
    assert "%20" in path.as_uri()


def test_package_leads_to_its_share_folder() -> None:
    """package:// is found through the ament index."""
    assert resolve("package://onebot_description/package.xml", None).is_file()


@pytest.mark.parametrize(
    ("uri", "words"),
    [
        ("package://no_such_package_at_all/a.stl", 'no ROS package "no_such_package_at_all"'),
        ("package://", "must read package://<package>/<path>"),
        ("package:///a.stl", "must read package://<package>/<path>"),
        ("file://host/a.stl", "with three slashes"),
        ("file://[/a.stl", "Invalid"),
        ("http://a.org/b.stl", "nothing is fetched from the network"),
        ("HTTPS://a.org/b.stl", "nothing is fetched from the network"),
        ("model://b/b.stl", "is not loaded; write package://"),
    ],
)
def test_what_names_no_file_is_refused(uri: str, words: str) -> None:
    """The error begins with the address and says what would be right."""
    with pytest.raises(OneBotError) as caught:
        resolve(uri, ROBOTS)
    assert str(caught.value).startswith(f'"{uri}"') and words in str(caught.value)


def test_a_relative_path_needs_a_folder() -> None:
    """Text from a topic lies in none."""
    with pytest.raises(OneBotError, match='"a.stl" is relative.*or an absolute path'):
        resolve("a.stl", None)


@pytest.mark.parametrize("home", ["/dev/null", "/proc", None])
def test_without_a_home_that_can_be_written(monkeypatch, tmp_path, home):
    """The folder for temporary files takes its place, unless somebody else has made it."""
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)
    monkeypatch.setattr(Path, "home", lambda: _home(home))
    own = tmp_path / f"onebot-{os.getuid()}"
    assert cache_folder() == own and own.stat().st_mode & 0o777 == 0o700
    assert package_share("mrm_description") == Path(__file__).parents[2] / "mrm_description"
    assert _prefixes()[0].startswith(str(own))
    monkeypatch.setattr(os, "getuid", lambda: 4242)
    (tmp_path / "onebot-4242").mkdir()
    with pytest.raises(OneBotError, match="set XDG_CACHE_HOME"):
        cache_folder()


def _home(home: str | None) -> Path:
    if home is None:
        raise RuntimeError("Could not determine home directory.")
    return Path(home)
