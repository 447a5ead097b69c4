"""Worlds that robots can be put into: those that ship, by name, and others by their files."""

from pathlib import Path

from onebot_description.description.description import Description
from onebot_description.description.loading import load_description
from onebot_description.description.packages import package_share
from onebot_description.errors import OneBotError, did_you_mean

_ENDING = ".urdf.xacro"


def load_world(world: str) -> Description:
    """Read and check the description of a world.

    It is named by its name, such as "maze", if it ships; else as ``load_description`` has it.
    """
    worlds = shipped_worlds()
    if world in worlds:
        return load_description(worlds[world])
    if "/" not in world and "." not in world and not Path(world).is_file():
        raise OneBotError(
            f'no world "{world}"{did_you_mean(world, worlds, "those that ship")}; write one of '
            "these, or the path of a URDF or xacro file"
        )
    description = load_description(world)
    description.require_tree()
    return description


def shipped_worlds() -> dict[str, Path]:
    """Return the files of the worlds that ship, by name."""
    files = (package_share("onebot_description") / "worlds").glob(f"*{_ENDING}")
    return {file.name.removesuffix(_ENDING): file for file in sorted(files)}
