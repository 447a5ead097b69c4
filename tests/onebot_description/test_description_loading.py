"""Loading: values read, xacro arguments, files watched, repeated and parallel calls."""

import shutil
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

from onebot_description.description import (
    DescriptionError,
    Joint,
    load_description,
    parse_description,
)
from onebot_description.elements.urdf import Box, Cylinder, Geometry, Inertial, Link
from onebot_description.geometry.poses import Origin

ROBOTS = Path(__file__).parents[1] / "robots"
CUBE = ROBOTS / "meshes" / "cube.stl"


def joints(name: str, **arguments: str) -> dict[str, Joint]:
    """Return the joints of a test robot by name."""
    return {joint.name: joint for joint in load_description(ROBOTS / name, arguments).joints}


_EVERYTHING = """<robot name="r">
<material name="grey"><color rgba=".5 .5 .5 1"/></material>
<link name="a"><inertial><origin xyz="0 0 1"/><mass value="2"/>
<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>
<visual><geometry><box size="1 2 3"/></geometry><material name="grey"/></visual>
<collision><origin rpy="0 0 1"/><geometry><cylinder radius=".1" length=".2"/></geometry></collision>
<contact><lateral_friction value="0.7"/></contact></link>
<link name="b"/>
<joint name="j" type="revolute"><parent link="a"/><child link="b"/><dynamics damping=".1"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/>
<safety_controller k_velocity="1" soft_upper_limit=".5"/></joint>
</robot>"""


def test_links_and_joints_are_read_whole() -> None:
    description = parse_description(_EVERYTHING, "r.urdf")
    a, b = description.links
    assert a.inertial == Inertial(Origin((0, 0, 1)), 2.0, (1, 0, 0, 1, 0, 1))
    assert a.visuals == (Geometry(Box((1, 2, 3)), Origin(), (0.5, 0.5, 0.5, 1.0)),)
    assert a.collisions == (Geometry(Cylinder(0.1, 0.2), Origin(rpy=(0, 0, 1))),)
    assert (a.friction, a.where, a.collisions[0].where) == (0.7, "r.urdf:3", "r.urdf:6")
    assert b == Link("b", (), (), None, None)
    [joint] = description.joints
    assert (joint.soft_lower, joint.soft_upper) == (None, 0.5)
    assert (joint.damping, joint.friction, joint.where) == (0.1, 0.0, "r.urdf:9")


@pytest.mark.parametrize(
    ("good", "bad", "words"),
    [
        ('soft_upper_limit=".5"', 'soft_upper_limit="x"', ["r.urdf:11", '"x" is not a finite']),
        ('damping=".1"', 'damping="nan"', ["r.urdf:9", '"nan" is not a finite number']),
        ('value="0.7"', 'value="high"', ["r.urdf:7", 'link "a"', "<lateral_friction>"]),
    ],
)
def test_numbers_of_extensions_that_are_used_must_be_numbers(good, bad, words) -> None:
    """The problem names the line, whoever would have used the number."""
    [problem] = parse_description(_EVERYTHING.replace(good, bad), "r.urdf").problems
    assert all(word in problem for word in words), problem


def test_what_is_wrong_is_left_out() -> None:
    text = _EVERYTHING.replace('size="1 2 3"', 'size="1 2"').replace('lower="-1"', 'lower="low"')
    description = parse_description(text.replace('mass value="2"', "mass"), "r.urdf")
    assert (description.root_link, description.link_names) == ("a", ("a", "b"))
    assert (description.joints[0].lower, description.joints[0].effort) == (None, 1.0)
    link = description.links[0]
    assert (link.visuals, len(link.collisions), link.inertial) == ((), 1, None)
    assert len(description.problems) == 3 and link.left_out[0] in description.problems
    assert link.left_out[0].startswith('r.urdf:5: link "a" <visual> <geometry> <box>: size="1 2":')


