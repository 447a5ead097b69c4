"""Traffic and processor time of discovery: by multicast on a subnet, and by a discovery server.

``sudo .venv/bin/python -m tests.benchmarks.discovery [--write README] [COUNT ...]``. Each robot is
a process on a host of its own (a network namespace), which needs root; so does the operator, on
another host, and the discovery server.
"""

import argparse
import os
import select
import sys
import time
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

from onebot_description.discovery import discovery_variables
from onebot_description.errors import OneBotError
from tests.benchmarks import machine
from tests.benchmarks.hosts import Host, connected_hosts, missing
from tests.benchmarks.measuring import Running, cpu_ns
from tests.benchmarks.registry import say_on_stderr
from tests.benchmarks.report import Value, markdown_table, plain_table
from tests.benchmarks.saving import write_section

COUNTS = (1, 10, 50)
MARKS = "<!-- discovery -->", "<!-- /discovery -->"
SUBNET, SERVER = "subnet", "discovery server"
_PORT = 11811
_SETTLE = 5.0  # s after the start, which are of neither
_STEADY = 20.0  # s
_PATIENCE = 120.0  # s for all to be discovered
_NOTES = (
    "Every robot is a process on a host of its own, with the topics of a controller in its "
    "namespace; an operator's process subscribes to /tf of all and sees the whole graph. Nobody "
    "publishes: what is counted is discovery alone. The start is from when all are told to start "
    "ROS, at once, until the operator has discovered all, and 5 s more. Packets are those "
    "received, by all hosts together: one that is multicast counts once for each that gets it. "
    "Processor time is of all robots together, with the server's, if any; at the start it is also "
    "that of making the nodes."
)


def run(counts: Sequence[int], steady: float = _STEADY) -> list[dict[str, Value]]:
    """Measure; return the rows of the table.

    Raises:
        OneBotError: it cannot be done here, or not all robots were discovered.
    """
    if problem := missing():
        raise OneBotError(f"this benchmark needs {problem}")
    rows = []
    for count in counts:
        for way in (SUBNET, SERVER):
            say_on_stderr(f"discovery: {count} robots, {way}")
            rows.append(_measure(count, way, steady))
            say_on_stderr(str(rows[-1]))
    return rows


def _measure(count: int, way: str, steady: float) -> dict[str, Value]:
    names = [f"robot{number}" for number in range(1, count + 1)]
    with connected_hosts("operator", "server", *names) as hosts, ExitStack() as stack:
        for host in hosts:
            host.know(hosts)
        operator_host, server_host, *robot_hosts = hosts
        where = f"{server_host.address}:{_PORT}" if way == SERVER else SUBNET
        variables = discovery_variables({"discovery": where, "domain_id": "0"}, forced=True)
        environment = {**os.environ, **variables}

        def start(host: Host, *words: str, pipes: bool = True) -> Running:
            return stack.enter_context(Running(host.command(words), environment, pipes=pipes))

        servers = []
        if way == SERVER:
            words = ("fast-discovery-server", "-i", "0", "-p", str(_PORT))
            servers.append(start(server_host, *words, pipes=False))
            servers[0].wait_for(lambda: "running" in servers[0].output, "the server")
        module = (sys.executable, "-m", "tests.benchmarks.participant")
        operator = start(operator_host, *module, "operator", str(count))
        robots = [start(h, *module, "robot", n) for h, n in zip(robot_hosts, names, strict=True)]
        processes = [operator, *robots]
        for process in processes:
            _expect(process, "ready")

        counted = _Counter(hosts, [*robots, *servers])
        began = time.monotonic()
        for process in processes:
            assert process.process.stdin is not None
            process.process.stdin.write("\n")
            process.process.stdin.flush()
        for robot in robots:
            _expect(robot, "up")
        _expect(operator, "all")
        took = time.monotonic() - began
        time.sleep(_SETTLE)
        packets, size, busy = counted.since()
        start_row: dict[str, Value] = {
            "robots": count,
            "discovery": way,
            "all discovered s": took,
            "start: packets": packets,
            "start: MB": size / 1e6,
            "start: CPU s": busy,
        }
        counted = _Counter(hosts, [*robots, *servers])
        time.sleep(steady)
        packets, size, busy = counted.since()
        for process in processes:
            process.interrupt()  # all at once: the end of the context waits for each
        return start_row | {
            "then: packets/s": packets / steady,
            "then: kB/s": size / 1e3 / steady,
            "then: CPU ms/s": busy / steady * 1e3,
        }


class _Counter:
    """Counts from its making on."""

    def __init__(self, hosts: Sequence[Host], processes: Sequence[Running]) -> None:
        self._hosts, self._processes = hosts, processes
        self._before = self._now()

    def since(self) -> tuple[int, int, float]:
        """Return packets and bytes received by all hosts, and processor time in seconds."""
        now = self._now()
        packets, size, busy = (b - a for a, b in zip(self._before, now, strict=True))
        return int(packets), int(size), busy * 1e-9

    def _now(self) -> tuple[int, int, int]:
        received = [host.received() for host in self._hosts]
        pids = [pid for process in self._processes for pid in process.pids]
        return sum(r.packets for r in received), sum(r.bytes for r in received), cpu_ns(*pids)


def _expect(process: Running, word: str) -> None:
    stdout = process.process.stdout
    assert stdout is not None
    ready, _, _ = select.select([stdout], [], [], _PATIENCE)
    line = stdout.readline().strip() if ready else ""
    if line != word:
        process.check()
        raise OneBotError(f'a participant printed "{line}", not "{word}"')


def main() -> int:
    """Measure, print the table, and with ``--write`` put it into a README."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("counts", nargs="*", type=int, default=COUNTS, metavar="COUNT")
    parser.add_argument("--write", type=Path, metavar="README")
    args = parser.parse_args()
    described = machine.sentence(machine.describe())
    try:
        rows = run(args.counts)
    except OneBotError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    print(plain_table(rows))
    if args.write:
        text = f"Measured on: {described}.\n\n{markdown_table(rows)}\n\n{_NOTES}\n"
        write_section(args.write, text, MARKS)
    return 0


if __name__ == "__main__":
    sys.exit(main())
