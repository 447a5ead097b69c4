"""Fixtures shared by all tests."""

import gc
import os
import signal
from collections import Counter
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, settings
from xdist.scheduler import LoadScopeScheduling

from tests.orphans import end_with_this_process

_MOST_WORKERS = 16  # each may need more than one of the 100 ROS domains

# nohup and a shell's & make all their children deaf to these, and so what the tests interrupt.
for _number, _handler in (
    (signal.SIGINT, signal.default_int_handler),
    (signal.SIGHUP, signal.SIG_DFL),
):
    if signal.getsignal(_number) == signal.SIG_IGN:
        signal.signal(_number, _handler)

# As a bringup has it: threads of OpenBLAS wait busily in each process that imports numpy.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# Ray would save a token in the home folder, and a process keeps the first that it has used.
os.environ.setdefault("RAY_AUTH_TOKEN", "5" * 64)

# A later run must not discover the nodes of one that was killed.
end_with_this_process()

# How long an example takes is the machine's affair. Each run draws other examples.
settings.register_profile(
    "any machine", deadline=None, max_examples=25, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("any machine")


def pytest_xdist_auto_num_workers(config: pytest.Config) -> int:
    """As many processes as cores for a few files, more for all: tests wait for other processes.

    Those of nodes most of their time; the slow ones draw, too, with all cores.
    """
    cores = len(os.sched_getaffinity(0))
    if config.option.file_or_dir:  # a process would take longer to start than it saves
        return cores
    return min(cores + 2 if config.option.markexpr == "slow" else 3 * cores, _MOST_WORKERS)


def pytest_collection() -> None:
    """What is made until the tests are collected is no garbage."""
    gc.disable()


def pytest_collection_finish() -> None:
    """Collect garbage again, but do not look for it among the tests."""
    gc.freeze()
    gc.enable()


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Of the slow tests alone, import the files that have some: each process imports them all."""
    if config.option.markexpr != "slow" or not collection_path.name.startswith("test_"):
        return None
    return b"mark.slow" not in collection_path.read_bytes() or None


@cache
def _shares(file: Path) -> bool:
    """Whether tests of a file share what takes long to start."""
    return b'scope="module"' in file.read_bytes()


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Begin with what takes long: no process is to be left with it in the end.

    Of the slow tests, those are the files whose tests share something, and those of the whole
    project; of the fast ones the files of few tests, which wait for nodes: beside those of many,
    which compute, all cores have something to do.
    """
    if config.option.markexpr == "slow":
        items.sort(key=lambda item: (not _shares(item.path), len(item.path.parts)))
    else:
        count = Counter(item.path for item in items)
        items.sort(key=lambda item: count[item.path])


class SlowScheduling(LoadScopeScheduling):
    """Each test runs in the next free process, but those that share a browser in one."""

    def _split_scope(self, nodeid: str) -> str:
        file = nodeid.partition("::")[0]
        return file if _shares(self.config.rootpath / file) else nodeid


def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> SlowScheduling | None:
    """Of the slow tests some take a minute, too long for whole files in turn (--dist=loadfile)."""
    config.option.loadscopereorder = False  # it would begin with the files of most tests
    return SlowScheduling(config, log) if config.option.markexpr == "slow" else None


@pytest.fixture
def peer(ros_domain: int) -> Iterator[Any]:
    """Another node of the test's domain, a ``Peer``."""
    from tests.ros_support import Peer  # imports rclpy

    with Peer(ros_domain) as peer:
        yield peer


@pytest.fixture
def start_node(ros_domain: int) -> Iterator[Callable[..., Any]]:
    """Makes a node with these parameters set on its command line."""
    import rclpy  # slow, and most tests do without

    from tests.ros_support import ros_args

    nodes: list[Any] = []

    def make(build: Callable[[], Any], **parameters: Any) -> Any:
        rclpy.init(args=ros_args(**parameters))
        nodes.append(build())
        return nodes[0]

    yield make
    for node in nodes:
        node.destroy_node()
    rclpy.try_shutdown()
