"""``python -m onebot_description.cad``: writes meshes and inertials of config/dimensions.yaml."""

import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import yaml

from onebot_description.elements.packages import package_share
from onebot_description.errors import OneBotError
from onebot_description.model.rigid_bodies import Body
from onebot_description.parameters.bounded_yaml import load, read_text

try:
    from onebot_description.cad.base import make_base
    from onebot_description.cad.collada import to_collada
    from onebot_description.cad.solids import Part
    from onebot_description.cad.wheels import make_caster_wheel, make_fork, make_wheel
except ModuleNotFoundError as error:
    if error.name != "manifold3d":
        raise
    sys.exit("the CAD needs manifold3d: pip install 'onebot-robots[cad]'")


_HEADER = """\
# Written by `python -m onebot_description.cad` from dimensions.yaml: do not edit.
# mass in kg; center of mass in m, in the link's frame; moments about it in kg m2.
"""


def read_dimensions(path: Path) -> SimpleNamespace:
    """Read config/dimensions.yaml: m, kg, kg/m3; colors are sRGB, 0 to 1."""
    dimensions: SimpleNamespace = _attributes(load(read_text(path)))
    return dimensions


def _attributes(value: Any) -> Any:
    """Return a map with its keys as attributes, and other values as they are."""
    if not isinstance(value, dict):
        return value
    return SimpleNamespace(**{key: _attributes(item) for key, item in value.items()})


def make_parts(dimensions: SimpleNamespace) -> tuple[Part, ...]:
    """Return the robot's parts."""
    makers = (make_base, make_wheel, make_fork, make_caster_wheel)
    return tuple(make(dimensions) for make in makers)


def write_robot(source: Path, folder: Path) -> None:
    """Write meshes and inertials into ``folder``, and print their files."""
    dimensions = read_dimensions(source)
    inertials = {}
    files = {}
    for part in make_parts(dimensions):
        files[f"meshes/{part.name}.dae"] = to_collada(part, dimensions.colors)
        inertials[part.name] = _as_mapping(part.inertial)
    files["config/inertials.yaml"] = (_HEADER + yaml.safe_dump(inertials, sort_keys=False)).encode()
    for name, data in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
        print(f"{path.resolve()}: {len(data) / 1000:.0f} kB")


def _as_mapping(body: Body) -> dict[str, object]:
    """Return mass, center and moments, rounded so that they are the same on every machine."""
    moments = zip(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), body.inertial.inertia, strict=True)
    return {
        "mass": round(body.mass, 8),
        "center": [round(value, 8) + 0.0 for value in body.center.tolist()],
        **{name: round(moment, 12) + 0.0 for name, moment in moments},
    }


def main() -> int:
    """Run the command and return its exit code."""
    share = package_share("onebot_description")
    file = share / "config/dimensions.yaml"
    try:
        write_robot(file, share)
    except (AttributeError, OneBotError, yaml.YAMLError) as error:
        print(f"{file}: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
