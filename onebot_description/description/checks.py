"""Elements and attributes that URDF does not know (probable typos), names, leftovers of xacro."""

import math
import re
from collections import Counter
from collections.abc import Mapping
from pathlib import Path

from onebot_description.description.description import (
    JOINT_KINDS,
    ZERO,
    Element,
    JointSpec,
    MimicSpec,
    Report,
    Triple,
    local_name,
    read_number,
    read_numbers,
    read_triple,
)
from onebot_description.description.meshes import (
    MESH_SUFFIXES,
    is_ascii_stl,
    mesh_path,
    resolve_mesh,
)
from onebot_description.description.xml import XACRO_NAMESPACES, missing_file
from onebot_description.errors import DescriptionError, OneBotError, did_you_mean, listing

# Links and joints must make one tree: one root, one parent each, no loop.


def read_ends(
    report: Report, joints: Mapping[str, Element], links: Mapping[str, Element]
) -> dict[str, tuple[str, str]]:
    """Return the parent and child link of each joint whose ends are both known links."""
    ends = {}
    for name, joint in joints.items():
        parent = _read_end(report, joint, "parent", links)
        child = _read_end(report, joint, "child", links)
        if parent is not None and child is not None:
            if parent == child:
                report.problem(
                    joint, f'connects link "{parent}" with itself; parent or child is wrong'
                )
            else:
                ends[name] = (parent, child)
    return ends


def _read_end(report: Report, joint: Element, end: str, links: Mapping[str, Element]) -> str | None:
    element = joint.find(end)
    if element is None:
        report.problem(joint, f'has no <{end}>; write <{end} link="..."/>')
        return None
    link = element.get("link")
    if not link:
        report.problem(element, f'names no link; write <{end} link="..."/>')
        return None
    if link not in links:
        hint = did_you_mean(link, links, "links")
        report.problem(element, f'there is no link "{link}"{hint}')
        return None
    return link


def check_tree(
    report: Report,
    joints: Mapping[str, Element],
    links: Mapping[str, Element],
    ends: Mapping[str, tuple[str, str]],
) -> str:
    """Report what keeps the links from being one tree.

    Args:
        report: takes the problems.
        joints: the joint elements by name.
        links: the link elements by name.
        ends: parent and child link of each joint.

    Returns:
        The root link; "" if that cannot be said.
    """
    if not links:
        report.problem(
            report.document.root, 'has no links; write at least <link name="base_link"/>'
        )
        return ""
    above: dict[str, str] = {}  # child link -> the joint that moves it
    for joint, (_, child) in ends.items():
        if child in above:
            report.problem(
                joints[joint],
                f'link "{child}" has two parents: joint "{above[child]}" moves it already; '
                "a link hangs on one joint",
            )
        else:
            above[child] = joint
    parents = {child: ends[joint][0] for child, joint in above.items()}
    for loop in _loops(parents):
        names = " -> ".join([*loop, loop[0]])
        report.problem(
            joints[above[loop[0]]], f"the links {names} form a loop; remove one of its joints"
        )
    roots = [link for link in links if link not in parents]
    # A joint that could not be read may well be the missing connection.
    if len(roots) > 1 and len(ends) == len(report.document.root.findall("joint")):
        report.problem(
            links[roots[1]],
            f"the robot falls into {len(roots)} parts, whose roots are {listing(roots)}; "
            f'connect each with a joint, so that only "{roots[0]}" has no parent',
        )
    return roots[0] if len(roots) == 1 else ""


def _loops(parents: Mapping[str, str]) -> list[list[str]]:
    """The cycles in a map of child to parent, each from parent to child."""
    loops = []
    done: set[str] = set()
    for start in parents:
        path: list[str] = []
        on_path: set[str] = set()
        link = start
        while link in parents and link not in done and link not in on_path:
            path.append(link)
            on_path.add(link)
            link = parents[link]
        if link in on_path:
            loops.append(path[path.index(link) :][::-1])
        done.update(path)
    return loops


