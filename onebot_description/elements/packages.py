"""Finds packages and files: ``package://``, ``$(find pkg)``, ``file://`` and paths.

Nothing is fetched from the network, and no variable has to be set. A package is searched for, in
this order:

- in the folders of ``ROS_PACKAGE_PATH``, to which ``package_path:=`` prepends its own
- where packages are installed: the prefixes of ``AMENT_PREFIX_PATH`` and of this environment
- in the source tree around the file that names it

The ROS wheels install themselves into the environment's prefix as an ament prefix, but leave
``AMENT_PREFIX_PATH`` unset, so ``$(find pkg)``, ``package://`` and ament_index would find nothing.
Moreover, an editable install puts *copies* of urdf/, config/ and the like into the prefix. Here the
checkout itself comes first, through a prefix of symbolic links, so edits take effect immediately.
"""

import contextlib
import functools
import os
import re
import sys
import threading
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple
from urllib.parse import unquote, urlsplit

from onebot_description.errors import OneBotError, shortened

PACKAGES = ("mrm_description", "onebot_bringup", "onebot_control", "onebot_description")
PACKAGE_PATH = "package_path"  # the argument of commands
_VALID = re.compile(r"\w[\w.-]{0,199}", re.ASCII)
_NAME = re.compile(r"<name\s*>\s*([^<\s]+)\s*</name\s*>")  # the name in a package.xml
_COMMENT = re.compile(r"<!--.*?-->", re.DOTALL)
_ROS_PATH = "ROS_PACKAGE_PATH"
_AMENT_PATH = "AMENT_PREFIX_PATH"
_LEVELS = 4  # folders below a searched one, which may be a whole home folder
_INDEX = "share/ament_index/resource_index/packages"  # below a prefix
_NO_SOURCES = ("build", "node_modules", "__pycache__")


class Resource(NamedTuple):
    """The file that a URI leads to, whether or not it exists."""

    path: Path
    # For other programs, which do not know the folder of the description: package:// if the package
    # is installed, otherwise file://.
    uri: str


class Resources:
    """Resolves the URIs of one description; each folder is searched for packages once."""

    def __init__(self, folder: Path | None) -> None:
        self._folder = folder
        self._packages: dict[str, Path | str] = {}  # folder by name, or why there is none
        self._below: dict[Path, dict[str, Path]] = {}  # packages by name, in and below a folder

    def locate(self, uri: str) -> Resource:
        """Return the file that ``package://name/path``, ``file:///path`` or a path names.

        Raises:
            OneBotError: it names no file; the text says what to write.
        """
        try:
            scheme = urlsplit(uri).scheme
            if scheme == "package":
                return self._in_package(uri)
            if scheme == "file":
                return _in_file_system(uri)
        except ValueError as error:
            raise OneBotError(f'"{uri}": {error}') from None
        if scheme:
            raise OneBotError(
                f'"{uri}": {scheme}:// is not supported; '
                "write package://<package>/<path>, file:///<path> or a path"
            )
        if self._folder is None and not uri.startswith("/"):
            raise OneBotError(
                f'"{uri}" is relative, but this text is in no folder; '
                "write package://<package>/<path> or an absolute path"
            )
        path = _existing(self._folder or Path(), uri)
        return Resource(path, _file_uri(path))

    def _in_package(self, uri: str) -> Resource:
        name, _, inner = uri.partition("://")[2].partition("/")
        folder = self.package(name)
        path = _existing(folder, inner.lstrip("/"))
        is_known = folder == _in_index(name) and "\\" not in inner
        return Resource(path, uri if is_known else _file_uri(path))

    def package(self, name: str) -> Path:
        """Return the folder of a ROS package, installed or in a source tree.

        Raises:
            OneBotError: there is no such package; the text lists the searched places.
        """
        if name not in self._packages:
            self._packages[name] = self._find(name) or str(_missing(name, self._folder))
        package = self._packages[name]
        if isinstance(package, str):
            raise OneBotError(package)
        return package

    def _find(self, name: str) -> Path | None:
        if not _VALID.fullmatch(name):
            return None
        source = self._on_ros_path(name) or _in_index(name)
        return source or (None if self._folder is None else self._around(name, self._folder))

    def _on_ros_path(self, name: str) -> Path | None:
        """Return the package ``name`` in ROS_PACKAGE_PATH, or else a folder of that name."""
        tops = [Path(entry) for entry in _entries(_ROS_PATH)]
        below = [folder for top in tops for folder in self._packages_below(top).values()]
        near = [folder for top in tops for folder in (top, top / name)]
        first = self._first(name, tops, near + below)
        return first and first.resolve()

    def _first(self, name: str, tops: list[Path], folders: list[Path]) -> Path | None:
        """Return the package ``name`` in or below ``tops``, or else the folder of that name."""
        packages = (below[name] for top in tops if name in (below := self._packages_below(top)))
        named = (folder for folder in folders if folder.name == name and os.path.isdir(folder))
        return next(packages, None) or next(named, None)

    def _around(self, name: str, folder: Path) -> Path | None:
        """Return the package in the source tree around ``folder``: above it, or beside those.

        A package without package.xml is found by the name of its folder.
        """
        above = (folder, *folder.parents)
        for source in (source for parent in above for source in (parent, parent / name)):
            if package_name(source) == name:
                return source
        # The nearest folder comes first: a tree may hold several robots.
        folders = [*above, folder / name, folder.parent / name]
        return self._first(name, _source_tree(folder), folders)

    def _packages_below(self, top: Path) -> dict[str, Path]:
        """Return the packages in and below ``top``, by name; of equal names, the nearest one."""
        if top not in self._below:
            packages: dict[str, Path] = {}
            folders = [top]
            for _ in range(_LEVELS + 1):
                for folder in folders:
                    packages.setdefault(package_name(folder), folder)
                folders = [child for folder in folders for child in _folders_in(folder)]
            packages.pop("", None)
            self._below[top] = packages
        return self._below[top]


