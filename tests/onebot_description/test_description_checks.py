"""Each check reports once, with line and element, and accepts what is only nearly wrong."""

import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onebot_description.description import DescriptionError, Mimic, parse_description

ROBOTS = Path(__file__).parents[1] / "robots"
CUBE = ROBOTS / "meshes" / "cube.stl"
ENDLESS = "a continuous joint turns endlessly, so lower and upper are ignored; delete them"
LIMIT = '<limit lower="-1" upper="1" effort="1" velocity="1"/>'


def problems(text):
    """All problems of a text, without the name it is given."""
    with pytest.raises(DescriptionError) as caught:
        parse_description(text, "r").raise_problems()
    assert all(problem.startswith("r:") for problem in caught.value.problems)
    return [problem[2:] for problem in caught.value.problems]


def warnings(text):
    """All warnings of a text that has no problem."""
    description = parse_description(text, "r")
    assert description.problems == ()
    return [warning.removeprefix("r:") for warning in description.warnings]


def assert_begin(found, starts):
    assert len(found) == len(starts), found
    assert all(map(str.startswith, found, starts)), found


def joint(inside=LIMIT, kind="revolute"):
    """A robot of one joint; ``inside`` of it stands in line 4."""
    return (
        '<robot name="r"><link name="a"/>\n<link name="b"/>\n'
        f'<joint name="j" type="{kind}"><parent link="a"/><child link="b"/>\n'
        f"{inside}</joint></robot>"
    )


def link(inside, base=""):
    """A robot of one link; ``inside`` of it stands in line 3."""
    return f'<robot name="r">{base}\n<link name="a">\n{inside}</link></robot>'


def visual(shape):
    return link(f"<visual><geometry>{shape}</geometry></visual>")


def inertial(mass='<mass value="1"/>', **moments):
    values = {"ixx": 1, "ixy": 0, "ixz": 0, "iyy": 1, "iyz": 0, "izz": 1, **moments}
    written = " ".join(f'{name}="{value!r}"' for name, value in values.items())
    return link(f"<inertial>{mass}<inertia {written}/></inertial>")


def robot(*lines):
    """A robot whose parts stand in lines 2, 3, ..."""
    return '<robot name="r">\n' + "\n".join(lines) + "\n</robot>"


def hinge(name, parent, child, inside=LIMIT, kind="revolute"):
    ends = f'<parent link="{parent}"/><child link="{child}"/>'
    return f'<joint name="{name}" type="{kind}">{ends}{inside}</joint>'


# ---------------------------------------------------------------------------------------- joints


def _limit(lower="-1", upper="1", effort="1", velocity="1"):
    values = {"lower": lower, "upper": upper, "effort": effort, "velocity": velocity}
    given = (f'{name}="{value}"' for name, value in values.items() if value is not None)
    return f"<limit {' '.join(given)}/>"


@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
@pytest.mark.parametrize(
    ("limit", "found"),
    [
        (_limit("1", "1"), (1.0, 1.0, 1.0, 1.0)),
        (_limit(None, "0.5"), (0.0, 0.5, 1.0, 1.0)),
        (_limit(effort="0"), (-1.0, 1.0, 0.0, 1.0)),
        (_limit(velocity="1e-300"), (-1.0, 1.0, 1.0, 1e-300)),
    ],
)
def test_limits_that_are_fine(kind, limit, found):
    description = parse_description(joint(limit, kind), "r")
    (read,) = description.joints
    assert (read.lower, read.upper, read.effort, read.velocity) == found
    assert description.warnings == ()


