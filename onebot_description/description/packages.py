"""Where packages and files lie: ``package://``, ``$(find pkg)``, ``file://`` and paths.

Nothing is fetched from the network, and nobody has to set a variable.
The ROS wheels lay themselves into the environment's prefix as an ament prefix but leave
``AMENT_PREFIX_PATH`` unset, so ``$(find pkg)``, ``package://`` and ament_index would find nothing.
An editable install moreover holds *copies* of urdf/, config/ and the like in the prefix. Here the
checkout itself, through a prefix of symbolic links, comes first, so an edit takes effect at once.
"""

import contextlib
import os
import sys
import zlib
from pathlib import Path
from urllib.parse import unquote, urlsplit

from onebot_description.errors import OneBotError, did_you_mean

PACKAGES = ("mrm_description", "onebot_bringup", "onebot_control", "onebot_description")
_VARIABLE = "AMENT_PREFIX_PATH"


def resolve(uri: str, folder: Path | None) -> Path:
    """Return the path of the file that ``uri`` names, whether or not it is there.

    Args:
        uri: ``package://name/path``, ``file:///path`` or a path.
        folder: of the file that names it, where relative paths start; None for text in no file.

    Raises:
        OneBotError: it names no file; the message begins with ``uri`` and says what to write.
    """
    scheme = _scheme(uri)
    try:
        if scheme == "package":
            return _in_package(uri, folder)
        if scheme == "file":
            return _in_file_system(uri)
    except ValueError as error:
        raise OneBotError(f'"{uri}": {error}') from None
    if scheme:
        network = scheme in ("http", "https", "ftp")
        raise OneBotError(
            f'"{uri}": {scheme}:// is not loaded; '
            f"{'nothing is fetched from the network; ' if network else ''}"
            "write package://<package>/<path>, file:///<path> or a path"
        )
    if folder is None and is_relative(uri):
        raise OneBotError(
            f'"{uri}" is relative, but this text lies in no folder; '
            "write package://<package>/<path> or an absolute path"
        )
    return Path(uri) if folder is None else folder / uri


def is_relative(uri: str) -> bool:
    """Whether ``uri`` is a path that starts from some folder."""
    return not _scheme(uri) and not uri.startswith("/")


def _scheme(uri: str) -> str:
    """The scheme of ``uri`` in lower case, "" if it is a path."""
    scheme, colon, _ = uri.partition(":")
    # One letter is a drive of another system, and a slash before the colon makes it a path.
    is_scheme = colon and len(scheme) > 1 and scheme.isascii() and scheme.isalnum()
    return scheme.lower() if is_scheme else ""


def _in_package(uri: str, folder: Path | None) -> Path:
    name, _, inner = uri.partition("://")[2].partition("/")
    if not name or not inner:
        raise OneBotError(f'"{uri}" must read package://<package>/<path>')
    try:
        return find_package(name, folder) / inner
    except OneBotError as error:
        raise OneBotError(f'"{uri}": {error}') from None


def _in_file_system(uri: str) -> Path:
    parts = urlsplit(uri)
    if parts.netloc not in ("", "localhost") or not parts.path.startswith("/"):
        raise OneBotError(f'"{uri}" must read file:///<absolute path>, with three slashes')
    return Path(unquote(parts.path))


def find_package(name: str, folder: Path | None = None) -> Path:
    """Return the share folder of a ROS package, installed or being worked on.

    Args:
        name: the package.
        folder: where it is asked for; if no installed package has that name, this folder, one of
            its parents, or a folder beside those may be the package's source.

    Raises:
        OneBotError: there is no such package; the message lists near names.
    """
    try:
        return package_share(name)
    except OneBotError:
        for parent in () if folder is None else (folder, *folder.parents):
            for source in (parent, parent / name):
                if source.name == name and (source / "package.xml").is_file():
                    return source
        raise


def use_environment_prefix() -> None:
    """Put this environment's prefix (and a checkout's) on ``AMENT_PREFIX_PATH``.

    A prefix the user has sourced (such as a colcon workspace's install folder) stays, ahead of the
    environment's own, as an overlay is meant to. Calling it again changes nothing.
    """
    ours = [str(prefix) for prefix in (_checkout_prefix(), Path(sys.prefix)) if prefix is not None]
    present = [entry for entry in os.environ.get(_VARIABLE, "").split(os.pathsep) if entry]
    others = [entry for entry in present if entry not in ours]
    os.environ[_VARIABLE] = os.pathsep.join(others + ours)


def package_share(name: str) -> Path:
    """Return the share folder of the ROS package ``name``.

    Raises:
        OneBotError: no prefix holds a package of that name; the message lists near names.
    """
    use_environment_prefix()
    for prefix in os.environ[_VARIABLE].split(os.pathsep):
        if (Path(prefix) / "share/ament_index/resource_index/packages" / name).is_file():
            # Resolved, so that messages name the checkout's file and not a link to it.
            return (Path(prefix) / "share" / name).resolve()
    raise OneBotError(f'no ROS package "{name}"{did_you_mean(name, package_names())}')


def package_names() -> list[str]:
    """Return the names of all ROS packages that can be found, sorted."""
    use_environment_prefix()
    names: set[str] = set()
    for prefix in os.environ[_VARIABLE].split(os.pathsep):
        index = Path(prefix) / "share/ament_index/resource_index/packages"
        if index.is_dir():
            names.update(entry.name for entry in index.iterdir())
    return sorted(names)


def _checkout_prefix() -> Path | None:
    """A prefix of links to the checkout this module was imported from; None when installed."""
    checkout = Path(__file__).resolve().parents[2]
    if not all((checkout / name / "package.xml").is_file() for name in PACKAGES):
        return None
    digest = f"{zlib.crc32(os.fsencode(checkout)):08x}"
    prefix = cache_folder() / f"ament-{digest}"
    index = prefix / "share/ament_index/resource_index/packages"
    index.mkdir(parents=True, exist_ok=True)
    for name in PACKAGES:
        (index / name).touch()
        _link(prefix / "share" / name, checkout / name)
    return prefix


def cache_folder() -> Path:
    """Return a folder for files that can be made again: below HOME, or beside temporary files.

    Raises:
        OneBotError: neither can be written.
    """
    with contextlib.suppress(OSError, RuntimeError):  # no home, or one that cannot be written
        home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
        folder = Path(home, "onebot")
        folder.mkdir(parents=True, exist_ok=True)
        if os.access(folder, os.W_OK):
            return folder
    import tempfile  # slow to import

    folder = Path(tempfile.gettempdir(), f"onebot-{os.getuid()}")
    with contextlib.suppress(OSError):
        folder.mkdir(mode=0o700, exist_ok=True)
        if folder.stat().st_uid == os.getuid():  # and not a trap of another user's
            return folder
    raise OneBotError(f"neither ~/.cache nor {folder} can be written; set XDG_CACHE_HOME")


def _link(link: Path, target: Path) -> None:
    """Point ``link`` at ``target``; safe when several processes do so at once."""
    if link.is_symlink() and Path(os.readlink(link)) == target:
        return
    fresh = link.with_name(f".{link.name}-{os.getpid()}")
    fresh.unlink(missing_ok=True)
    fresh.symlink_to(target)
    fresh.replace(link)
