"""Runs the episodes of a study on a cluster of Ray; imported for that only."""

import faulthandler
import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from types import FrameType
from typing import Any, NoReturn

import ray
from ray.exceptions import RayError
from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

from onebot_control.evaluation.episode import TookTooLong, run_packed, unpacked
from onebot_control.evaluation.rows import EpisodeOutcome, Outcomes, machine_facts
from onebot_control.evaluation.workers import DIED, prepare_worker, too_long
from onebot_description.errors import OneBotError

_RETRIES = 1  # retries of a case whose worker or node died
_GRACE = 10.0  # s after its time until an episode that stays in compiled code is ended
_PROCESSOR = "processor"


class Cluster:
    """The cluster of RAY_ADDRESS or of ``ray start``; without any, Ray starts one here.

    Attributes:
        facts: the versions that all nodes have, and their processors.
    """

    def __init__(self, packed: bytes, workers: int | None) -> None:
        """Connect to it, and check that the work can be done on each node.

        Args:
            packed: the work.
            workers: how many episodes run at once; None for as many as there are processors.

        Raises:
            OneBotError: there is no such cluster, or a node has another version of a package.
        """
        self._is_own = not ray.is_initialized()
        if self._is_own:
            try:
                ray.init(include_dashboard=False, log_to_driver=False, logging_level="error")
            except Exception as error:  # Ray raises plain ones, too
                raise OneBotError(f"Ray's cluster cannot be used: {_sentence(error)}") from None
        try:
            self.facts = _common_facts(packed)
        except BaseException:
            self._close()
            raise
        # Twice as many as there are processors, so that none waits for the next one.
        self._most = workers or 2 * max(1, int(ray.cluster_resources().get("CPU", 1)))
        self._packed = packed

    def run(self, cases: Iterator[tuple[int, bytes]], timeout: float) -> Outcomes:
        """Run episodes on all nodes; yield their outcomes as they come, as ``workers`` does."""
        episode = ray.remote(num_cpus=1, max_retries=_RETRIES)(_run)
        packed = ray.put(self._packed)
        running: dict[Any, int] = {}
        try:
            while True:
                while len(running) < self._most and (task := next(cases, None)):
                    running[episode.remote(packed, task[1], timeout)] = task[0]
                if not running:
                    return
                done, _ = ray.wait([*running], num_returns=1)
                for reference in done:
                    number = running.pop(reference)
                    try:
                        yield number, ray.get(reference)
                    except RayError:
                        yield number, EpisodeOutcome(b"", DIED)
        finally:
            for reference in running:
                ray.cancel(reference, force=True)
            self._close()

    def _close(self) -> None:
        if self._is_own:
            ray.shutdown()


def _common_facts(packed: bytes) -> dict[str, str]:
    """Return the facts of all nodes; each imports what the work needs.

    Raises:
        OneBotError: a node cannot, or differs from this computer in a version.
    """

    # It is sent by value, since a node may lack this package.
    def facts_of_node(packed: bytes) -> dict[str, str] | str:
        try:
            from onebot_control.evaluation.episode import unpacked
            from onebot_control.evaluation.rows import machine_facts

            unpacked(packed)
            return machine_facts()
        except Exception as error:
            return f"{type(error).__name__}: {error}"

    own = machine_facts()
    processors = set()
    for node in ray.nodes():
        if not (node["Alive"] and node["Resources"].get("CPU")):
            continue
        where = NodeAffinitySchedulingStrategy(node["NodeID"], soft=False)
        ask = ray.remote(num_cpus=0, scheduling_strategy=where)(facts_of_node)
        name = f"Ray's node {node['NodeManagerAddress']}"
        try:
            facts = ray.get(ask.remote(packed))
        except RayError as error:
            raise OneBotError(f"{name} cannot be used: {_sentence(error)}") from None
        if isinstance(facts, str):
            text = "install there what is installed here"
            raise OneBotError(f"{name} cannot run the study: {facts}; {text}")
        processors.add(facts.pop(_PROCESSOR))
        for package in own.keys() - {_PROCESSOR}:
            if facts.get(package) != own[package]:
                text = f"has {package} {facts.get(package)}, but this computer {own[package]}"
                raise OneBotError(f"{name} {text}; install the same version")
    return {**own, _PROCESSOR: " and ".join(sorted(processors))}


def _sentence(error: Exception) -> str:
    return " ".join(str(error).split())


def _run(packed: bytes, case: bytes, timeout: float) -> EpisodeOutcome:
    """Run an episode, in a process of Ray."""
    _prepare()
    unpacked(packed)  # imports are no part of an episode's time
    try:
        with _ended_after(timeout):
            return run_packed(packed, case)
    except TookTooLong:
        return too_long(timeout)


@cache
def _prepare() -> None:
    prepare_worker()


@contextmanager
def _ended_after(timeout: float) -> Iterator[None]:
    """End what runs in this context after some time; the process, if compiled code does not end."""

    def end(number: int, frame: FrameType | None) -> NoReturn:
        raise TookTooLong

    if timeout == float("inf"):
        yield
        return
    former_handler = signal.signal(signal.SIGALRM, end)
    with open(os.devnull, "w") as nowhere:
        faulthandler.dump_traceback_later(timeout + _GRACE, exit=True, file=nowhere)
        signal.setitimer(signal.ITIMER_REAL, timeout)
        try:
            yield
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            faulthandler.cancel_dump_traceback_later()
            signal.signal(signal.SIGALRM, former_handler)