@pytest.mark.parametrize(
    ("limit", "kind", "texts"),
    [
        (_limit("0", "0"), "revolute", ["lower and upper are both 0, so the joint cannot move"]),
        (_limit(None, None), "prismatic", ["lower and upper are both 0, so the joint cannot move"]),
        (
            _limit(velocity="0"),
            "revolute",
            ["velocity is 0, so the joint cannot move; the simulation takes 0 for no limit"],
        ),
        (_limit(None, "1"), "continuous", [ENDLESS]),
        (_limit("0", "0"), "continuous", []),
        ("<limit/>", "fixed", []),
        ("", "continuous", []),
    ],
)
def test_limits_that_are_hardly_meant(limit, kind, texts):
    starts = [f'4: joint "j" <limit>: {text}' for text in texts]
    assert_begin(warnings(joint(limit, kind)), starts)


@pytest.mark.parametrize("kind", ["continuous", "floating", "planar", "fixed"])
def test_kinds_without_limits_have_none(kind):
    (read,) = parse_description(joint(_limit(), kind)).joints
    assert (read.lower, read.upper, read.velocity, read.effort) == (None, None, 1.0, 1.0)


@pytest.mark.parametrize("length", [0.9989, 1.0011, 2.0, 1e-200])
def test_axes_of_another_length_are_a_warning(length):
    (warning,) = warnings(joint(f'<axis xyz="0 0 {-length!r}"/>{LIMIT}'))
    text = f"the axis has length {length:.4g}; it is taken as length 1"
    assert warning == f'4: joint "j" <axis>: {text}'


@pytest.mark.parametrize(
    ("xyz", "kept"), [("0 0 1.0000005", True), ("0 0 0.999998", False), ("0 0 1.0009", False)]
)
def test_the_text_keeps_an_axis_that_is_exact_enough(xyz, kept):
    description = parse_description(joint(f'<axis xyz="{xyz}"/>{LIMIT}'))
    assert (xyz in description.urdf) is kept
    assert ("0.0 0.0 1.0" in description.urdf) is not kept
    assert (description.joints[0].axis, description.warnings) == ((0.0, 0.0, 1.0), ())


@given(st.tuples(*[st.floats(-1e3, 1e3)] * 3).filter(lambda axis: max(map(abs, axis)) > 1e-3))
def test_an_axis_keeps_its_direction(axis):
    text = " ".join(map(repr, axis))
    (read,) = parse_description(joint(f'<axis xyz="{text}"/>{LIMIT}')).joints
    norm = math.hypot(*axis)
    assert read.axis == pytest.approx(tuple(value / norm for value in axis), abs=1e-12)
    assert math.hypot(*read.axis) == pytest.approx(1.0, abs=1e-15)


@pytest.mark.parametrize("kind", ["revolute", "continuous", "prismatic", "planar"])
def test_a_zero_axis_is_one_problem(kind):
    inside = f'<axis xyz="0 0 -0"/>{LIMIT if kind != "continuous" else ""}'
    text = f'the axis of a {kind} joint cannot be zero; write for example "0 0 1"'
    assert problems(joint(inside, kind)) == [f'4: joint "j" <axis>: {text}']


@pytest.mark.parametrize("kind", ["fixed", "floating"])
def test_a_joint_without_axis_may_have_a_zero_one(kind):
    description = parse_description(joint('<axis xyz="0 0 0"/>', kind))
    assert description.joints[0].axis == (1.0, 0.0, 0.0)
    assert description.warnings == ()
    assert len(problems(joint('<axis xyz="0 0"/>', kind))) == 1
    assert len(problems(joint("<axis/>", kind))) == 1


def test_an_unknown_kind_is_one_problem():
    follower = hinge("k", "b", "c", f'{LIMIT}<mimic joint="j"/>')
    text = joint('<axis xyz="0 0 0"/><mimic joint="k"/>', "revolut").replace(
        "</robot>", f'<link name="c"/>{follower}</robot>'
    )
    (problem,) = [text for text in problems(text) if "circle" not in text]
    assert problem.startswith(
        '3: joint "j": unknown joint type "revolut" (did you mean "revolute"?'
    )


def _origin(xyz):
    return f'<origin xyz="{xyz}"/>{LIMIT}'


