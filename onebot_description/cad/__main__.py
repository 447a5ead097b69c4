"""``python -m onebot_description.cad``: writes what config/dimensions.yaml describes."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from onebot_description.ament import package_share
from onebot_description.errors import OneBotError

_NEEDS = "the CAD needs manifold3d: pip install 'onebot[cad]'"


def main(args: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m onebot_description.cad",
        description="Writes meshes/*.dae and config/inertials.yaml from config/dimensions.yaml.",
    )
    parser.add_argument("--dimensions", type=Path, help="another file of dimensions")
    parser.add_argument("--output", type=Path, help="another folder than the package's own")
    given = parser.parse_args(args)
    try:
        _write(given.dimensions, given.output)
    except OneBotError as error:
        print(error, file=sys.stderr)
        return 1
    return 0


def _write(dimensions: Path | None, output: Path | None) -> None:
    try:
        from onebot_description.cad.robot import write_robot
    except ModuleNotFoundError as error:
        raise OneBotError(_NEEDS if error.name == "manifold3d" else str(error)) from error
    share = package_share("onebot_description")
    for path, note in write_robot(
        dimensions or share / "config/dimensions.yaml", output or share
    ).items():
        print(f"{path.resolve()}: {note}")


if __name__ == "__main__":
    sys.exit(main())
