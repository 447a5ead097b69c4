"""Links: mass and inertia, and one geometry in each visual and collision."""

from pathlib import Path

from onebot_description.description.meshes import (
    MESH_SUFFIXES,
    is_ascii_stl,
    mesh_path,
    resolve_mesh,
)
from onebot_description.description.reading import missing_file
from onebot_description.description.report import Element, Report
from onebot_description.description.values import read_number, read_numbers, read_triple
from onebot_description.errors import DescriptionError, OneBotError
from onebot_description.text import did_you_mean, listing

_SHAPES = ("box", "cylinder", "sphere", "mesh")
_MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
# Moments are written with few digits; a plate's are just at the limit of the triangle inequality.
_ROUNDING = 0.01


def check_link(report: Report, link: Element) -> None:
    """Check everything inside one link but its materials."""
    inertial = link.find("inertial")
    if inertial is not None:
        _check_origin(report, inertial)
        _check_mass(report, inertial)
        _check_inertia(report, inertial)
    for part in link:
        if part.tag in ("visual", "collision"):
            _check_origin(report, part)
            _check_geometry(report, part)


def _check_origin(report: Report, element: Element) -> None:
    origin = element.find("origin")
    read_triple(report, origin, "xyz")
    read_triple(report, origin, "rpy")


def _check_mass(report: Report, inertial: Element) -> None:
    mass = inertial.find("mass")
    if mass is None:
        report.problem(inertial, 'has no <mass>; write <mass value="..."/>, in kg')
        return
    if read_number(report, mass, "value", required=True, negative=False) == 0:
        report.warning(mass, "the mass is 0; a simulation takes a base of mass 0 for fixed")


def _check_inertia(report: Report, inertial: Element) -> None:
    inertia = inertial.find("inertia")
    if inertia is None:
        report.problem(
            inertial, 'has no <inertia>; write ixx="..." iyy="..." izz="..." and the rest'
        )
        return
    values = {
        name: read_number(
            report, inertia, name, required=True, negative=name not in ("ixx", "iyy", "izz")
        )
        for name in _MOMENTS
    }
    xx, xy, xz, yy, yz, zz = (values[name] for name in _MOMENTS)
    if xx is None or xy is None or xz is None or yy is None or yz is None or zz is None:
        return
    largest = max(map(abs, (xx, xy, xz, yy, yz, zz)))
    if largest == 0:
        report.warning(inertia, "the inertia is zero; a simulation cannot turn such a link")
        return
    matrix = tuple(value / largest for value in (xx, xy, xz, yy, yz, zz))
    if _is_positive_definite(*matrix) and _is_positive_definite(*_room(*matrix)):
        return
    import numpy as np  # only now: it takes longer to import than all that is done here

    xx, xy, xz, yy, yz, zz = matrix
    least, middle, greatest = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    if least <= 0:
        text = f"the inertia is not positive definite (least moment {least * largest:.3g} kg m2)"
        report.warning(inertia, f"{text}; no real body has such moments")
    elif greatest > (least + middle) * (1 + _ROUNDING):
        moments = ", ".join(f"{value * largest:.3g}" for value in (least, middle, greatest))
        report.warning(
            inertia, f"of the moments {moments} one exceeds the sum of the others; no body has such"
        )


def _is_positive_definite(xx: float, xy: float, xz: float, yy: float, yz: float, zz: float) -> bool:
    """Whether a symmetric matrix is, by Sylvester's criterion: its leading minors are positive."""
    second = xx * yy - xy * xy
    third = xx * (yy * zz - yz * yz) - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz)
    return xx > 0 and second > 0 and third > 0


def _room(
    xx: float, xy: float, xz: float, yy: float, yz: float, zz: float
) -> tuple[float, float, float, float, float, float]:
    """Return t - M, which is positive definite if no moment exceeds the sum of the others.

    a <= (b + c) (1 + r), and with the trace T, a <= (T - a) (1 + r): a <= T (1 + r) / (2 + r) = t.
    """
    most = (xx + yy + zz) * (1 + _ROUNDING) / (2 + _ROUNDING)
    return most - xx, -xy, -xz, most - yy, -yz, most - zz