@pytest.mark.parametrize(
    ("inside", "problem"),
    [
        (_limit("1", "0.5"), "<limit>: lower 1 is above upper 0.5; swap them"),
        (_limit("1", None), "<limit>: lower 1 is above upper 0; swap them"),
        (_limit(effort="-1"), '<limit>: effort="-1" is negative; it must not be'),
        (_limit(velocity="-1e-300"), '<limit>: velocity="-1e-300" is negative; it must not be'),
        (_limit(effort=None), '<limit>: has no effort; write effort="..."'),
        (_limit(lower="x"), '<limit>: lower="x": "x" is not a finite number'),
        (_limit(lower="0 1"), '<limit>: lower="0 1": holds 2; it takes 1 number'),
        (f"{LIMIT}<mimic/>", '<mimic>: there is no joint "" to mimic (joints: none)'),
        (_origin("0 0 0 0"), '<origin>: xyz="0 0 0 0": holds 4; it takes 3 numbers'),
        (_origin(""), '<origin>: xyz="": holds 0; it takes 3 numbers'),
        *((_origin(f"0 0 {word}"), f'<origin>: xyz="0 0 {word}": "{word}" is not a finite number')
          for word in "0, 1_000 ٣ 1e . NaN -inf +Infinity -1e309".split()),
    ],
)  # fmt: skip
def test_a_joint_with_one_problem(inside, problem):
    assert problems(joint(inside)) == [f'4: joint "j" {problem}']


@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
def test_a_limit_that_is_missing(kind):
    (problem,) = problems(joint("", kind))
    assert problem.startswith(f'3: joint "j": a {kind} joint needs a limit; write <limit lower=')


# ---------------------------------------------------------------------------------------- mimics


def _followers(*leaders, kinds=()):
    """Joints a, b, c, ... in lines 3, 5, 7, ..., each of which follows one of these, or none."""
    lines = ['<link name="l0"/>']
    for row, leader in enumerate(leaders):
        mimic = f'<mimic joint="{leader}"/>' if leader else ""
        kind = dict(kinds).get(row, "revolute")
        name = "abcdefgh"[row]
        lines.append(hinge(name, f"l{row}", f"l{row + 1}", LIMIT + mimic, kind))
        lines.append(f'<link name="l{row + 1}"/>')
    return robot(*lines)


@pytest.mark.parametrize(
    ("leaders", "found"),
    [
        (("b", "a"), ['3: joint "a" <mimic>: the joints a -> b -> a mimic each other in a circle']),
        (("b", "c", "b"), ['5: joint "b" <mimic>: the joints b -> c -> b mimic each other in a']),
        (
            ("b", "a", "d", "c"),
            [
                '3: joint "a" <mimic>: the joints a -> b -> a mimic',
                '7: joint "c" <mimic>: the joints c -> d -> c mimic',
            ],
        ),
        (("a",), ['3: joint "a" <mimic>: the joints a -> a mimic each other in a circle']),
        (("x",), ['3: joint "a" <mimic>: there is no joint "x" to mimic']),
        (("",), []),
        (("c", "c", "", "c"), []),
    ],
)
def test_who_follows_whom(leaders, found):
    text = _followers(*leaders)
    assert_begin(problems(text) if found else warnings(text), found)


@pytest.mark.parametrize("kind", ["fixed", "floating", "planar"])
def test_only_joints_of_one_position_follow_and_lead(kind):
    assert problems(_followers("b", "", kinds=[(0, kind)])) == [
        f'3: joint "a" <mimic>: a {kind} joint has no single position, so it cannot mimic'
    ]
    assert problems(_followers("b", "", kinds=[(1, kind)])) == [
        f'3: joint "a" <mimic>: joint "b" is {kind} and has no position to mimic'
    ]


def test_a_misspelt_leader_is_not_answered_with_the_follower_itself():
    (problem,) = problems(_followers("e", "", "", kinds=[(2, "fixed")]))
    assert "joints: b)" in problem


