"""Packages are found with no variable set, and addresses of files lead to them."""

import os
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from urllib.parse import quote, unquote, urlsplit

import pytest

from onebot_description.elements.packages import (
    Resources,
    _link,
    cache_folder,
    package_share,
    resolve,
    use_environment_prefix,
    use_package_path,
)
from onebot_description.errors import OneBotError

ROBOTS = Path(__file__).parents[1] / "robots"
CUBE = ROBOTS / "meshes" / "cube.stl"


def _prefixes() -> list[str]:
    return os.environ["AMENT_PREFIX_PATH"].split(os.pathsep)


def test_packages_are_found_with_no_variable_set(monkeypatch):
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)
    assert (package_share("mrm_description") / "urdf/mrm.xacro").is_file()
    assert package_share("geometry_msgs") == Path(sys.prefix) / "share/geometry_msgs"


@pytest.mark.checkout
def test_a_checkout_is_found_ahead_of_its_installed_copy(monkeypatch):
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)
    checkout = Path(__file__).parents[2]
    for name in ("mrm_description", "onebot_description", "onebot_control", "onebot_bringup"):
        assert package_share(name) == checkout / name


def test_sourced_workspace_stays_first(monkeypatch, tmp_path):
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


@pytest.mark.parametrize("uri", ["meshes/cube.stl", str(CUBE), CUBE.as_uri(), f"file:{CUBE}"])
def test_paths_lead_to_the_file(uri: str) -> None:
    assert resolve(uri, ROBOTS) == CUBE


@pytest.mark.parametrize("name", ["one part.stl", "a#b?c.stl", "as%20written.stl", "größe.stl"])
@pytest.mark.parametrize(
    "form",
    [
        "package://arm/meshes/{}",
        "package://arm//meshes//{}",
        "package://arm/meshes/{quoted}",
        "package://arm/meshes\\{}",
        "file://{folder}/meshes/{}",
        "file://localhost{folder}/meshes/{quoted}",
        "file:{folder}/meshes/{}",
        "{folder}/meshes/{}",
        "meshes/{quoted}",
        ".\\meshes\\{}",
    ],
)
def test_however_a_file_is_written_it_is_found(form: str, name: str, tmp_path: Path) -> None:
    """And the address that other programs get leads them there, too."""
    folder = tmp_path / "arm"
    mesh = folder / "meshes" / name
    mesh.parent.mkdir(parents=True)
    mesh.touch()
    (folder / "package.xml").write_text("<package><name>arm</name></package>")
    found, uri = Resources(folder).locate(form.format(name, quoted=quote(name), folder=folder))
    assert found.resolve() == mesh
    assert Path(unquote(urlsplit(uri).path)) == mesh


@pytest.mark.parametrize(
    ("uri", "words"),
    [
        ("file://host/a.stl", "with three slashes"),
        ("file://[/a.stl", "Invalid"),
        ("HTTPS://a.org/b.stl", "https:// is not supported; write package://"),
    ],
)
def test_what_names_no_file_is_refused(uri: str, words: str) -> None:
    """The error begins with the address and says what would be right."""
    with pytest.raises(OneBotError) as caught:
        resolve(uri, ROBOTS)
    assert str(caught.value).startswith(f'"{uri}"') and words in str(caught.value)


def test_a_relative_path_needs_a_folder() -> None:
    with pytest.raises(OneBotError, match='"a.stl" is relative.*or an absolute path'):
        resolve("a.stl", None)


@pytest.mark.checkout
@pytest.mark.parametrize("home", ["/dev/null", "/proc", "~no_such_user"])
def test_without_a_home_that_can_be_written(monkeypatch, tmp_path, home):
    """The folder for temporary files takes its place, unless somebody else has made it."""
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)
    monkeypatch.setattr(Path, "home", lambda: Path(home).expanduser())
    own = tmp_path / f"onebot-{os.getuid()}"
    assert cache_folder() == own and own.stat().st_mode & 0o777 == 0o700
    assert package_share("mrm_description") == Path(__file__).parents[2] / "mrm_description"
    assert _prefixes()[0].startswith(str(own))
    monkeypatch.setattr(os, "getuid", lambda: 4242)
    (tmp_path / "onebot-4242").mkdir()
    with pytest.raises(OneBotError, match="set XDG_CACHE_HOME"):
        cache_folder()


# --- packages that are not installed ------------------------------------------------------------


@pytest.fixture(autouse=True)
def no_search_path(monkeypatch: pytest.MonkeyPatch) -> None:
    """As in a fresh shell."""
    monkeypatch.delenv("ROS_PACKAGE_PATH", raising=False)


