"""What the launcher is asked to run: one node, one process."""

import os
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Literal

OnExit = Literal["shutdown", "restart", "ignore"]


@dataclass(frozen=True)
class Restart:
    """How often and how fast a node that ended is started again.

    Attributes:
        limit: how many times in a row before the launcher gives up.
        first_wait: seconds before the first new start; doubled for each further one.
        longest_wait: seconds, the cap of that doubling.
        healthy_after: seconds; a node that lived this long starts counting from zero again.
    """

    limit: int = 5
    first_wait: float = 1.0
    longest_wait: float = 10.0
    healthy_after: float = 30.0

    def wait(self, restarts: int) -> float:
        """Seconds to wait before a start when there were ``restarts`` in a row already."""
        return float(min(self.first_wait * 2.0**restarts, self.longest_wait))


@dataclass(frozen=True)
class Node:
    """One process to run.

    Attributes:
        name: what its lines of output are prefixed with.
        command: the program and its arguments.
        on_exit: what happens when it ends although nobody asked it to: ``"shutdown"`` brings
            everything down, ``"restart"`` starts it again, ``"ignore"`` goes on without it.
        environment: variables added to those of the launcher.
        restart: for ``on_exit="restart"``.
        hold_interrupt: start with SIGINT blocked; the program unblocks it when it is ready for
            it (see ``start_module``).
    """

    name: str
    command: tuple[str, ...]
    on_exit: OnExit = "shutdown"
    environment: Mapping[str, str] = field(default_factory=dict)
    restart: Restart = Restart()
    hold_interrupt: bool = False


def python_node(
    name: str,
    module: str,
    arguments: Iterable[str] = (),
    *,
    on_exit: OnExit = "shutdown",
    environment: Mapping[str, str] | None = None,
) -> Node:
    """Return a node that is a Python module, run by the interpreter that runs the launcher."""
    command = (sys.executable, "-m", "onebot_bringup.launcher.start_module", module, *arguments)
    variables = {"PYTHONUNBUFFERED": "1", **_safe_path(), **(environment or {})}
    return Node(name, command, on_exit, variables, hold_interrupt=True)


def _safe_path() -> dict[str, str]:
    """Keep a stray ``yaml.py`` in the working directory from being imported by the nodes.

    Only where the launcher itself was not found through the working directory.
    """
    here = sys.path[0] in ("", os.getcwd()) if sys.path else False
    return {} if here else {"PYTHONSAFEPATH": "1"}