@pytest.mark.parametrize(
    ("attributes", "multiplier", "offset"),
    [
        ("", 1.0, 0.0),
        ('multiplier="-2" offset="-0.5"', -2.0, -0.5),
        ('offset="0.25"', 1.0, 0.25),
    ],
)
def test_numbers_of_a_mimic(attributes, multiplier, offset):
    text = _followers("b", "").replace('joint="b"/>', f'joint="b" {attributes}/>')
    assert parse_description(text).joints[0].mimic == Mimic("b", multiplier, offset)


# ----------------------------------------------------------------------------------------- links


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        *((inertial(**moments), f"<inertial> <inertia>: {name} is negative; it must not be")
          for moments, name in [
            ({"ixx": -1}, 'ixx="-1"'),
            ({"izz": -2e-15}, 'izz="-2e-15"'),
        ]),
        (inertial('<mass value="-1"/>'),
         '<inertial> <mass>: value="-1" is negative; it must not be'),
        *((inertial().replace(f' {name}="{value}"', ""),
           f'<inertial> <inertia>: has no {name}; write {name}="..."')
          for name, value in {"ixx": 1, "ixy": 0, "ixz": 0, "iyy": 1, "iyz": 0, "izz": 1}.items()),
        *((visual(f"<{shape}/>"), f"<visual> <geometry> <{shape.split()[0]}>: {text}")
          for shape, text in [
            ('box size="0 -1 -2"', 'size="0 -1 -2" is negative; it must not be'),
            ('sphere radius="-1e-9"', 'radius="-1e-9" is negative; it must not be'),
            ("sphere", 'has no radius; write radius="..."'),
            ('cylinder radius="1"', 'has no length; write length="..."'),
            ('mesh filename=""', 'names no file; write filename="package://<package>/<path>"'),
            (f'mesh filename="{CUBE}" scale="1"', 'scale="1": holds 1; it takes 3 numbers'),
        ]),
    ],
)  # fmt: skip
def test_a_link_with_one_problem(text, problem):
    assert problems(text) == [f'3: link "a" {problem}']


def test_moments_and_sizes_that_are_fine():
    """CAD programs write a moment that is 0 as a tiny number, maybe below 0."""
    assert warnings(inertial(ixx=-5e-20)) == []
    assert warnings(visual('<box size="0 1 1"/>')) == []


@pytest.mark.parametrize("tag", ["visual", "collision"])
def test_geometry_of_one_shape(tag):
    box, ball = '<box size="1 1 1"/>', '<sphere radius="1"/>'
    assert warnings(link(f"<{tag}><geometry>{box}</geometry></{tag}>")) == []
    (problem,) = problems(link(f"<{tag}/>"))
    assert problem.startswith(f'3: link "a" <{tag}>: has no <geometry>; it takes one of: box, cyl')
    (problem,) = problems(link(f"<{tag}><geometry/></{tag}>"))
    assert problem.startswith(f'3: link "a" <{tag}> <geometry>: holds 0 shapes; it takes one of')
    (problem,) = problems(link(f"<{tag}><geometry>{box}{ball}</geometry></{tag}>"))
    assert "holds 2 shapes; it takes one of: box" in problem
    (problem,) = problems(link(f"<{tag}><geometry><bx/></geometry></{tag}>"))
    assert problem.startswith(f'3: link "a" <{tag}> <geometry> <bx>: unknown shape')


def test_every_origin_is_checked():
    wrong = '<origin xyz="0 0" rpy="0"/>'
    box = '<geometry><box size="1 1 1"/></geometry>'
    shapes = f"<visual>{wrong}{box}</visual><collision>{wrong}{box}</collision></link>"
    weighed = inertial(f'{wrong}<mass value="1"/>')
    found = problems(weighed.replace("</link>", shapes))
    assert sorted(text.split(": ")[1] for text in found) == [
        f'link "a" <{tag}> <origin>' for tag in ("collision", "inertial", "visual") for _ in "12"
    ]
    assert len(problems(joint(wrong + LIMIT))) == 2
    for half in ('<origin xyz="0 0"/>', '<origin rpy="0"/>'):
        [read] = parse_description(link(f"<visual>{half}{box}</visual>")).links
        assert read.visuals == ()