def _package(folder: Path, name: str) -> Path:
    """Make a package's folder."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "package.xml").write_text(
        f"<package><!-- <name>old</name> -->\n <name>\n{name} </name></package>"
    )
    return folder


@pytest.mark.parametrize(
    ("urdf", "place"),
    [
        ("ws/src/repo1/arm/urdf/v2", "ws/src/repo1/arm"),  # the file's own package
        ("ws/src/repo1/arm/urdf/v2", "ws/src/repo1/b"),
        ("ws/src/repo1/arm/urdf/v2", "ws/src/repo1/sub/b"),
        ("ws/src/repo1/arm/urdf/v2", "ws/src/repo1/arm/nested/b"),
        ("ws/src/repo1/arm/urdf/v2", "ws/src/repo2/sub/b"),
        # A file in no package.
        ("ws/src/robots", "ws/src/sub/b"),
        ("repo/robots", "repo/sub/b"),
        ("repo/robots", "wanted"),
    ],
)
def test_a_package_is_found_in_the_source_tree_of_the_file(tmp_path, urdf, place):
    (tmp_path / "repo/.git").mkdir(parents=True)
    if "arm" in urdf:
        _package(tmp_path / "ws/src/repo1/arm", "arm_description")
    _package(tmp_path / place, "wanted")
    (tmp_path / urdf).mkdir(parents=True)
    assert resolve("package://wanted/a.stl", tmp_path / urdf) == tmp_path / place / "a.stl"


def test_what_is_no_source_is_not_found(tmp_path):
    _package(tmp_path / "repo/a_description", "a_description")
    for folder in ("repo/.hidden/b", "repo/build/b", "elsewhere/c"):
        _package(tmp_path / folder, "b")
    with pytest.raises(OneBotError, match='no ROS package "b"'):
        Resources(tmp_path / "repo/a_description").package("b")


@pytest.mark.parametrize("urdf", ["arm/urdf/v2", "urdf", "."])
def test_a_folder_of_the_packages_name_is_the_last_resort(tmp_path, urdf):
    (tmp_path / urdf).mkdir(parents=True, exist_ok=True)
    (tmp_path / "arm").mkdir(exist_ok=True)
    assert Resources(tmp_path / urdf).package("arm") == tmp_path / "arm"


def test_the_search_path_comes_first_and_its_changes_count(tmp_path, monkeypatch):
    first = _package(tmp_path / "one/deep/er/arm", "arm")
    second = _package(tmp_path / "two", "arm")
    monkeypatch.setenv("ROS_PACKAGE_PATH", f"{tmp_path / 'one'}{os.pathsep}{tmp_path / 'two'}")
    assert Resources(None).package("arm") == first
    first.rename(tmp_path / "one/moved")
    assert Resources(None).package("arm") == tmp_path / "one/moved"
    (tmp_path / "one/moved/package.xml").unlink()
    assert Resources(None).package("arm") == second


@pytest.mark.parametrize(
    ("top", "file"), [("p", "a/b/arm/package.xml"), ("p/arm", "arm/x"), ("p", "arm/x")]
)
def test_a_folder_of_the_search_path_may_have_the_name_instead(tmp_path, monkeypatch, top, file):
    at = tmp_path / "p" / file
    at.parent.mkdir(parents=True)
    at.write_text("<package><name>arm_data</name></package>")
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path / top))
    assert Resources(None).package("arm") == at.parent


def test_package_path_is_put_first_in_the_variable_that_children_inherit(tmp_path, monkeypatch):
    one, two = _package(tmp_path / "one", "arm"), _package(tmp_path / "two", "arm")
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(one))
    for _ in range(2):
        use_package_path(str(two))
    assert os.environ["ROS_PACKAGE_PATH"] == f"{two}{os.pathsep}{one}"
    assert Resources(None).package("arm") == two
    use_package_path("")
    assert os.environ["ROS_PACKAGE_PATH"] == f"{two}{os.pathsep}{one}"
    with pytest.raises(OneBotError, match="package_path:=.*there is no folder .*nowhere"):
        use_package_path(str(tmp_path / "nowhere"))


def test_a_package_that_ros_2_does_not_find_becomes_a_file(tmp_path, monkeypatch):
    path = _package(tmp_path / "path/p", "on_path")
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path / "path"))
    assert Resources(None).locate("package://on_path/a b.stl").uri == (path / "a b.stl").as_uri()


def test_a_missing_package_is_explained(tmp_path, monkeypatch):
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path / "mine"))
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "sourced"))
    with pytest.raises(OneBotError) as caught:
        Resources(tmp_path).package("qwertz")
    looked, remedy = str(caught.value).split("; ")
    assert looked.startswith('no ROS package "qwertz": looked in ROS_PACKAGE_PATH (')
    for place in ("mine", "sourced", sys.prefix, f"around {tmp_path}"):
        assert place in looked
    assert "package_path:=FOLDER" in remedy and "export ROS_PACKAGE_PATH=FOLDER" in remedy


@pytest.mark.parametrize("name", ["x" * 5000, "..", "a b", "\N{BLACK STAR}", "a\0b"])
def test_what_can_be_no_package_is_not_looked_for(name, tmp_path):
    with pytest.raises(OneBotError, match="no ROS package"):
        Resources(tmp_path).package(name)


def test_threads_link_a_checkout_at_once(tmp_path):
    """A robot and its world are read by two threads; none is left over."""
    targets = [tmp_path / "one", tmp_path / "other"] * 200
    with ThreadPoolExecutor(8) as executor:
        list(executor.map(_link, [tmp_path / "link"] * 400, targets))
    assert [path.name for path in tmp_path.iterdir()] == ["link"]
