"""What the launcher is asked to run: one node, one process."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Literal

from onebot_bringup.launcher.opening import module_command, python_environment

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
        module: the Python module that it is, if an interpreter may stand by for it; else empty.
        nice: how far it stands back where processors are short, 0 to 19 (see nice(2)).
    """

    name: str
    command: tuple[str, ...]
    on_exit: OnExit = "shutdown"
    environment: Mapping[str, str] = field(default_factory=dict)
    restart: Restart = Restart()
    hold_interrupt: bool = False
    module: str = ""
    nice: int = 0

    @property
    def arguments(self) -> tuple[str, ...]:
        """What a Python module gets as arguments."""
        return self.command[len(module_command(self.module)) :]


def python_node(
    name: str,
    module: str,
    arguments: Iterable[str] = (),
    *,
    on_exit: OnExit = "shutdown",
    environment: Mapping[str, str] | None = None,
    nice: int = 0,
) -> Node:
    """Return a node that is a Python module, run by the interpreter that runs the launcher."""
    command = (*module_command(module), *arguments)
    variables = {**python_environment(), **(environment or {})}
    return Node(name, command, on_exit, variables, hold_interrupt=True, module=module, nice=nice)