def resolve(uri: str, folder: Path | None) -> Path:
    """Return the path of ``uri``, which is relative to ``folder``; see ``Resources.locate``."""
    return Resources(folder).locate(uri).path


def _in_file_system(uri: str) -> Resource:
    # Without urlsplit, because people write # and ? as parts of the path.
    host, slash, inner = uri.partition(":")[2].removeprefix("//").partition("/")
    if host not in ("", "localhost") or not slash:
        raise OneBotError(f'"{uri}": write file:///<absolute path>, with three slashes')
    path = _existing(Path("/"), unquote(inner), inner)
    return Resource(path, uri if Path(unquote(urlsplit(uri).path)) == path else _file_uri(path))


def _existing(folder: Path, *names: str) -> Path:
    """Return the file in ``folder`` that a URI means by one of ``names``; the first if none exists.

    Exporters write %20 as well as spaces, and on Windows backslashes.
    """
    meant = [*names, *map(unquote, names)]
    paths = [folder / name for name in (*meant, *(name.replace("\\", "/") for name in meant))]
    return next((path for path in paths if os.path.exists(path)), paths[0])


def _file_uri(path: Path) -> str:
    try:
        return path.resolve().as_uri()
    except (OSError, RuntimeError, ValueError):  # an impossible path, such as a loop of links
        return str(path)


# --- packages -----------------------------------------------------------------------------------


def use_package_path(folders: str) -> None:
    """Search ``folders`` (joined by ``:``) for packages first, here and in child processes."""
    paths = [Path(entry).expanduser().absolute() for entry in folders.split(os.pathsep) if entry]
    for folder in paths:
        if not folder.is_dir():
            raise OneBotError(f"{PACKAGE_PATH}:={folders}: there is no folder {folder}")
    present = [entry for entry in _entries(_ROS_PATH) if Path(entry) not in paths]
    if paths:
        os.environ[_ROS_PATH] = os.pathsep.join([*map(str, paths), *present])


def use_environment_prefix() -> None:
    """Put this environment's prefix (and a checkout's) on ``AMENT_PREFIX_PATH``.

    A prefix that the user has sourced, such as a colcon workspace's install folder, stays ahead of
    the environment's own, as an overlay should. Calling it again changes nothing.
    """
    ours = _own_prefixes()
    other_entries = [entry for entry in _entries(_AMENT_PATH) if entry not in ours]
    os.environ[_AMENT_PATH] = os.pathsep.join(other_entries + ours)


def use_source_packages(file: Path) -> None:
    """Put ``ROS_PACKAGE_PATH``'s packages, and that of ``file``, on ``AMENT_PREFIX_PATH``, too.

    ``get_package_share_directory`` then returns the folder of a package that is not built. One that
    is installed or sourced takes precedence.
    """
    use_environment_prefix()
    folders = (*packages_on_ros_path().values(), *reversed(file.resolve().parents))
    packages = {
        name: folder.resolve()
        for folder in folders
        if _VALID.fullmatch(name := package_name(folder)) and _in_index(name) is None
    }
    if packages:
        os.environ[_AMENT_PATH] += f"{os.pathsep}{_linked_prefix(packages)}"


def packages_on_ros_path() -> dict[str, Path]:
    """Return the packages in and below the folders of ``ROS_PACKAGE_PATH``, by name.

    Such a folder, or a folder directly in it, without package.xml is a package named like itself.
    """
    return _packages_below_all(tuple(_entries(_ROS_PATH)))


@functools.cache
def _packages_below_all(tops: tuple[str, ...]) -> dict[str, Path]:
    resources = Resources(None)
    packages: dict[str, Path] = {}
    for top in reversed([Path(top) for top in tops]):
        packages |= {folder.name: folder for folder in (*_folders_in(top), top)}
        packages |= resources._packages_below(top)
    return packages


def package_share(name: str) -> Path:
    """Return the share folder of the installed ROS package ``name``."""
    share = _in_index(name)
    if share is None:
        raise _missing(name, None)
    return share


