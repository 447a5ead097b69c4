"""Expressions of xacro files: what public robots use works, and nothing else is in reach."""

import math
import re
from pathlib import Path
from typing import Any

import pytest
import simpleeval
import xacro
from hypothesis import given
from hypothesis import strategies as st

from onebot_description.description import DescriptionError, load_description
from onebot_description.description.expansion import explain
from onebot_description.description.expressions import evaluate, global_symbols

YAML = xacro.YamlDictWrapper(
    limits={"shoulder": {"lower": -1.5, "values": [1, 2]}}, colors=[{"red": 1}], items=3
)


def value_of(expression: str) -> Any:
    """The value in a xacro file that has loaded ``YAML`` as ``config``."""
    names = xacro.Table(global_symbols())
    for name, value in {"config": YAML, "side": "left", "scale": 2}.items():
        names[name] = value
    names["lazy"] = "${scale * 3}"
    return evaluate(expression, names)


@pytest.mark.parametrize(
    ("expression", "value"),
    [
        ("2**3**2 + -2**2 - 7 // 2 % 3", 508),
        ("1 << 4 | 3 & ~1 ^ 5", 23),
        ("0 < scale <= 2 and not side == 'right' or None", True),
        ("'a' if side in ['left', 'right'] else 'b'", "a"),
        ("lazy + scale", 8),
        ("pi / 2 + math.pi / 2", math.pi),
        ("sin(radians(90)) + math.atan2(1, 1)", 1 + math.pi / 4),
        ("config.limits.shoulder.lower", -1.5),
        ("config.limits.shoulder['values'][-1]", 2),
        ("[name for name in config.limits]", ["shoulder"]),
        ("config.get('none', 5) + config['items']", 8),
        ("{**{'a': 1}, 'b': 2}", {"a": 1, "b": 2}),
        ("[x * y for x in python.range(3) for y in [scale] if x]", [2, 4]),
        ("' '.join(str(value) for value in [1, 2.5])", "1 2.5"),
        ("sum([1])", simpleeval.FunctionNotDefined),
        ("'ab'.capitalize() + str('aab'.count('a')) + 'b'.zfill(2)", "Ab20b"),
        ("python.isinstance(side, str) and len(side) == 4", True),
        ("'%s_%.2f' % (side, 1 / 3)", "left_0.33"),
        ("xacro.tokenize('a; b')", ["a", "b"]),
        ("xacro.dotify({'a': {'b': 1}}).a.b", 1),
        (" float('1.5')  + int('2') ", 3.5),
        ("math.wheel", NameError),
        ("wheel", simpleeval.NameNotDefined),
        ("1 +", SyntaxError),
        ("config.wheel", AttributeError),
    ],
)
def test_values_are_pythons(expression: str, value: Any) -> None:
    if isinstance(value, type) and issubclass(value, Exception):
        with pytest.raises(value):
            value_of(expression)
    else:
        found = value_of(expression)
        assert found == pytest.approx(value) if isinstance(value, float) else found == value
        assert type(found) is type(value) or isinstance(found, list)


@pytest.mark.parametrize(
    "expression",
    [
        "().__class__",
        "[c for c in ().__class__.__base__.__subclasses__()]",
        "(lambda: 1)()",
        "(x for x in [1]).gi_frame",
        "f'{side}'",
        "(y := 1)",
        "__builtins__",
        "open('/etc/passwd')",
        "xacro.load_yaml.func_globals",
        "xacro.load_yaml.name",
        "python.vars(str)",
        "python.type(xacro.load_yaml)",
        "python.type('A', (), {})",
        "'{0.real}'.format(1)",
        "str.format('{0.real}', 1)",
        "[0 for config.limits in [1]]",
        "[x for x in python.range(20000)]",
        "import os",
    ],
)
def test_nothing_else_is_in_reach(expression: str) -> None:
    errors = (simpleeval.InvalidExpression, NameError, AttributeError, SyntaxError, TypeError)
    with pytest.raises(errors):
        value_of(expression)


@given(
    st.lists(
        st.sampled_from(
            "config limits python math xacro type vars str format load_yaml tokenize map gi_frame "
            "__class__ __globals__ ( ) [ ] . , : { } ' = + x for in lambda 0 '{0.__class__}' if not"
            " items pop root parent wrap f_back join list dict isinstance".split()
        ),
        max_size=12,
    )
)
def test_whatever_is_written_gives_a_value_of_its_kind(words: list[str]) -> None:
    for expression in ("".join(words), " ".join(words)):
        try:
            value = value_of(expression)
        except Exception as error:
            assert not isinstance(error, SystemError | AssertionError)
            continue
        assert type(value).__name__ not in ("frame", "module", "code", "mappingproxy")
        assert value not in (type, object)


@pytest.mark.parametrize(
    ("written", "name"),
    [
        ("${'a' + 'b'}$(eval 2**3)", "ab8"),
        ("$(eval 'x' if size == 2.5 and true else 'y')", "x"),
        ("$(eval pi > 3 and [1, 2][1])", "2"),
        ("${round(config.angle, 2)} ${config.length * 10000}", "1.53 254.0"),
        ("${python.type('') == str}", "True"),
    ],
)
def test_what_a_file_can_hold(tmp_path: Path, written: str, name: str) -> None:
    assert load_description(_file(tmp_path, written)).link_names == (name,)


@pytest.mark.parametrize(
    ("written", "problem"),
    [
        ("$(eval [[].__class__][0])", "access to __attributes"),
        ("${open('x')}", r"cannot evaluate \$\{open\('x'\)}: .*'open' not defined"),
        ("${xacro.load_yaml('attack.yaml')}", "Lambda Functions not implemented"),
        ("${[lambda: 1]}", "cannot evaluate .* Lambda is not available"),
    ],
)
def test_what_a_file_cannot_hold(tmp_path: Path, written: str, problem: str) -> None:
    with pytest.raises(DescriptionError) as error:
        load_description(_file(tmp_path, written))
    (text,) = error.value.problems
    assert re.search(problem, text) and "robot.xacro:1: " in text, text


def _file(folder: Path, written: str) -> Path:
    (folder / "config.yaml").write_text("angle: !degrees 175 / 2\nlength: !inches 1\n")
    (folder / "attack.yaml").write_text("angle: !degrees (lambda x:x)(1)\n")
    file = folder / "robot.xacro"
    file.write_text(
        '<robot name="a" xmlns:xacro="http://www.ros.org/wiki/xacro">'
        '<xacro:arg name="size" default="2.5"/>'
        '<xacro:property name="config" value="${xacro.load_yaml(\'config.yaml\')}"/>'
        f'<link name="{written}"/></robot>'
    )
    return file


def test_memory_that_ran_out_is_no_mistake_of_the_file():
    with pytest.raises(MemoryError):
        explain(xacro.XacroException("in a macro", exc=MemoryError()), Path("r.xacro"), ())