# ------------------------------------------------------------------------------------- materials


def _visual(material, extra=""):
    box = '<geometry><box size="1 1 1"/></geometry>'
    return f"<visual>{box}{material}</visual>{extra}"


def _color(rgba):
    return f'<color rgba="{rgba}"/>'


RED = _color("1 0 0 1")


@pytest.mark.parametrize(
    ("rgba", "good"),
    [
        ("0 0 0 0", True),
        ("1 1 1 1", True),
        ("1.0001 0 0 1", False),
        ("0 0 255 1", False),
    ],
)
def test_colors_go_from_0_to_1(rgba, good):
    use = '<material name="m"/>'
    text = link(_visual(use) + _visual(use), f'<material name="m">{_color(rgba)}</material>')
    start = f'1: material "m" <color>: rgba="{rgba}" is beyond 0 to 1; divide'
    assert_begin(warnings(text) if good else problems(text), [] if good else [start])


def _material(inside, name="m"):
    return f'<material name="{name}">{inside}</material>'


GREEN = _color("0 1 0 1")
USED = 'link "a" <visual> material "m":'
CLASH = [f"4: {USED} a material of that name looks different elsewhere"]


@pytest.mark.parametrize(
    ("shared", "first", "second", "starts"),
    [
        (_material(RED), "", "", []),
        ("", RED, "", []),
        ("", RED, _color("1.0 0 0 1"), []),
        ("", "", "", [f"{line}: {USED} no material of that name is defined" for line in (3, 4)]),
        ("", RED, GREEN, CLASH),
        (_material(RED), RED, GREEN, CLASH),
        (_material(""), RED, RED, []),
        (_material(RED) + _material(GREEN), "", "", ['1: material "m": a material of that name']),
    ],
)
def test_materials_used_by_two_visuals(shared, first, second, starts):
    uses = [_visual(_material(inside)) for inside in (first, second)]
    assert_begin(warnings(link("\n".join(uses), shared)), starts)


def test_the_first_material_of_a_name_colors_all_visuals_of_that_name():
    """As in urdfdom: the robot's before the visuals'; without a name each has its own."""
    materials = (("", "m"), (RED, "m"), (GREEN, "m"), (GREEN, ""), (GREEN, "n"), (RED, "n"))
    uses = "".join(_visual(_material(*material)) for material in materials)

    def colors(shared):
        [read] = parse_description(link(uses, shared)).links
        return [visual.color for visual in read.visuals]

    r, g, b = (1.0, 0.0, 0.0, 1.0), (0.0, 1.0, 0.0, 1.0), (0.0, 0.0, 1.0, 1.0)
    assert colors("") == [r, r, r, g, g, g]
    assert colors(_material(_color("0 0 1 1"))) == [b, b, b, g, g, g]


def test_materials_without_a_name_are_each_their_own():
    uses = [_visual(_material(color, "")) for color in (RED, GREEN)]
    assert warnings(link("".join(uses))) == []
    (warning,) = warnings(link(_visual('<material name=""/>')))
    assert "no material of that name is defined" in warning
    (problem,) = problems(link(_visual(f"<material>{RED}</material>")))
    assert problem.startswith('3: link "a" <visual> <material>: has no name; write <material name=')


# ---------------------------------------------------------------------------------------- schema


@pytest.mark.parametrize(
    ("inside", "texts"),
    [
        ("<visul/>", ['<visul>: unknown inside <link>, so it is ignored (did you mean "visual"?']),
        ('<visul><geometri a="1"><x/></geometri></visul>', ["<visul>: unknown inside <link>"]),
        ('<gazebo><link x="1"><limit a="1"/></link></gazebo>', []),
        ("<sensor/><contact/><self_collision_checking/>", []),
        ('<wheel name="w"/>', ['wheel "w": unknown inside <link>']),
        ('<x:y xmlns:x="http://a.org" a="1"><visul/></x:y>', []),
    ],
)
def test_elements_that_urdf_does_not_know(inside, texts):
    assert_begin(warnings(link(inside)), [f'3: link "a" {text}' for text in texts])