# Joints: kind, axis, limits and what they mimic.

_WITH_AXIS = ("revolute", "continuous", "prismatic", "planar")
_WITH_LIMIT = ("revolute", "prismatic")
_WITH_POSITION = ("revolute", "continuous", "prismatic")
_DEFAULT_AXIS: Triple = (1.0, 0.0, 0.0)
# Further than this from 1, an axis was not merely rounded when written.
_ROUNDING = 1e-3


def read_joint(
    report: Report, name: str, element: Element, ends: tuple[str, str] | None
) -> JointSpec:
    """Read one joint; what is wrong is reported and replaced by a default."""
    kind = _read_kind(report, element)
    origin = element.find("origin")
    lower, upper, velocity, effort = _read_limit(report, element, kind)
    parent, child = ends or ("", "")
    return JointSpec(
        name=name,
        kind=kind,
        parent=parent,
        child=child,
        xyz=read_triple(report, origin, "xyz") or ZERO,
        rpy=read_triple(report, origin, "rpy") or ZERO,
        axis=_read_axis(report, element, kind),
        lower=lower,
        upper=upper,
        velocity=velocity,
        effort=effort,
        mimic=_read_mimic(report, element),
    )


def _read_kind(report: Report, element: Element) -> str:
    kind = element.get("type")
    if kind is None:
        report.problem(element, f"has no type; write one of: {', '.join(JOINT_KINDS)}")
    elif kind not in JOINT_KINDS:
        hint = did_you_mean(kind, JOINT_KINDS)
        report.problem(element, f'unknown joint type "{kind}"{hint}')
    return kind if kind in JOINT_KINDS else ""


def _read_axis(report: Report, element: Element, kind: str) -> Triple:
    axis = element.find("axis")
    if axis is None:
        return _DEFAULT_AXIS
    if axis.get("xyz") is None:
        report.problem(axis, 'has no xyz; write for example <axis xyz="0 0 1"/>')
    xyz = read_triple(report, axis, "xyz")
    if xyz is None or kind not in _WITH_AXIS:
        return _DEFAULT_AXIS
    largest = max(abs(value) for value in xyz)
    if largest == 0:
        report.problem(
            axis, f'the axis of a {kind} joint cannot be zero; write for example "0 0 1"'
        )
        return _DEFAULT_AXIS
    # Scaled first, so that neither huge nor tiny numbers leave the range of a float.
    scaled = [value / largest for value in xyz]
    norm = math.hypot(*scaled)
    if abs(norm * largest - 1) > _ROUNDING:
        report.warning(axis, f"the axis has length {norm * largest:.4g}; it is taken as length 1")
    unit: Triple = (scaled[0] / norm, scaled[1] / norm, scaled[2] / norm)
    if abs(norm * largest - 1) > 1e-6:
        # Rerun turns by wrong angles about axes of another length.
        axis.set("xyz", " ".join(repr(value) for value in unit))
        return unit
    return xyz if abs(norm * largest - 1) < 1e-15 else unit


def _read_limit(
    report: Report, element: Element, kind: str
) -> tuple[float | None, float | None, float | None, float | None]:
    """Return lower, upper, velocity and effort."""
    limit = element.find("limit")
    bounded = kind in _WITH_LIMIT
    if limit is None:
        if bounded:
            report.problem(
                element,
                f"a {kind} joint needs a limit; write "
                '<limit lower="..." upper="..." effort="..." velocity="..."/>',
            )
        return (0.0, 0.0, None, None) if bounded else (None, None, None, None)
    lower = read_number(report, limit, "lower")
    upper = read_number(report, limit, "upper")
    needed = kind in _WITH_POSITION
    effort = read_number(report, limit, "effort", required=needed, negative=False)
    velocity = read_number(report, limit, "velocity", required=needed, negative=False)
    if not bounded:
        if kind == "continuous" and (lower or upper):
            report.warning(limit, "a continuous joint has no lower or upper; make it revolute")
        return None, None, velocity, effort
    low, high = lower or 0.0, upper or 0.0  # as the specification has it
    if low > high:
        report.problem(limit, f"lower {low:g} is above upper {high:g}; swap them")
    elif low == high == 0:
        report.warning(limit, "lower and upper are both 0, so the joint cannot move")
    if velocity == 0:
        report.warning(limit, "velocity is 0, so the joint cannot move")
    return low, high, velocity, effort


