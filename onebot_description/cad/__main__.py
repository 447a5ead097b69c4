"""``python -m onebot_description.cad``: writes meshes and inertials of config/dimensions.yaml."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import yaml

from onebot_description.elements.packages import package_share
from onebot_description.errors import OneBotError

try:
    from onebot_description.cad.base import make_base
    from onebot_description.cad.caster import make_caster_wheel, make_fork
    from onebot_description.cad.collada import to_collada
    from onebot_description.cad.dimensions import Dimensions, read_dimensions
    from onebot_description.cad.primitives import MassProperties, Part
    from onebot_description.cad.wheel import make_wheel
except ModuleNotFoundError as error:
    if error.name != "manifold3d":
        raise
    sys.exit("the CAD needs manifold3d: pip install 'onebot-robots[cad]'")


_HEADER = """\
# Written by `python -m onebot_description.cad` from dimensions.yaml: do not edit.
# mass in kg; center of mass in m, in the link's frame; moments about it in kg m2.
"""


def make_parts(dimensions: Dimensions) -> tuple[Part, ...]:
    """Return the robot's parts."""
    makers = (make_base, make_wheel, make_fork, make_caster_wheel)
    return tuple(make(dimensions) for make in makers)


def write_robot(source: Path, folder: Path) -> dict[Path, str]:
    """Write meshes and inertials into ``folder``; return a comment on each file."""
    dimensions = read_dimensions(source)
    parts = make_parts(dimensions)
    written = {}
    for part in parts:
        data = to_collada(part, dimensions.colors)
        path = folder / "meshes" / f"{part.name}.dae"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
        written[path] = f"{len(data) / 1000:.0f} kB, {part.inertial.mass:.4f} kg"
    path = folder / "config" / "inertials.yaml"
    path.parent.mkdir(parents=True, exist_ok=True)
    inertials = {part.name: _as_mapping(part.inertial) for part in parts}
    path.write_text(_HEADER + yaml.safe_dump(inertials, sort_keys=False), encoding="utf-8")
    written[path] = "mass, centre of mass and inertia of each part"
    return written


def _as_mapping(inertial: MassProperties) -> dict[str, object]:
    axes = {"x": 0, "y": 1, "z": 2}
    moments = {
        # Rounded, so that the result is the same on every machine.
        f"i{a}{b}": round(float(inertial.inertia[axes[a], axes[b]]), 12) + 0.0
        for a, b in ("xx", "xy", "xz", "yy", "yz", "zz")
    }
    center = [round(float(value), 8) + 0.0 for value in inertial.center]
    return {"mass": round(inertial.mass, 8), "center": center, **moments}


def main(args: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m onebot_description.cad",
        description="Writes meshes/*.dae and config/inertials.yaml from config/dimensions.yaml.",
    )
    parser.add_argument("--dimensions", type=Path, help="another file of dimensions")
    parser.add_argument("--output", type=Path, help="another folder than the package's own")
    arguments = parser.parse_args(args)
    share = package_share("onebot_description")
    source = arguments.dimensions or share / "config/dimensions.yaml"
    try:
        written = write_robot(source, arguments.output or share)
    except OneBotError as error:
        print(error, file=sys.stderr)
        return 1
    for path, note in written.items():
        print(f"{path.resolve()}: {note}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