def test_attributes_that_urdf_does_not_know():
    text = joint('<limit lowr="-1" lower="-1" upper="1" effort="1" velocity="1" x="2"/>')
    found = warnings(text)
    start = '4: joint "j" <limit>: unknown attribute'
    assert_begin(found, [f'{start} "lowr", so it is ignored (did you', f'{start} "x", so it is'])
    assert warnings(link("").replace('name="a"', 'name="a" type="t" x:y="1" xmlns:x="u"')) == []


def test_warnings_come_with_the_problems_and_stay_warnings():
    text = joint('<limit loer="-1" lower="2" upper="1" effort="1" velocity="0"/>')
    with pytest.raises(DescriptionError) as caught:
        parse_description(text, "r").raise_problems()
    [problem], warnings = caught.value.problems, caught.value.warnings
    assert "lower 2 is above" in problem and "velocity is 0" in warnings[0]
    assert 'unknown attribute "loer"' in warnings[1]
    lines = [problem, *(f"warning: {warning}" for warning in warnings)]
    assert str(caught.value).splitlines() == lines


@pytest.mark.parametrize("tag", ["origin", "limit", "mimic", "parent"])
def test_second_elements_are_one_problem(tag):
    inside = {
        "origin": "<origin/>",
        "limit": LIMIT,
        "mimic": '<mimic joint="j"/>',  # in a circle, too
        "parent": '<parent link="a"/>',
    }[tag]
    first = "" if tag == "parent" else inside
    rest = "" if tag == "limit" else LIMIT
    text = joint(f"{first}{rest}\n{inside}\n{inside}")
    found = [one for one in problems(text) if "circle" not in one]
    assert found == [f'5: joint "j" <{tag}>: occurs 3 times in joint "j"; keep one']


def test_xacro_that_was_not_expanded_is_one_problem():
    head = '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">'
    text = f'{head}\n<link name="${{a}}"/>\n<xacro:wheel/>\n<xacro:wheel/></robot>'
    (problem,) = problems(text)
    assert problem.startswith("3: <wheel>: <xacro:wheel>")
    assert " and 2 more is xacro that was not expanded; name the file .xacro" in problem
    assert problem.endswith('write <robot xmlns:xacro="http://www.ros.org/wiki/xacro" ...>')
    (problem,) = problems(text.replace("<xacro:wheel/></robot>", "</robot>"))
    assert " and 1 more is xacro that was not expanded" in problem
    (problem,) = problems('<robot name="r">\n<link name="$(arg a)"/></robot>')
    assert problem.startswith('2: link "$(arg a)": name="$(arg a)" is xacro that was not expanded')
    assert warnings('<robot name="r"><link name="a$"/></robot>') == []


@pytest.mark.parametrize("tag", ["link", "joint"])
def test_names_are_given_once(tag):
    rows = ['<link name="a"/>', '<link name="b"/>', '<link name="c"/>', hinge("j", "a", "b")]
    repeated = '<link name="c"/>' if tag == "link" else hinge("j", "b", "c")
    name, first = ("c", 4) if tag == "link" else ("j", 5)
    if tag == "link":
        rows.append(hinge("k", "b", "c"))
    found = problems(robot(*rows, repeated, repeated))
    line = len(rows) + 2
    assert found[:2] == [
        f'{number}: {tag} "{name}": there already is a {tag} of that name, at r:{first}; rename it'
        for number in (line, line + 1)
    ]
    assert all("there already is a" in one for one in found)


@pytest.mark.parametrize(
    ("name", "count"), [("a b", 1), ("a/b", 1), ("a&#9;b", 1), ("a.b-c:d", 0), ("é", 0)]
)
def test_names_that_tf_dislikes(name, count):
    found = warnings(f'<robot name="r"><link name="{name}"/></robot>')
    assert len(found) == count
    assert all("contains a space or slash, which breaks TF frame names" in text for text in found)