def _read_mimic(report: Report, element: Element) -> MimicSpec | None:
    mimic = element.find("mimic")
    if mimic is None:
        return None
    joint = mimic.get("joint")
    if not joint:
        report.problem(mimic, 'names no joint; write <mimic joint="..."/>')
        return None
    multiplier = read_number(report, mimic, "multiplier")
    offset = read_number(report, mimic, "offset")
    return MimicSpec(joint, 1.0 if multiplier is None else multiplier, offset or 0.0)


def check_mimics(
    report: Report, joints: Mapping[str, JointSpec], elements: Mapping[str, Element]
) -> None:
    """Report joints that follow nothing, themselves, a circle, or one that has no position."""
    masters = {name: joint.mimic.joint for name, joint in joints.items() if joint.mimic}
    seen: set[str] = set()
    for name, master in masters.items():
        element = elements[name].find("mimic")
        assert element is not None  # a MimicSpec was read from it
        moving = [other for other, joint in joints.items() if joint.kind in _WITH_POSITION]
        kind = joints[name].kind
        if kind and kind not in _WITH_POSITION:
            report.problem(element, f"a {kind} joint has no single position, so it cannot mimic")
        elif master == name:
            report.problem(element, "the joint mimics itself; name another joint")
        elif master not in joints:
            hint = did_you_mean(master, [other for other in moving if other != name], "joints")
            report.problem(element, f'there is no joint "{master}" to mimic{hint}')
        elif joints[master].kind and joints[master].kind not in _WITH_POSITION:
            text = f'joint "{master}" is {joints[master].kind} and has no position to mimic'
            report.problem(element, text)
        elif name not in seen and (circle := _circle(name, masters)):
            seen.update(circle)
            names = " -> ".join([*circle, name])
            report.problem(element, f"the joints {names} mimic each other in a circle")


def _circle(start: str, masters: Mapping[str, str]) -> list[str]:
    """The joints passed from ``start`` until back there; empty if the way leads elsewhere."""
    path = [start]
    visited = {start}
    while (master := masters.get(path[-1])) is not None:
        if master == start:
            return path
        if master in visited:
            return []
        path.append(master)
        visited.add(master)
    return []


# Links: mass and inertia, and one geometry in each visual and collision.

_SHAPES = ("box", "cylinder", "sphere", "mesh")
_MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
# Moments are written with few digits; a plate's are just at the limit of the triangle inequality.
_INERTIA_ROUNDING = 0.01


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
    elif greatest > (least + middle) * (1 + _INERTIA_ROUNDING):
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
    most = (xx + yy + zz) * (1 + _INERTIA_ROUNDING) / (2 + _INERTIA_ROUNDING)
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


# Materials: colours in range, and names that are defined, once.

_Look = tuple[tuple[float, ...] | None, str | None]


def check_materials(report: Report) -> None:
    """Check the robot's materials and those of its visuals."""
    shared: dict[str, _Look] = {}
    root = report.document.root
    for material in root.findall("material"):
        name, look = material.get("name"), _read_look(report, material)
        if not name:
            report.problem(material, 'has no name; write <material name="...">')
        elif look == (None, None):
            report.warning(material, "defines neither <color> nor <texture>")
        elif shared.setdefault(name, look) != look:
            report.problem(
                material, "there is another material of that name that looks different; rename one"
            )
    visuals = [visual for link in root.findall("link") for visual in link.findall("visual")]
    inline = [element for visual in visuals for element in visual.findall("material")]
    looks = [(material, _read_look(report, material)) for material in inline]
    local: dict[str, _Look] = {}
    for material, look in looks:
        _note_inline(report, material, look, shared, local)
    for material, look in looks:
        name = material.get("name")
        if look == (None, None) and name and name not in shared and name not in local:
            hint = did_you_mean(name, [*shared, *local], "materials")
            report.warning(material, f"no material of that name is defined{hint}")


