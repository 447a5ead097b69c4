"""Several hosts on this computer: network namespaces, each with a cable to one switch.

Each has its own interfaces, name and /dev/shm, so that only packets connect them. The namespaces
are held by a process each and have no names: when it ends, however it does, nothing is left.
"""

import os
import shutil
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path

from onebot_description.errors import OneBotError
from tests.support import run_to_end

PROGRAMS = {"ip": "iproute2", "nsenter": "util-linux", "unshare": "util-linux"}
_READY = "ready"
_HOLD = f"mount -t tmpfs tmpfs /dev/shm && ip link set lo up && echo {_READY} && exec cat"


class Namespaces:
    """The namespaces of network, mounts and name of one process, which holds them."""

    def __init__(self, name: str) -> None:
        words = ["unshare", "--net", "--mount", "--uts", "sh", "-c", f"hostname {name} && {_HOLD}"]
        # It ends with its standard input: when this process does.
        self._holder = subprocess.Popen(
            words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        assert self._holder.stdout is not None
        if self._holder.stdout.readline().strip() != _READY:
            self.close()
            raise OneBotError(f"no network namespace could be made for {name}")

    @property
    def pid(self) -> int:
        """Of the process that holds them."""
        return self._holder.pid

    def command(self, words: Sequence[str]) -> list[str]:
        """Return the command that runs ``words`` here, in the folder it is started in."""
        enter = ["nsenter", "-t", str(self.pid), "--net", "--mount", "--uts", "--"]
        return [*enter, "env", "-C", str(Path.cwd()), *words]

    def ip(self, *words: str) -> None:
        """Run ``ip`` here."""
        done = run_to_end(self.command(["ip", *words]))
        if done.returncode:
            raise OneBotError(f"ip {' '.join(words)}: {done.stderr.strip()}")

    def close(self) -> None:
        """End what holds them; they go with the last process in them."""
        self._holder.kill()
        self._holder.wait()
        for pipe in (self._holder.stdin, self._holder.stdout):
            if pipe is not None:
                pipe.close()


class Host:
    """A host with the interface eth0 at ``address``."""

    def __init__(self, spaces: Namespaces, switch: Namespaces, number: int) -> None:
        self.spaces, self._switch = spaces, switch
        self.address = f"10.77.0.{number}"
        self._port = f"port{number}"
        switch.ip(
            *("link", "add", self._port, "type", "veth"),
            *("peer", "name", "eth0", "netns", str(spaces.pid)),
        )
        switch.ip("link", "set", self._port, "master", "switch", "up")
        spaces.ip("address", "add", f"{self.address}/24", "dev", "eth0")
        spaces.ip("link", "set", "eth0", "up")

    def command(self, words: Sequence[str]) -> list[str]:
        """Return the command that runs ``words`` on this host."""
        return self.spaces.command(words)

    def plug(self, connected: bool) -> None:
        """Connect or disconnect the cable."""
        self._switch.ip("link", "set", self._port, "up" if connected else "down")


def missing() -> str:
    """Return what this computer lacks for hosts, and what to do; empty if nothing."""
    for program, package in PROGRAMS.items():
        if shutil.which(program) is None:
            return f'the program "{program}": apt-get install {package}'
    return "" if os.geteuid() == 0 else "network namespaces, which only root can make: sudo"


@contextmanager
def connected_hosts(*names: str) -> Iterator[list[Host]]:
    """Hosts of these names, connected to one switch, in an environment with subnet discovery."""
    with ExitStack() as stack:
        switch = stack.enter_context(closing(Namespaces("switch")))
        # Without waiting for other switches (STP), and sending multicast to all ports.
        switch.ip("link", "add", "switch", "type", "bridge", "mcast_snooping", "0")
        switch.ip("link", "set", "switch", "up")
        yield [
            Host(stack.enter_context(closing(Namespaces(name))), switch, number)
            for number, name in enumerate(names, 1)
        ]
