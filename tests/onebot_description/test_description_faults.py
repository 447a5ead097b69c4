"""Every kind of mistake has a robot in tests/robots that makes it, and a message on it."""

from pathlib import Path

import pytest

from onebot_description.description import (
    DescriptionError,
    describe,
    load_description,
    parse_description,
)

ROBOTS = Path(__file__).parents[1] / "robots"

# file: what its message must hold, besides the file's own name
FAULTS: dict[str, tuple[str, ...]] = {
    # the document
    "wrong_root.urdf": ("<sdf>: is a robot in SDF", "convert it to URDF"),
    "robot_without_name.urdf": (":1: <robot>", 'write <robot name="...">'),
    "malformed.urdf": (":3:3: malformed XML: mismatched tag: <link> of line 2 is",),
    "not_xml.urdf": (":1:1: is not XML", "<robot"),
    "empty.urdf": ("is empty", "<robot"),
    "binary.urdf": ("is a binary file",),
    "not_utf8.urdf": (":2: is not UTF-8", "0xdf", "save it as UTF-8"),
    "unknown_encoding.urdf": ("encoding", "klingon", "save it as UTF-8"),
    "entity_bomb.urdf": (":2: <!DOCTYPE> and entities are refused",),
    "external_entity.urdf": (":2: <!DOCTYPE> and entities are refused",),
    "namespace_with_brace.urdf": (':1: the namespace "${b}"',),
    "deep.urdf": ("nested deeper than 100",),
    # the tree
    "no_links.urdf": ("has no links", '<link name="base_link"/>'),
    "two_roots.urdf": ("2 parts", "roots are arm, base", "connect"),
    "loop.urdf": ("arm -> hand -> arm form a loop", "remove one"),
    "only_a_loop.urdf": ("form a loop",),
    "joint_to_itself.urdf": ('joint "knot"', 'link "base" with itself'),
    "two_parents.urdf": ('joint "c"', 'link "hand" has two parents', 'joint "b"'),
    "duplicate_link.urdf": (":4: link", "already, at", "duplicate_link.urdf:3", "rename"),
    "duplicate_joint.urdf": (":7: joint", "already, at", "duplicate_joint.urdf:6", "rename"),
    "link_without_name.urdf": (":4: <link>: has no name",),
    "joint_without_name.urdf": (":5: <joint>: has no name",),
    "unknown_parent.urdf": ('no link "base_lnik"', 'mean "base_link"?', "links: arm, base_link"),
    "unknown_child.urdf": ('no link "link_1"', 'mean "link1"?', "links: base_link, link1"),
    "missing_parent.urdf": ('joint "hip": has no <parent>', '<parent link="..."/>'),
    "missing_child.urdf": ('joint "hip": has no <child>', '<child link="..."/>'),
    "parent_without_link.urdf": ("names no link", '<parent link="..."/>'),
    "misspelt_joint.urdf": ("2 parts", ':5: jiont "hip"', 'mean "joint"?'),
    # joints
    "joint_without_type.urdf": ('joint "hip": has no type', "revolute, continuous"),
    "unknown_joint_type.urdf": ('"continous"', 'mean "continuous"?'),
    "revolute_without_limit.urdf": ("revolute joint needs a limit", "<limit lower="),
    "prismatic_without_limit.urdf": ("prismatic joint needs a limit", "<limit lower="),
    "limit_without_effort.urdf": ("<limit>: has no effort",),
    "limit_without_velocity.urdf": ("<limit>: has no velocity",),
    "lower_above_upper.urdf": ("lower 2 is above upper -1", "swap"),
    "negative_velocity.urdf": ('velocity="-1" is negative',),
    "negative_effort.urdf": ('effort="-3" is negative',),
    "infinite_limit.urdf": ("-inf is not a finite number", "inf is not a finite number"),
    "two_limits.urdf": (":9: joint", "<limit>: stands 2 times", "leave one"),
    "zero_axis.urdf": ("<axis>", "cannot be zero", '"0 0 1"'),
    "axis_without_xyz.urdf": ("<axis>: has no xyz",),
    "too_few_numbers.urdf": ('<origin>: xyz="0 0" holds 2; it takes 3',),
    "too_many_numbers.urdf": ('rpy="0 0 0 1" holds 4; it takes 3',),
    "no_numbers.urdf": ("holds 0; it takes 3",),
    "numbers_with_commas.urdf": ("commas", "spaces"),
    "not_a_number.urdf": ('"1m" is not a number',),
    "nan_origin.urdf": ("nan is not a finite number",),
    "huge_number.urdf": ("1e999 is too large",),
    "quaternion_origin.urdf": ("quat_xyzw is not supported", "rpy"),
    "mimic_missing_joint.urdf": ('no joint "hipp" to mimic',),
    "mimic_itself.urdf": ("mimics itself",),
    "mimic_without_joint.urdf": ("names no joint", '<mimic joint="..."/>'),
    "mimic_by_fixed.urdf": ("a fixed joint has no single position",),
    "mimic_of_fixed.urdf": ('joint "a" is fixed and has no position to mimic',),
    "mimic_circle.urdf": ("a -> b -> a mimic each other",),
    "mimic_bad_multiplier.urdf": ('"twice" is not a number',),
    # links
    "negative_mass.urdf": ('<mass>: value="-1" is negative',),
    "missing_mass.urdf": ("<inertial>: has no <mass>",),
    "mass_without_value.urdf": ("<mass>: has no value",),
    "missing_inertia.urdf": ("<inertial>: has no <inertia>",),
    "inertia_lacks_izz.urdf": ("<inertia>: has no izz",),
    "negative_inertia.urdf": ('iyy="-1" is negative',),
    "no_geometry.urdf": ("<visual>: has no <geometry>", "box, cylinder, sphere, mesh"),
    "empty_geometry.urdf": ("<geometry>: is empty", "box, cylinder, sphere, mesh"),
    "two_shapes.urdf": ("holds 2 shapes (box, sphere)", "second <visual>"),
    "unknown_shape.urdf": ("<cyclinder>: unknown shape", 'mean "cylinder"?'),
    "box_without_size.urdf": ("<box>: has no size",),
    "negative_size.urdf": ('size="1 -1 1" is negative',),
    "negative_radius.urdf": ('radius="-1" is negative',),
    "cylinder_without_length.urdf": ("<cylinder>: has no length",),
    "negative_length.urdf": ('length="-2" is negative',),
    "infinite_radius.urdf": ("inf is not a finite number",),
    "mesh_without_file.urdf": ("<mesh>: names no file", "package://"),
    "missing_mesh.urdf": ("cubes.stl", "no such file", 'mean "cube.stl"?'),
    "missing_mesh_package.urdf": ('no ROS package "onebot_descripton"', "onebot_description"),
    "mesh_from_network.urdf": ("nothing is fetched from the network", "package://"),
    "mesh_from_model.urdf": ("model:// is not loaded", "package://"),
    "mesh_two_slashes.urdf": ("three slashes",),
    "mesh_unsupported.urdf": ('"cube.step" is of an unsupported kind', ".dae, .glb"),
    "empty_mesh.urdf": ('"empty.stl" is an empty file',),
    "mesh_scale_of_one_number.urdf": ('scale="0.001" holds 1; it takes 3',),
    # materials
    "material_redefined.urdf": (':4: material "red"', "looks different", "rename"),
    "visual_material_without_name.urdf": ("<visual> <material>: has no name",),
    "material_without_name.urdf": ("<material>: has no name",),
    "rgba_of_255.urdf": ("leaves 0 to 1", "divide"),
    "rgba_of_three.urdf": ("holds 3; it takes 4",),
    "color_without_rgba.urdf": ("<color>: has no rgba",),
    # xacro that was not expanded, or cannot be
    "unexpanded_property.urdf": ('name="${side}" is xacro', "name the file .xacro"),
    "unexpanded_argument.urdf": ('name="$(arg side)" is xacro', "name the file .xacro"),
    "xacro_undeclared.urdf": (":2:3:", "used but not declared", "<robot xmlns:xacro="),
}

