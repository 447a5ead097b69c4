"""``robots:=N`` and ``robots:=FILE.yaml``: names, places, models, and what is wrong with them."""

import math
from itertools import combinations
from pathlib import Path

import pytest

from onebot_bringup.launch.robots import PlacedRobot, in_rows, placed_robots, reach
from onebot_description.description import parse_description
from onebot_description.errors import OneBotError
from tests.onebot_control.control_support import robot, urdf

BOX = """<robot name="box"><link name="base"/>
  <link name="arm"><collision><origin xyz="1 0 0"/><geometry>{}</geometry></collision></link>
  <joint name="joint" type="continuous"><parent link="base"/><child link="arm"/>
    <origin xyz="0 2 0" rpy="0 0 1.5707963267948966"/><axis xyz="0 0 1"/></joint></robot>"""


@pytest.mark.parametrize(
    ("shape", "farthest"),
    [
        ('<sphere radius="0.25"/>', 3.25),
        ('<box size="0.6 0.8 0"/>', math.hypot(3.3, 0.4)),
        ('<capsule radius="0.3" length="0.8"/>', 3.3),
    ],
)
def test_how_far_a_robot_reaches(shape: str, farthest: float) -> None:
    """By all shapes where they are: here 3 m to the left."""
    assert reach(parse_description(BOX.format(shape))) == pytest.approx(farthest, rel=1e-3)


@pytest.mark.parametrize("count", [1, 2, 5, 20, 50])
def test_robots_in_rows_are_clear_of_one_another(count: int) -> None:
    """As many as asked for, in a square, the first one at the origin; nobody is touched."""
    placed, width = in_rows(count, robot()), 2.0 * reach(robot())
    assert [each.name for each in placed] == [f"robot{k + 1}" for k in range(count)]
    assert placed[0][1:4] == (0.0, 0.0, 0.0)
    for one, other in combinations(placed, 2):
        assert math.hypot(one.x - other.x, one.y - other.y) > width
    extent = max(max(abs(each.x), abs(each.y)) for each in placed)
    assert extent <= (math.sqrt(count)) * 1.0


def of_file(tmp_path: Path, text: str) -> list[PlacedRobot]:
    (tmp_path / "fleet.yaml").write_text(text)
    return placed_robots(str(tmp_path / "fleet.yaml"), robot())


def test_a_file_names_places_models_and_parameters(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Files are relative to it, or to the home folder; a model that several have is read once."""
    monkeypatch.setenv("HOME", str(tmp_path))
    (tmp_path / "big.urdf").write_text(urdf(name="big"))
    (tmp_path / "big.yaml").write_text("")
    robots = of_file(
        tmp_path,
        "robots:\n"
        "  scout: {x: 1, y: -2.5, yaw: 0.5}\n"
        "  big_1: {x: 0.0, y: 2.0, model: big.urdf, params_file: ~/big.yaml}\n"
        "  big_2: {x: 0.0, y: 4.0, model: big.urdf}\n",
    )
    scout, one, two = robots
    assert scout[:4] == ("scout", 1.0, -2.5, 0.5) and scout.params_file is None
    assert scout.description.robot_name == "bot" and one.description.robot_name == "big"
    assert one.params_file == tmp_path / "big.yaml"
    assert one.description is two.description


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("robots:\n  a: {x: 0.0}", r":2: robots.a: has no y, where it starts"),
        ("robots:\n  a: {x: 0, y: 0, yav: 1}", r':2: robots.a.yav: no such .*did you mean "yaw"'),
        ("robots:\n  a b: {x: 0, y: 0}", r":2: robots.a b: is not valid as a namespace; write"),
        ("robots: {}", r":1: robots: is empty; write a robot, such as scout"),
        ("", r"robots: is missing"),
        ("robots:\n  a: {x: 0, y: 0, model: none.urdf}", r":2: robots.a: .*none.urdf"),
        (
            "robots:\n  a: {x: 0, y: 0, params_file: none.yaml}",
            r":2: robots.a: params_file: /.*none.yaml: no such file",
        ),
    ],
)
def test_what_is_wrong_in_a_file_is_named_with_its_line(
    tmp_path: Path, text: str, said: str
) -> None:
    with pytest.raises(OneBotError, match=said):
        of_file(tmp_path, text)


@pytest.mark.parametrize("text", ["0", "-3", "2.5"])
def test_what_is_neither_a_number_nor_a_file_is_refused(text: str) -> None:
    with pytest.raises(OneBotError, match=f"robots:={text}: no such file; write how many, or a"):
        placed_robots(text, robot())
