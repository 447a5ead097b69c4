"""The sizes of shapes, and warnings of what is in another unit than meters."""

import struct
from pathlib import Path

import pytest

from onebot_description.description import describe, load_description, parse_description
from onebot_description.description.unit_check import shape_sizes, size_warnings
from onebot_description.elements.packages import package_share

CHECKOUT = Path(__file__).resolve().parents[2]
ROBOTS = sorted(CHECKOUT.glob("tests/robots/good_*")) + [
    CHECKOUT / "tests/robots/diff_drive.urdf",
    package_share("mrm_description") / "urdf/mrm.xacro",
    *(package_share("onebot_description") / "urdf").glob("onebot.*"),
    *(package_share("onebot_description") / "worlds").glob("*.urdf.xacro"),
]
WHEELS = "".join(
    f'<link name="w{y}"><visual><geometry><sphere radius="0.0{y}"/></geometry></visual></link>'
    f'<joint name="j{y}" type="continuous"><parent link="base"/><child link="w{y}"/></joint>'
    for y in (5, 6)
)


def robot(shape: str, parts: str = WHEELS) -> str:
    base = f"<link name='base'>\n<visual><geometry>{shape}</geometry></visual></link>"
    return f"<robot name='r'>{base}{parts}</robot>"


def warned(urdf: str) -> list[str]:
    description = parse_description(urdf, "r")
    return size_warnings(description, shape_sizes(description)[0])


@pytest.mark.parametrize("file", ROBOTS, ids=lambda file: file.name)
def test_good_robots_and_worlds_have_no_size_warnings(file: Path) -> None:
    description = load_description(file)
    assert size_warnings(description, shape_sizes(description)[0]) == []


@pytest.mark.parametrize(
    ("urdf", "text"),
    [
        (robot('<box size="400 300 100"/>', ""), "400 x 300 x 100 m large; is it in millimeters?"),
        (robot('<box size="40 30 10"/>'), 'link "base": its box is 40 x 30 x 10 m large; is it in'),
        (robot('<box size="15 1 1"/>'), "15 x 1 x 1 m large, over 100 times the other shapes; is"),
        (robot('<box size="1 1 1"/>', WHEELS.replace("<child", '<origin xyz="0 90 -150"/><child')),
         'joint "j5": its <origin> is 174.9 m away; is it in millimeters? lengths are in m'),
    ],
)  # fmt: skip
def test_what_is_not_in_meters(urdf: str, text: str) -> None:
    assert text in warned(urdf)[0]
    assert warned(urdf)[0].startswith("r:")


def test_a_large_world_and_a_small_part_are_no_mistakes() -> None:
    assert warned(robot('<box size="50 50 0.1"/>', "")) == []
    assert warned(robot('<box size="0.0001 0.0001 0.0001"/>')) == []


def test_a_mesh_in_millimeters(tmp_path: Path) -> None:
    corners = (0, 0, 0, 400, 0, 0, 0, 300, 100)
    (tmp_path / "base.stl").write_bytes(bytes(80) + struct.pack("<I12fH", 1, 0, 0, 1, *corners, 0))
    shape = f'<mesh filename="file://{tmp_path}/base.stl"/>'
    description = parse_description(robot(shape))
    assert "base.stl 400×300×100" in describe(description, shape_sizes(description)[0])
    [warning] = warned(robot(shape))
    assert "its mesh is 400 x 300 x 100 m large" in warning and 'write scale="0.001 0.0' in warning
    assert warned(robot(shape.replace("/>", ' scale="0.001 0.001 0.001"/>'))) == []


@pytest.mark.parametrize(
    ("element", "warned"),
    [
        ('<origin rpy="90 0 0"/>', "90 is more than a turn; angles are in rad: if it is in deg"),
        ('<origin rpy="0 -6.29 6.2832"/>', ""),
        ('<limit lower="-180" upper="90" effort="1" velocity="1"/>', "in degrees, write 3.142"),
        ('<limit lower="-6.98" upper="6.98" effort="1" velocity="1"/>', ""),
    ],
)  # fmt: skip
def test_angles_in_degrees(element: str, warned: str) -> None:
    limit = "" if "<limit" in element else '<limit lower="-1" upper="1" effort="1" velocity="1"/>'
    ends = '<parent link="a"/><child link="b"/>'
    urdf = f'<joint name="j" type="revolute">{ends}{element}{limit}</joint>'
    description = parse_description(
        f'<robot name="r"><link name="a"/><link name="b"/>{urdf}</robot>'
    )
    assert [warned in text for text in description.warnings] == ([True] if warned else [])