WARNINGS: dict[str, str] = {
    "warn_limits_zero.urdf": "lower and upper are both 0",
    "warn_velocity_zero.urdf": "velocity is 0",
    "warn_long_axis.urdf": "length 5; it is taken as length 1",
    "warn_continuous_limit.urdf": "turns without end, so lower and upper are ignored; delete them",
    "warn_deepracer.xacro": "turns without end, so lower and upper are ignored; delete them",
    "warn_names.urdf": '"base link" holds a space',
    "warn_unknown_elements.urdf": 'mean "visual"?',
    "warn_unknown_attribute.urdf": 'attribute "uper", so it is ignored (did you mean "upper"?',
    "warn_mass_zero.urdf": "mass is 0",
    "warn_inertia_zero.urdf": "inertia is zero",
    "warn_inertia_indefinite.urdf": "not positive definite",
    "warn_inertia_triangle.urdf": "exceeds the sum of the others",
    "warn_size_zero.urdf": "is zero; sizes are in m",
    "warn_scale_flattens.urdf": "flattens the mesh",
    "warn_material_undefined.urdf": 'mean "orange"?',
    "warn_material_differs.urdf": "looks different elsewhere",
    "warn_material_empty.urdf": "neither a name nor a <color>",
    "warn_texture_missing.urdf": 'no file "wood.png"',
}


