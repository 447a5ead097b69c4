"""The mutants of a module: cosmic-ray's, without those that tell nothing about the tests."""

import difflib
import re
from collections.abc import Iterator
from typing import NamedTuple

import parso
from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.mutating import mutate_code
from cosmic_ray.plugins import get_operator, operator_names

from tests.mutation.targets import CHECKOUT

# Left out: bit operators, which fail by themselves on floats and stand in annotations; // % ** as
# replacements; "is" for "==", which is often the same; +x for -x, which is x, mutated to as well.
_KEPT = re.compile(
    r".*/(?:ReplaceBinaryOperator_(?:Add|Sub|Mul|Div|FloorDiv|Mod|Pow)_(?:Add|Sub|Mul|Div)"
    r"|ReplaceComparisonOperator_(?:Eq|NotEq|Lt|LtE|Gt|GtE)_(?:Eq|NotEq|Lt|LtE|Gt|GtE)"
    r"|ReplaceComparisonOperator_Is(?:Not)?_Is(?:Not)?|ReplaceUnaryOperator_Delete_\w+"
    r"|(?!Replace(?:Binary|Comparison|Unary)Operator)\w+)"
)
_KEEPING = re.compile(r"@(?:abstractmethod|functools\.(?:lru_)?cache)\b")
_ORDER = re.compile(r"/ReplaceComparisonOperator_(?:Not)?Eq_[LG]")


class Mutant(NamedTuple):
    """One change of one module."""

    module: str  # path in the checkout
    text: str  # of the module, before the change
    definition: str  # that it is in, e.g. "Odometry.update"
    operator: str  # cosmic-ray's name
    occurrence: int  # among those that the operator has in the module

    def source(self) -> str:
        """Return the module's text with the change."""
        mutated: str = mutate_code(self.text, get_operator(self.operator)(), self.occurrence)
        return mutated

    def is_python(self) -> bool:
        """Return whether it compiles: cosmic-ray's ``not a := b`` does not."""
        try:
            compile(self.source(), self.module, "exec")
        except SyntaxError:
            return False
        return True

    def diff(self) -> str:
        """Return the change as a unified diff."""
        lines = difflib.unified_diff(
            self.text.splitlines(), self.source().splitlines(), n=1, lineterm=""
        )
        return "\n".join([f"{self.module}: {self.definition}", *list(lines)[2:]])


def mutants(module: str) -> Iterator[Mutant]:
    """Yield all mutants of a module, a path in the checkout."""
    text = (CHECKOUT / module).read_text(encoding="utf-8")
    nodes = list(ast_nodes(get_ast(text)))
    for name in filter(_KEPT.fullmatch, operator_names()):
        if get_operator(name).arguments():
            continue  # needs to be given variables' names
        operator = get_operator(name)()
        places = (node for node in nodes for _ in operator.mutation_positions(node))
        for occurrence, node in enumerate(places):
            if not (_is_declarative(node) or _means_nothing(name, node)):
                yield Mutant(module, text, _definition(node), name, occurrence)


def _ancestors(node: parso.tree.NodeOrLeaf) -> Iterator[parso.tree.NodeOrLeaf]:
    while (node := node.parent) is not None:
        yield node


def _is_declarative(node: parso.tree.NodeOrLeaf) -> bool:
    """Return whether it is the ``*`` of ``def f(*, a)``, ``**a``, or says something to tools.

    That is in a decorator's arguments, an assertion for mypy, or ``if TYPE_CHECKING``.
    """
    if any(above.type in ("decorator", "assert_stmt") for above in [node, *_ancestors(node)][1:]):
        return True
    if node.type == "assert_stmt" or node.get_code().strip().startswith("if TYPE_CHECKING:"):
        return True
    syntax = ("parameters", "lambdef", "dictorsetmaker")
    return bool(node.type == "operator" and node.parent.type in syntax)


def _means_nothing(operator: str, node: parso.tree.NodeOrLeaf) -> bool:
    """Return whether the change is one that no input can tell, or that nobody makes by mistake.

    These are an abstract method that may be left out, a result that is computed again instead of
    kept, ``zip(strict=False)`` of what is equally long, and an order in place of ``==`` of what is
    not a number: names of joints, say, have none.
    """
    if operator.endswith("/RemoveDecorator"):
        return bool(_KEEPING.match(node.get_code().strip()))
    if operator.endswith("/ReplaceTrueWithFalse"):
        return bool(node.parent.type == "argument" and node.parent.children[0].value == "strict")
    if _ORDER.search(operator):
        return not any(operand.type in ("number", "factor") for operand in node.children[::2])
    return False


def _definition(node: parso.tree.NodeOrLeaf) -> str:
    defined = [above for above in _ancestors(node) if above.type in ("funcdef", "classdef")]
    return ".".join(above.name.value for above in reversed(defined))
