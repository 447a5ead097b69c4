"""``onebot bench``: performance, relative to lower bounds measured in the same run."""

import sys
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

from onebot_description.errors import OneBotError

_CHECKOUT = Path(__file__).resolve().parents[2]


def run(argv: Sequence[str]) -> int:
    """Run the command and return its exit code; see tests/benchmarks.

    Raises:
        OneBotError: this is not a checkout, or a benchmark failed.
    """
    if not (_CHECKOUT / "tests/benchmarks/command.py").is_file():
        raise OneBotError(
            "the benchmarks are not installed, they are in the repository's tests/benchmarks: "
            "in a checkout, run: pip install -e . && onebot bench"
        )
    if str(_CHECKOUT) not in sys.path:
        sys.path.insert(0, str(_CHECKOUT))
    return int(import_module("tests.benchmarks.command").main(argv))