def _entries(variable: str) -> list[str]:
    return [entry for entry in os.environ.get(variable, "").split(os.pathsep) if entry]


def _own_prefixes() -> list[str]:
    prefixes = (_checkout_prefix(), Path(sys.prefix))
    return [str(prefix) for prefix in prefixes if prefix is not None]


def _in_index(name: str) -> Path | None:
    """Return the share folder of a package in an ament index; None if there is none."""
    use_environment_prefix()
    for prefix in _entries(_AMENT_PATH):
        if os.path.isfile(f"{prefix}/{_INDEX}/{name}"):
            # Resolved, so that messages name the checkout's file and not a link to it.
            return (Path(prefix) / "share" / name).resolve()
    return None


def _source_tree(folder: Path) -> list[Path]:
    """Return the folders from ``folder`` up to the outermost repository, src or package parent."""
    above = [folder, *folder.parents]
    tops = [
        at
        for at, parent in enumerate(above[:-1])
        if parent.name == "src"
        or os.path.exists(parent / ".git")
        or (at and os.path.isfile(above[at - 1] / "package.xml"))
    ]
    return above[: tops[-1] + 1] if tops else []


def _folders_in(folder: Path) -> list[Path]:
    """Return the folders in ``folder`` that may contain sources, sorted."""
    try:
        with os.scandir(folder) as entries:
            return sorted(
                Path(entry.path)
                for entry in entries
                if not entry.name.startswith(".")
                and entry.name not in _NO_SOURCES
                and entry.is_dir()
            )
    except OSError:
        return []


def package_name(folder: Path) -> str:
    """Return the package's name from the package.xml in ``folder``; "" if there is none."""
    file = folder / "package.xml"
    if not file.is_file():  # a FIFO would never end
        return ""
    try:
        text = file.read_text(errors="replace")
    except OSError:
        return ""
    # No XML parser: this runs in the import finder of ``ros.packages``, possibly while Python is
    # importing a module that the parser needs.
    match = _NAME.search(_COMMENT.sub("", text))
    return match[1] if match else ""


def _missing(name: str, folder: Path | None) -> OneBotError:
    """Return the error about a missing package: the searched places, and what to set."""
    ours = _own_prefixes()
    installed = [entry for entry in _entries(_AMENT_PATH) if entry not in ours]
    path = os.environ.get(_ROS_PATH) or "not set"
    around = "" if folder is None else f" and around {folder}"
    return OneBotError(
        f'no ROS package "{shortened(name)}": looked in {_ROS_PATH} ({path}), '
        f"{_AMENT_PATH} ({os.pathsep.join([*installed, sys.prefix])}){around}; "
        f"name a folder that contains it: {PACKAGE_PATH}:=FOLDER, or export {_ROS_PATH}=FOLDER"
    )


# --- the checkout -------------------------------------------------------------------------------


def _checkout_prefix() -> Path | None:
    """Return a prefix of links to the checkout that this module is in; None when installed."""
    checkout = Path(__file__).resolve().parents[2]
    if not all((checkout / name / "package.xml").is_file() for name in PACKAGES):
        return None
    return _linked_prefix({name: checkout / name for name in PACKAGES})


def _linked_prefix(packages: Mapping[str, Path]) -> Path:
    """Return a prefix that has a link to each package."""
    key = "".join(f"{name} {folder}\n" for name, folder in packages.items())
    prefix = cache_folder() / f"ament-{zlib.crc32(os.fsencode(key)):08x}"
    index = prefix / _INDEX
    index.mkdir(parents=True, exist_ok=True)
    for name, folder in packages.items():
        (index / name).touch()
        _link(prefix / "share" / name, folder)
    return prefix


def cache_folder() -> Path:
    """Return a folder for cached files: below HOME, or else among the temporary files."""
    with contextlib.suppress(OSError, RuntimeError):  # there is no home, or it is read-only
        home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
        folder = Path(home, "onebot")
        folder.mkdir(parents=True, exist_ok=True)
        if os.access(folder, os.W_OK):
            return folder
    import tempfile  # slow to import

    user = os.getuid() if hasattr(os, "getuid") else 0  # on Windows 0 owns each file
    folder = Path(tempfile.gettempdir(), f"onebot-{user}")
    with contextlib.suppress(OSError):
        folder.mkdir(mode=0o700, exist_ok=True)
        if folder.stat().st_uid == user:  # not a folder prepared by another user
            return folder
    raise OneBotError(f"neither ~/.cache nor {folder} can be written; set XDG_CACHE_HOME")


def _link(link: Path, target: Path) -> None:
    """Point ``link`` at ``target``; safe if several processes and threads do so concurrently."""
    if link.is_symlink() and Path(os.readlink(link)) == target:
        return
    fresh = link.with_name(f".{link.name}-{os.getpid()}-{threading.get_ident()}")
    fresh.unlink(missing_ok=True)
    fresh.symlink_to(target)
    fresh.replace(link)