@pytest.mark.parametrize("name", ["", ' name=""', ' name="  "'])
def test_names_that_are_missing(name):
    (problem,) = problems(f'<robot{name}><link name="a"/></robot>')
    assert problem.startswith("1: ") and "the robot has no name; write <robot name=" in problem
    (problem,) = problems(f'<robot name="r"><link name="a"/>\n<link{name}/></robot>')
    assert problem.startswith("2: ") and 'has no name; write <link name="...">' in problem


# ------------------------------------------------------------------------------------------ tree


def _links(names):
    return "".join(f'<link name="{name}"/>' for name in names)


@pytest.mark.parametrize(
    ("joints", "found"),
    [
        (["ab", "bc"], []),
        (["ab", "ac"], []),
        (["ab", "bc", "ac"], ['5: joint "j2": link "c" has two parents: joint "j1" moves it']),
        (
            ["ab", "ab", "ab"],
            ['4: joint "j1": link "b" has two', '5: joint "j2": link "b" has two', "2: link"],
        ),
        (["aa", "bc"], ['3: joint "j0": the links a -> a form a loop; remove one of its joints']),
        (["ab", "bc", "ca"], ['4: joint "j1": the links c -> a -> b -> c form a loop; remove']),
        (
            [],
            ['2: link "b": the robot is in 3 separate parts, with the roots a, b, c; connect each'],
        ),
        (["ab", "bx"], ['4: joint "j1" <child>: there is no link "x" (links: a, b, c)']),
    ],
)
def test_links_make_one_tree(joints, found):
    rows = [hinge(f"j{row}", *ends) for row, ends in enumerate(joints)]
    text = robot(_links("abc"), *rows)
    assert_begin(problems(text) if found else warnings(text), found)
    assert found or parse_description(text).root_link == "a"


def test_ends_that_are_missing_are_one_problem_each():
    ends = '<parent link="a"/><child link="b"/>'
    text = robot(_links("ab"), f'<joint name="j" type="fixed">{ends}</joint>')
    assert problems(text.replace('<parent link="a"/>', "")) == [
        '3: joint "j": has no <parent>; write <parent link="..."/>'
    ]
    assert problems(text.replace('<child link="b"/>', "")) == [
        '3: joint "j": has no <child>; write <child link="..."/>'
    ]
    for empty in ("<child/>", '<child link=""/>'):
        assert problems(text.replace('<child link="b"/>', empty)) == [
            '3: joint "j" <child>: there is no link "" (links: a, b)'
        ]
    assert len(problems(text.replace(ends, ""))) == 2


# --------------------------------------------------------------------------------------- numbers


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1", 1.0),
        ("-.5", -0.5),
        ("1e3", 1000.0),
        (" 2\t", 2.0),
        ("1.7976931348623157e308", 1.7976931348623157e308),
        ("1e-999", 0.0),
    ],
)
def test_numbers_are_read(text, value):
    (read,) = parse_description(joint(f'<origin xyz="{text} 0 {text}"/>{LIMIT}')).joints
    assert read.origin.xyz == (value, 0.0, value)


def test_long_texts_are_cut():
    (problem,) = problems(joint(f'<origin xyz="{"x" * 101}"/>{LIMIT}'))
    shown = "x" * 100 + "..."
    assert f'xyz="{shown}": "{shown}" is not a finite number' in problem


@pytest.mark.parametrize(("depth", "good"), [(100, True), (101, False)])
def test_nesting_ends_at_a_hundred(depth, good):
    deep = "<transmission>" * (depth - 1) + "</transmission>" * (depth - 1)
    text = f'<robot name="r"><link name="a"/>{deep}</robot>'
    if good:
        assert warnings(text) == []
    else:
        assert problems(text) == ["1: elements are nested deeper than 100"]
