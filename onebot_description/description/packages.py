"""Where ROS packages lie, without anybody setting a variable.

The ROS wheels lay themselves into the environment's prefix as an ament prefix but leave
``AMENT_PREFIX_PATH`` unset, so ``$(find pkg)``, ``package://`` and ament_index would find nothing.
An editable install moreover holds *copies* of urdf/, config/ and the like in the prefix. Here the
checkout itself, through a prefix of symbolic links, comes first, so an edit takes effect at once.
"""

import os
import sys
import zlib
from pathlib import Path

from onebot_description.errors import OneBotError

PACKAGES = ("mrm_description", "onebot_bringup", "onebot_control", "onebot_description")
_VARIABLE = "AMENT_PREFIX_PATH"


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
    from onebot_description.errors import did_you_mean

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
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    digest = f"{zlib.crc32(str(checkout).encode()):08x}"
    prefix = cache / "onebot" / f"ament-{digest}"
    index = prefix / "share/ament_index/resource_index/packages"
    index.mkdir(parents=True, exist_ok=True)
    for name in PACKAGES:
        (index / name).touch()
        _link(prefix / "share" / name, checkout / name)
    return prefix


def _link(link: Path, target: Path) -> None:
    """Point ``link`` at ``target``; safe when several processes do so at once."""
    if link.is_symlink() and Path(os.readlink(link)) == target:
        return
    fresh = link.with_name(f".{link.name}-{os.getpid()}")
    fresh.unlink(missing_ok=True)
    fresh.symlink_to(target)
    fresh.replace(link)
