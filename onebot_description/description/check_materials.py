"""Materials: colours in range, and names that are defined, once."""

from onebot_description.description.meshes import resolve_mesh
from onebot_description.description.report import Element, Report
from onebot_description.description.values import read_numbers
from onebot_description.errors import DescriptionError
from onebot_description.text import did_you_mean

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