def _note_inline(
    report: Report,
    material: Element,
    look: _Look,
    shared: dict[str, _Look],
    local: dict[str, _Look],
) -> None:
    """Take up a material defined inside a visual, which other visuals may use too."""
    name = material.get("name")
    if name is None:
        report.problem(material, 'has no name; write <material name="...">, if need be name=""')
    elif look == (None, None):
        if not name:
            report.warning(material, "has neither a name nor a <color>, so it does nothing")
    elif name and shared.get(name, local.get(name, look)) != look:
        report.warning(material, "a material of that name looks different elsewhere; rename one")
    elif name:
        local[name] = look


def _read_look(report: Report, material: Element) -> _Look:
    """Return the colour (red, green, blue, alpha, each 0 to 1) and the texture's file."""
    color, texture = material.find("color"), material.find("texture")
    rgba = None
    if color is not None:
        if color.get("rgba") is None:
            report.problem(color, 'has no rgba; write <color rgba="red green blue alpha"/>')
        rgba = read_numbers(report, color, "rgba", 4)
        if rgba is not None and not all(0 <= value <= 1 for value in rgba):
            report.problem(
                color, f'rgba="{color.get("rgba")}" leaves 0 to 1; divide values of 0 to 255 by 255'
            )
    filename = None if texture is None else texture.get("filename", "")
    if texture is not None and filename is not None:
        _check_texture(report, texture, filename)
    return rgba, filename


def _check_texture(report: Report, texture: Element, filename: str) -> None:
    try:
        if not filename or resolve_mesh(filename, report.document.base) is None:
            report.warning(texture, f'there is no file "{filename}"')
    except DescriptionError as error:
        report.warning(texture, str(error))


# Other programs' parts, of which nothing is known here; they may hold anything.
EXTENSIONS = frozenset(
    "gazebo transmission ros2_control sensor mujoco drake plugin contact audio_source "
    "self_collision_checking verbose calibration safety_controller loop_joint model".split()
)

# element: (children, attributes)
_SCHEMA = {
    "robot": ("link joint material", "name version"),
    "link": ("inertial visual collision", "name type"),
    "joint": ("origin parent child axis limit dynamics mimic", "name type"),
    "inertial": ("origin mass inertia", ""),
    "visual": ("origin geometry material", "name"),
    "collision": ("origin geometry", "name group concave"),
    "geometry": ("box cylinder sphere mesh", ""),
    "material": ("color texture", "name"),
    "origin": ("", "xyz rpy"),
    "mass": ("", "value"),
    "inertia": ("", "ixx ixy ixz iyy iyz izz"),
    "box": ("", "size"),
    "cylinder": ("", "radius length"),
    "sphere": ("", "radius"),
    "mesh": ("", "filename scale"),
    "color": ("", "rgba"),
    "texture": ("", "filename"),
    "parent": ("", "link"),
    "child": ("", "link"),
    "axis": ("", "xyz"),
    "limit": ("", "lower upper effort velocity acceleration jerk deceleration"),
    "dynamics": ("", "damping friction"),
    "mimic": ("", "joint multiplier offset"),
}
_SINGLE = frozenset(
    "origin geometry material mass inertia inertial parent child axis limit mimic dynamics".split()
)
_XACRO_LEFT = re.compile(r"\$\{[^}]*\}?|\$\([^)]*\)?")


