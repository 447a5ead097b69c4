"""What a description costs grows with its size, not with the square of it."""

import os
import time
import tracemalloc
from dataclasses import replace
from pathlib import Path

import pytest

from onebot_description.description import (
    DescriptionError,
    describe,
    load_description,
    parse_description,
)
from onebot_description.elements import xml
from onebot_description.joints.config import Dependent
from onebot_description.joints.mimic import resolve
from onebot_description.joints.motion_limits import joint_limits
from tests.support import assert_time_grows_with_size

COUNT = 1_500
LIMIT = '<limit lower="-1" upper="1" effort="1" velocity="1"/>'


def chain(mimic: str = "", links: int = COUNT, parent: str = "l{}") -> str:
    """A chain of revolute joints; ``mimic`` may hold the numbers of the joints beside each."""
    parts = [f'<link name="l{n}"/>' for n in range(links)]
    for n in range(links - 1):
        follows = mimic.format(before=(n - 1) % (links - 1)) if mimic else ""
        parts.append(
            f'<joint name="j{n}" type="revolute"><parent link="{parent.format(n)}"/>'
            f'<child link="l{n + 1}"/>{LIMIT}{follows}</joint>'
        )
    return f'<robot name="chain">{"".join(parts)}</robot>'


def seconds(urdf: str) -> float:
    """The processor time to read and show ``urdf``, or to say what is wrong with it."""
    start = time.process_time()
    try:
        describe(parse_description(urdf))
    except DescriptionError as error:
        assert len(str(error)) < 10_000
    return time.process_time() - start


@pytest.mark.parametrize(
    ("mimic", "parent"),
    [
        ("", "l{}"),
        ('<mimic joint="j{before}"/>', "l{}"),  # a circle of all of them
        ("", "m{}"),  # each hangs on a link that is not there
        ("<mimik/>", "l{}"),
    ],
)
def test_time_grows_with_the_size(mimic: str, parent: str) -> None:
    assert_time_grows_with_size(lambda count: seconds(chain(mimic, count, parent)), COUNT)


def test_xacro_takes_time_by_the_number_of_calls(tmp_path: Path) -> None:
    assert_time_grows_with_size(lambda count: expanded(tmp_path, count), 2 * COUNT)


def expanded(folder: Path, count: int) -> float:
    """The processor time to expand so many calls of a macro."""
    calls = "".join(f'<!-- {n} --><xacro:part n="{n}"/>' for n in range(count))
    (folder / "robot.xacro").write_text(
        '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">'
        '<xacro:macro name="part" params="n"><link name="l${n}"/><gazebo/><gazebo/></xacro:macro>'
        f'<xacro:if value="true">{calls}</xacro:if></robot>'
    )
    start = os.times()
    assert len(load_description(folder / "robot.xacro").links) == count
    end = os.times()
    return end.user + end.children_user - start.user - start.children_user


def test_a_long_name_is_not_repeated_whole() -> None:
    visuals = "<visual/>" * 500
    urdf = f'<robot name="r"><link name="{"x" * 1_000_000}">{visuals}</link></robot>'
    tracemalloc.start()
    with pytest.raises(DescriptionError) as error:
        parse_description(urdf).raise_problems()
    assert tracemalloc.get_traced_memory()[1] < 200_000_000
    tracemalloc.stop()
    assert len(str(error.value)) < 10_000


@pytest.mark.parametrize("many", ["<a/>" * 1000, "<a b=''/>" * 500])
def test_what_is_too_much_is_refused_before_it_is_kept(
    many: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert xml._MAX_PARTS == 1_000_000
    monkeypatch.setattr(xml, "_MAX_PARTS", 1000)
    with pytest.raises(DescriptionError, match="more than 1000 elements and attributes"):
        parse_description(f'<robot name="r">{many}</robot>')


def test_a_mimic_chain_is_followed_once() -> None:
    assert_time_grows_with_size(resolved, COUNT)


def resolved(count: int) -> float:
    """The processor time to resolve a chain of so many joints, a circle, and what is wrong."""
    (joint,) = parse_description(chain(links=2)).joints
    names = [f"j{n}" for n in range(count)][::-1]  # leaders come last
    joints = [replace(joint, name=name, lower=-1e9, upper=1e9) for name in names]
    limits, _ = joint_limits(joints, soft=False)
    mimics = {f"j{n}": Dependent(f"j{n - 1}", 1.0, 0.5) for n in range(1, count)}
    start = time.process_time()
    found, _, _ = resolve(joints, joints, limits, mimics, False)
    last = names.index(f"j{count - 1}")
    assert found.leader[last] == names.index("j0")
    assert found.offset[last] == (count - 1) * 0.5
    circle = {**mimics, "j0": Dependent(f"j{count - 1}", 1.0, 0.0)}
    assert len(resolve(joints, joints, limits, circle, False)[2]) >= 1
    nothing = {name: Dependent(f"no_{name}", 1.0, 0.0) for name in names}
    assert len(resolve(joints, joints, limits, nothing, False)[2]) == count
    return time.process_time() - start
