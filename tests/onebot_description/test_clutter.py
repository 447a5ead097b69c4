"""Worlds that are generated from a seed."""

import subprocess
import sys

import numpy as np
import pytest

from onebot_description.description.clutter import (
    ClutterParameters,
    clutter,
    parameters_of,
)
from onebot_description.description.loading import load_world
from onebot_description.errors import OneBotError


def test_a_seed_is_a_world():
    world = load_world("clutter:seed=7,density=0.3")
    assert world.urdf == load_world("clutter:seed=7,density=0.3").urdf
    assert world.urdf != load_world("clutter:seed=8,density=0.3").urdf
    assert not world.notices and world.root_link == "world"
    assert parameters_of("clutter:7") == parameters_of("clutter:seed=7") == ClutterParameters(7)
    assert parameters_of("clutter") == ClutterParameters()


@pytest.mark.parametrize("seed", range(5))
def test_the_field_lies_between_start_and_goal(seed):
    world = clutter(ClutterParameters(seed, density=0.3, size=3.0))
    x, y = world.cylinders.T
    assert (2.0 < x).all() and (x < 5.0).all() and (np.abs(y) < 1.5).all()
    assert 6.95 <= world.length < 12.0 and world.clearance > 0.25


def test_dense_worlds_are_harder():
    worlds = [[clutter(ClutterParameters(n, density)) for n in range(3)] for density in (0.2, 0.3)]
    means = [
        np.mean([(len(each.cylinders), each.length, -each.clearance) for each in some], axis=0)
        for some in worlds
    ]
    assert (means[0] < means[1]).all()


def test_what_no_robot_can_cross_is_refused():
    with pytest.raises(OneBotError, match="no robot of radius 1 m can cross such worlds; write a"):
        clutter(ClutterParameters(density=0.4, size=1.5, radius=1.0))


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("clutter:sed=1", 'sed: no such parameter .did you mean "seed"'),
        ("clutter:density=2", "density: 2 is above 0.4"),
        ("clutter:seed=x", 'seed: "x" is a string; write an integer'),
        ("clutter:size=[", "is no number"),
        ("cluter", 'no world "cluter" .did you mean "clutter"'),
    ],
)
def test_bad_names(name, message):
    with pytest.raises(OneBotError, match=message):
        load_world(name)


def test_its_difficulty_is_printed():
    command = [sys.executable, "-m", "onebot_description.description.clutter", "seed=3"]
    output = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert "cylinders; the goal is at 8.5, 0; the shortest path is" in output