def _check_geometry(report: Report, part: Element) -> None:
    geometry = part.find("geometry")
    known = f"one of: {', '.join(_SHAPES)}"
    if geometry is None:
        report.problem(part, f"has no <geometry>; it takes {known}")
        return
    for shape in geometry:
        if shape.tag not in _SHAPES:
            report.problem(shape, f"unknown shape{did_you_mean(str(shape.tag), _SHAPES)}")
    if len(geometry) == 0:
        report.problem(geometry, f"is empty; it takes {known}")
    elif len(geometry) > 1:
        shapes = listing(str(shape.tag) for shape in geometry)
        report.problem(
            geometry,
            f"holds {len(geometry)} shapes ({shapes}); it takes one; "
            f"give the link a second <{part.tag}>",
        )
    for shape in geometry:
        _check_shape(report, shape, collision=part.tag == "collision")


def _check_shape(report: Report, shape: Element, *, collision: bool) -> None:
    if shape.tag == "mesh":
        _check_mesh(report, shape, collision=collision)
        _check_scale(report, shape)
    elif shape.tag == "box":
        if shape.get("size") is None:
            report.problem(shape, 'has no size; write size="x y z", in m')
        _check_size(report, shape, "size", read_triple(report, shape, "size"))
    elif shape.tag in ("cylinder", "sphere"):
        for attribute in ("radius", "length")[: 1 if shape.tag == "sphere" else 2]:
            value = read_number(report, shape, attribute, required=True)
            _check_size(report, shape, attribute, None if value is None else (value,))


def _check_size(
    report: Report, shape: Element, attribute: str, values: tuple[float, ...] | None
) -> None:
    if values is None:
        return
    written = f'{attribute}="{shape.get(attribute)}"'
    if min(values) < 0:
        report.problem(shape, f"{written} is negative; sizes are in m and above 0")
    elif min(values) == 0:
        report.warning(shape, f"{written} is zero; sizes are in m and above 0")


def _check_scale(report: Report, mesh: Element) -> None:
    scale = read_numbers(report, mesh, "scale", 3)
    if scale is not None and min(scale) <= 0:
        report.warning(mesh, f'scale="{mesh.get("scale")}" flattens or mirrors the mesh')


def _check_mesh(report: Report, mesh: Element, *, collision: bool) -> None:
    uri = mesh.get("filename")
    if not uri:
        report.problem(mesh, 'names no file; write filename="package://<package>/<path>"')
        return
    base = report.document.base
    try:
        path = resolve_mesh(uri, base) or mesh_path(uri, base)
        if not path.is_file():
            report.problem(mesh, f'mesh "{uri}": {missing_file(path)}')
            return
        _check_mesh_file(report, mesh, path, collision=collision)
    except DescriptionError as error:
        report.problem(mesh, str(error))
    except OneBotError as error:
        report.problem(mesh, f'mesh "{uri}": {error}')
    except (OSError, ValueError) as error:
        report.problem(mesh, f'mesh "{uri}" cannot be read: {error}')


def _check_mesh_file(report: Report, mesh: Element, path: Path, *, collision: bool) -> None:
    suffix = path.suffix.lower()
    name = path.name
    if suffix not in MESH_SUFFIXES:
        known = ", ".join(MESH_SUFFIXES)
        report.problem(
            mesh, f'mesh "{name}" is of an unsupported kind; convert it to one of: {known}'
        )
    elif path.stat().st_size == 0:
        report.problem(mesh, f'mesh "{name}" is an empty file; export it again')
    elif collision and suffix in (".glb", ".gltf"):
        report.warning(
            mesh, f'"{name}": PyBullet reads no {suffix} for collision; use .stl or .obj'
        )
    elif collision and suffix == ".stl" and is_ascii_stl(path):
        report.warning(
            mesh, f'"{name}" is an ASCII STL, which PyBullet ignores; export it as binary STL'
        )