# Of these nothing can be published; of the others of FAULTS nodes take what is left.
REFUSED = set(
    "wrong_root malformed not_xml empty binary not_utf8 unknown_encoding entity_bomb deep "
    "external_entity namespace_with_brace no_links loop only_a_loop joint_to_itself two_parents "
    "duplicate_link duplicate_joint link_without_name joint_without_name unknown_parent "
    "unknown_child missing_parent missing_child parent_without_link joint_without_type "
    "unknown_joint_type zero_axis too_few_numbers too_many_numbers no_numbers numbers_with_commas "
    "not_a_number nan_origin huge_number quaternion_origin xacro_undeclared".split()
)


@pytest.mark.parametrize("name", FAULTS)
def test_fault_is_explained(name: str) -> None:
    """The message names the file and holds every fragment that its reader needs.

    Nodes refuse only what cannot be published; of the rest they take what is left.
    """
    description = None
    with pytest.raises(DescriptionError) as caught:
        description = load_description(ROBOTS / name)
        assert describe(description)
        description.raise_problems()
    assert (description is None) == (Path(name).stem in REFUSED)
    message = str(caught.value)
    assert caught.value.problems and message.startswith("\n".join(caught.value.problems))
    missing = [part for part in FAULTS[name] if part not in message]
    assert not missing and name in message, message


@pytest.mark.parametrize("name", WARNINGS)
def test_warning_is_given(name: str) -> None:
    """What works but is probably not meant loads, with a warning that has file and line."""
    description = load_description(ROBOTS / name)
    warnings = description.warnings
    assert any(WARNINGS[name] in text for text in warnings), warnings
    assert all(f"{name}:" in text for text in warnings)
    assert description.problems == ()


def test_every_robot_is_in_a_table() -> None:
    """No test robot lies about unused: each is in a table or good."""
    robots = {path.name for path in ROBOTS.iterdir() if path.suffix in (".urdf", ".xacro")}
    good = {name for name in robots if name.startswith(("good_", "xacro_"))}
    others = good | {"broken_everywhere.urdf", "diff_drive.urdf"}
    assert robots - others == {*FAULTS, *WARNINGS} - others


@pytest.mark.parametrize("name", sorted(p.name for p in ROBOTS.glob("good_*")))
def test_good_robot_loads_without_warning(name: str) -> None:
    """Good robots give no warnings, and what they expand to is as good as they are."""
    description = load_description(ROBOTS / name)
    assert description.notices == ()
    again = parse_description(description.urdf, str(ROBOTS / name))
    assert again.urdf == description.urdf
    assert (again.links, again.joints) == (description.links, description.joints)


def test_all_problems_come_at_once() -> None:
    """One run reports every problem of a robot that is broken everywhere."""
    with pytest.raises(DescriptionError) as caught:
        load_description(ROBOTS / "broken_everywhere.urdf").raise_problems()
    parts = ("<mass>", "<inertia>", '"big"', '"revolut"', '"bas"', 'xyz="0 1" holds 2')
    assert len(caught.value.problems) == len(parts)
    for part in parts:
        assert any(part in problem for problem in caught.value.problems), part


@pytest.mark.parametrize(
    ("source", "part"),
    [
        (ROBOTS, "is a folder"),
        (ROBOTS / "good_mimik_chain.urdf", 'mean "good_mimic_chain.urdf"?'),
        (ROBOTS / "nowhere" / "a.urdf", "there is no folder"),
        ("", "name a .urdf or .xacro file"),
        ("a\0b.urdf", "cannot be read"),
        ("x" * 5000, "cannot be read"),
        ("package://onebot_descripton/urdf/a.urdf", 'mean "onebot_description"?'),
        ("package://onebot_description", "package://<package>/<path>"),
    ],
)
def test_source_that_is_no_file(source: str | Path, part: str) -> None:
    """A source that leads to no file is explained, with the files that are there."""
    with pytest.raises(DescriptionError) as caught:
        load_description(source)
    assert part in str(caught.value)


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("", "is empty"),
        ("  \n", "is empty"),
        ("<robot name='\ud800'/>", "character that is none"),
        ("<robot name='a'><link name='base'/><oops></robot>", "<string>:1:"),
        (
            "<robot name='a' xmlns:xacro='http://www.ros.org/wiki/xacro'><link name='b'/>"
            "<xacro:wheel/></robot>",
            "<xacro:wheel> is xacro that was not expanded",
        ),
        (
            "<robot name='a'><link name='b'><visual><geometry><mesh filename='c.stl'/>"
            "</geometry></visual></link></robot>",
            "lies in no folder",
        ),
    ],
)
def test_text_that_is_no_robot(text: str, part: str) -> None:
    """Text is checked like a file; what needs a folder or xacro says so."""
    with pytest.raises(DescriptionError) as caught:
        parse_description(text).raise_problems()
    assert part in str(caught.value)