def test_what_reads_descriptions_is_light() -> None:
    code = (
        "import sys; from onebot_description.description import load_description;"
        f"load_description({str(ROBOTS / 'good_meshes.urdf')!r});"
        f"load_description({str(ROBOTS / 'good_arguments.xacro')!r});"
        "heavy = ('numpy', 'rclpy', 'lxml', 'trimesh', 'yourdfpy', 'onebot_bringup');"
        "print([name for name in heavy if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_xacro_arguments_includes_and_yaml() -> None:
    assert joints("good_arguments.xacro")["left"].origin.xyz == (0.0, 0.2, 0.0)
    assert joints("good_arguments.xacro", sides="4")["left"].origin.xyz == (0.0, 0.1, 0.0)
    assert "mast" in joints("good_arguments.xacro", extra="true")
    names = ("good_arguments.xacro", "xacro_part_wheel.xacro", "xacro_sizes.yaml")
    files = load_description(ROBOTS / "good_arguments.xacro").files
    assert files == tuple(ROBOTS / name for name in names)


def test_unknown_argument_is_refused() -> None:
    with pytest.raises(
        DescriptionError, match=r'"sids" \(did you mean "sides"\? declared: extra, '
    ):
        load_description(ROBOTS / "good_arguments.xacro", {"sids": "3"})
    with pytest.raises(DescriptionError, match="plain URDF and takes no arguments.*sides"):
        load_description(ROBOTS / "good_all_kinds.urdf", {"sides": "3"})


def test_argument_used_but_not_declared_may_be_given() -> None:
    path = ROBOTS / "xacro_argument_without_value.xacro"
    assert load_description(path, {"sied": "left"}).link_names == ("left_wheel",)


def _xacro_file(folder: Path, *lines: str) -> Path:
    """A xacro file of a link "base" whose lines these are, from line 2 on."""
    path = folder / "robot.xacro"
    head = '<robot name="a" xmlns:xacro="http://www.ros.org/wiki/xacro">'
    path.write_text("\n".join([head, *lines, '<link name="base"/></robot>']))
    return path


def test_xacro_warnings_are_collected(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """What xacro would print becomes a warning with the file's name."""
    include = '<xacro:include filename="parts/*.xacro"/>'
    path = _xacro_file(tmp_path, include, "${xacro.warning('wheels are small')}")
    warnings = load_description(path).warnings
    assert any("matched no files" in text for text in warnings)
    assert any("robot.xacro: xacro: wheels are small" in text for text in warnings)
    assert capfd.readouterr() == ("", "")


def test_optional_include_may_be_missing(tmp_path: Path) -> None:
    path = _xacro_file(tmp_path, '<xacro:include filename="none.xacro" optional="true"/>')
    assert load_description(path).link_names == ("base",)


def test_namespace_and_encoding_do_not_reach_other_readers() -> None:
    from lxml import etree

    urdf = load_description(ROBOTS / "good_default_namespace.urdf").urdf
    root = etree.fromstring(urdf)
    assert root.tag == "robot" and root[0].tag == "link"


def test_extensions_of_other_programs_stay() -> None:
    urdf = load_description(ROBOTS / "good_extensions.urdf").urdf
    for part in ("<transmission ", "<ros2_control ", "<text>${kept}</text>", "/dev/ttyUSB0"):
        assert part in urdf


def _xacro_problem(folder: Path, *lines: str) -> str:
    """The one problem of a ``_xacro_file``, without its name."""
    path = _xacro_file(folder, *lines)
    with pytest.raises(DescriptionError) as caught:
        load_description(path)
    (problem,) = caught.value.problems
    return problem.replace(f"{path}:", "")


def _macro(name: str, body: str = "<a/>") -> str:
    return f'<xacro:macro name="{name}">{body}</xacro:macro>'


@pytest.mark.parametrize(
    ("lines", "found"),
    [
        (
            ['<xacro:property name="radius" value="1"/>', '<link name="${radus}"/>'],
            "3: cannot evaluate ${radus}: 'radus' is not defined",
        ),
        ([_macro("wheel"), "<xacro:whel/>"], "3: xacro: unknown macro name: xacro:whel"),
        (
            [
                _macro("m1", '<a b="${y}"/>'),
                *(_macro(f"m{n}", f"<xacro:m{n - 1}/>") for n in (2, 3, 4, 5)),
                "<xacro:m5/>",
            ],
            "2 (called at 3, from 4, from 5): cannot evaluate ${y}",
        ),
        (['<link name="${[1][3]}"/>'], "2: cannot evaluate ${[1][3]}: list index out of range"),
        (
            ['<link name="$(arg side)"/>'],
            '2: argument "side" has no value here (declared: none); give side:=<value>, or '
            'declare <xacro:arg name="side" default="..."/> above',
        ),
        (
            ['<xacro:include filename="robot.xacr"/>'],
            'robot.xacr: no such file (did you mean "robot.xacro"?',
        ),
        (['<xacro:include filename="robot.xacro"/>'], "refers to itself endlessly"),
        (['<xacro:if value="maybe"/>'], '2: xacro: Xacro conditional "maybe"'),
        (['<link name="$(find onebot_descripton)"/>'], '2: no ROS package "onebot_descripton"'),
        (
            [_macro("m", '<link name="base"/>'), "<xacro:m/>"],
            '4: link "base": there already is a link of that name, at 2 (called at 3); rename',
        ),
        ([_macro("m", "<xacro:m/>"), "<xacro:m/>"], "refers to itself endlessly"),
        (
            [_macro("m", '<a b="${1' + "+1" * 20_000 + '}"/>'), "<xacro:m/>"],
            "2 (called at 3): this expression is nested too deeply, or refers to itself",
        ),
    ],
)
def test_what_xacro_raises_is_explained(tmp_path: Path, lines: list[str], found: str) -> None:
    problem = _xacro_problem(tmp_path, *lines)
    if found[0].isdigit():
        assert problem.startswith(found)
    else:
        assert found in problem


def test_an_argument_in_the_root_is_given(tmp_path: Path) -> None:
    """Its default stands below, and cannot be moved above (UR, Kinova)."""
    path = tmp_path / "robot.xacro"
    head = '<robot name="$(arg name)" xmlns:xacro="http://www.ros.org/wiki/xacro">'
    path.write_text(f'{head}<xacro:arg name="name" default="ur"/><link name="base"/></robot>')
    with pytest.raises(DescriptionError, match='"name" has no value here; give name:=<value>'):
        load_description(path)
    assert load_description(path, {"name": "ur5e"}).robot_name == "ur5e"


def test_text_that_names_a_file_has_its_folder(tmp_path: Path) -> None:
    shutil.copy(ROBOTS / "meshes" / "cube.stl", tmp_path)
    shape = '<geometry><mesh filename="cube.stl"/></geometry>'
    text = f'<robot name="a"><link name="b"><visual>{shape}</visual></link></robot>'
    path = tmp_path / "robot.urdf"
    path.write_text(text)
    description = parse_description(text, str(path))
    assert description.files == (path,)
    assert load_description(path).files == (path,)
    assert load_description(path).source == str(path)
    [problem] = parse_description(text, "robot.urdf of another folder").problems
    assert "is in no folder" in problem


def test_the_published_text_carries_what_finds_its_files(tmp_path: Path) -> None:
    arm, hand = tmp_path / "repo/arm", tmp_path / "repo/parts/folder"
    for folder, name in ((arm / "urdf", "arm_description"), (hand, "hand_description")):
        folder.mkdir(parents=True)
        root = arm if folder == arm / "urdf" else hand
        (root / "package.xml").write_text(f"<package><name>{name}</name></package>")
        shutil.copy(CUBE, folder / "a cube.stl")
    uris = {
        "a cube.stl": (arm / "urdf/a cube.stl").as_uri(),
        str(CUBE): CUBE.as_uri(),
        f"file:{CUBE}": f"file:{CUBE}",
        "package://onebot_description/meshes/wheel.dae": (
            "package://onebot_description/meshes/wheel.dae"
        ),
        "package://arm_description/urdf/a cube.stl": (arm / "urdf/a cube.stl").as_uri(),
        "package://hand_description/a cube.stl": (hand / "a cube.stl").as_uri(),
        "file://$(find hand_description)/a cube.stl": f"file://{hand}/a cube.stl",
    }
    visuals = "".join(
        f'<visual><geometry><mesh filename="{uri}"/></geometry></visual>' for uri in uris
    )
    xacro = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'
    path = arm / "urdf/r.xacro"
    path.write_text(f'<robot name="r" {xacro}><link name="a">{visuals}</link></robot>')
    description = load_description(path)
    assert description.problems == description.warnings == ()
    root = ElementTree.fromstring(description.urdf)
    assert [mesh.get("filename") for mesh in root.iter("mesh")] == [*uris.values()]
    # Whoever has only the text finds the same files.
    for again in (description, parse_description(description.urdf)):
        shapes = [visual.shape for visual in again.links[0].visuals]
        assert [shape.uri for shape in shapes] == [*uris.values()]
        assert all(shape.path.is_file() and shape.scale == (1.0, 1.0, 1.0) for shape in shapes)


def test_a_missing_package_is_one_problem_and_refuses_nothing(tmp_path: Path) -> None:
    meshes = "".join(
        f"<{part}><geometry>"
        f'<mesh filename="package://no_such_package/{part}{number}.stl"/></geometry></{part}>'
        for part in ("visual", "collision")
        for number in range(20)
    )
    path = tmp_path / "r.urdf"
    path.write_text(f'<robot name="r"><link name="a">{meshes}</link></robot>')
    description = load_description(path)
    [problem] = description.problems
    assert problem.startswith(
        f'{path}:1: link "a" <visual> <geometry> <mesh>: 40 meshes: no ROS package "no_such_pack'
    )
    assert f"around {tmp_path};" in problem and "package_path:=FOLDER" in problem
    assert "package://no_such_package/visual7.stl" in description.urdf
