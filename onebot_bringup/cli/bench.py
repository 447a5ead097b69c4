"""``onebot bench``: how fast it is, against floors measured in the same run."""

import sys
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

from onebot_description.errors import OneBotError

_CHECKOUT = Path(__file__).resolve().parents[2]


def run(argv: Sequence[str]) -> int:
    """Run the command and return its exit code; see tests/benchmarks.

    Raises:
        OneBotError: this is no checkout, or a benchmark cannot be run or got a wrong answer.
    """
    if not (_CHECKOUT / "tests/benchmarks/command.py").is_file():
        raise OneBotError(
            "the benchmarks are not installed, they lie in the repository's tests/benchmarks: "
            "get a checkout and there run: pip install -e . && onebot bench"
        )
    if str(_CHECKOUT) not in sys.path:
        sys.path.insert(0, str(_CHECKOUT))
    return int(import_module("tests.benchmarks.command").main(argv))
