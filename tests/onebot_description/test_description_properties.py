"""Properties over random damage; test_robot_model.py has random robots."""

import tempfile
from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from onebot_description.description import (
    DescriptionError,
    describe,
    load_description,
    parse_description,
)

ROBOTS = Path(__file__).parents[1] / "robots"
SEEDS = [(ROBOTS / f"good_{name}").read_bytes() for name in ("mimic_chain.urdf", "arguments.xacro")]
PIECES = st.sampled_from(
    [b"\0", b"", b"<!DOCTYPE a>", *b'< > " /> ${ } $( &a; nan - 1e999 \xff <link/>'.split(b" ")]
    + b"<xacro:wheel/> <!-- joint base xacro: 0".split()
)
EDITS = st.lists(
    st.tuples(st.integers(0, 2000), st.integers(0, 30), PIECES), min_size=1, max_size=4
)


@given(st.sampled_from(SEEDS), EDITS)
def test_damage_is_always_explained(seed: bytes, edits: list[tuple[int, int, bytes]]) -> None:
    for start, length, piece in edits:
        seed = seed[:start] + piece + seed[start + length :]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "robot.xacro"
        path.write_bytes(seed)
        try:
            describe(load_description(path))
        except DescriptionError as error:
            assert error.problems and all("\n" not in problem for problem in error.problems)
    try:
        describe(parse_description(seed.decode("latin-1")))
    except DescriptionError as error:
        assert error.problems