def check_schema(report: Report) -> None:
    """Warn of what URDF does not know, and refuse xacro that nobody has expanded."""
    leftovers: list[tuple[Element, str]] = []
    waiting = [report.document.root]
    while waiting:
        element = waiting.pop()
        _check_attributes(report, element, leftovers)
        inside = []
        for child in element:
            if child.tag.startswith("{"):
                if child.tag[1:].split("}")[0] in XACRO_NAMESPACES:
                    leftovers.append((child, f"<xacro:{local_name(child)}>"))
            elif child.tag not in EXTENSIONS:
                _check_child(report, element, child)
                inside.append(child)
        _check_repeats(report, element)
        waiting.extend(reversed(inside))
    if leftovers:
        element, text = leftovers[0]
        more = f" and {len(leftovers) - 1} more" if len(leftovers) > 1 else ""
        report.problem(
            element,
            f"{text}{more} is xacro that was not expanded; name the file .xacro and write "
            f'<robot xmlns:xacro="{XACRO_NAMESPACES[0]}" ...>',
        )


def _check_child(report: Report, element: Element, child: Element) -> None:
    """Warn if ``child`` is not known inside ``element``."""
    if element.tag not in _SCHEMA or element.tag == "geometry":
        return  # unknown itself, so already reported, or checked with the shapes
    children = _SCHEMA[element.tag][0].split()
    if child.tag not in children:
        hint = did_you_mean(child.tag, children, "known here") if children else ""
        report.typo(child, f"unknown inside <{element.tag}>, so it is ignored{hint}")


def _check_attributes(
    report: Report, element: Element, leftovers: list[tuple[Element, str]]
) -> None:
    """Warn of unknown attributes and collect xacro expressions."""
    known = _SCHEMA[element.tag][1].split() if element.tag in _SCHEMA else None
    for name, value in element.attrib.items():
        if left := _XACRO_LEFT.search(value):
            leftovers.append((element, f'{name}="{left[0]}"'))
        if known is None or name.startswith("{") or name in known:
            continue
        if element.tag == "origin" and name == "quat_xyzw":
            report.problem(element, "quat_xyzw is not supported; write rpy in radians")
        else:
            hint = did_you_mean(name, known) if known else ""
            report.typo(element, f'unknown attribute "{name}", so it is ignored{hint}')


def _check_repeats(report: Report, element: Element) -> None:
    """Refuse second elements where only one makes sense; readers differ in which they take."""
    if element.tag not in _SCHEMA or element.tag == "robot":
        return
    for tag, count in Counter(child.tag for child in element).items():
        if tag in _SINGLE and count > 1:
            second = element.findall(tag)[1]
            report.problem(second, f"stands {count} times in {report.label(element)}; leave one")


def named(report: Report, tag: str) -> dict[str, Element]:
    """Return the robot's elements of one ``tag`` by name, reporting bad and repeated names."""
    found: dict[str, Element] = {}
    for element in report.document.root.findall(tag):
        name = element.get("name")
        if name is None or not name.strip():
            report.problem(element, f'has no name; write <{tag} name="...">')
            continue
        if re.search(r"[\s/]", name):
            report.warning(element, f'the name "{name}" holds a space or slash, which TF dislikes')
        if name in found:
            first = report.document.places.get(found[name], "above")
            report.problem(element, f"there is a {tag} of that name already, at {first}; rename it")
            continue
        found[name] = element
    return found


def check_root(report: Report) -> None:
    """Check that the document is a robot, with a name and a link.

    Raises:
        DescriptionError: it is not a robot, so that nothing else can be checked.
    """
    root = report.document.root
    if root.tag != "robot":
        found = listing(child.tag for child in root)
        report.problem(
            root, f'the outermost element must be <robot name="...">; this one holds: {found}'
        )
        report.raise_if_any()
    name = root.get("name")
    if name is None or not name.strip():
        report.problem(root, 'the robot has no name; write <robot name="...">')
