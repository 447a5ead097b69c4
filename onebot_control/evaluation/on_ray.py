"""Runs the episodes of a study on a Ray cluster; only imported if needed."""

import os
import socket
import threading
from collections.abc import Iterator
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from tempfile import gettempdir
from typing import Any
from urllib.parse import urlsplit

import ray
from ray.exceptions import RayError
from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

from onebot_control.evaluation.episode import sentence
from onebot_control.evaluation.rows import PROCESSOR, EpisodeOutcome, Outcomes, machine_facts
from onebot_control.evaluation.workers import DIED, Worker
from onebot_description.errors import OneBotError

_PATIENCE = 5.0  # s, timeout of a connection to the cluster's address
_LAST = "ray/ray_current_cluster"
_ATTEMPTS = "RAY_gcs_server_port_wait_time_s"  # Ray's number of attempts to connect


def connected(packed: bytes) -> dict[str, str]:
    """Connect to the cluster of RAY_ADDRESS or ``ray start``; else Ray starts one here.

    Args:
        packed: the work, which each node must be able to import.

    Returns:
        The versions on all nodes, and their processors.

    Raises:
        OneBotError: the cluster does not exist, or a node has another version of a package.
    """
    if not ray.is_initialized():
        _require_answer()
        try:
            ray.init(include_dashboard=False, log_to_driver=False, logging_level="error")
        except Exception as error:  # Ray also raises plain exceptions
            raise OneBotError(f"Ray's cluster cannot be used: {sentence(error)}") from None
    return _common_facts(packed)


def _require_answer() -> None:
    """Reject an address that does not respond; Ray itself would log about it for minutes."""
    address = os.environ.get("RAY_ADDRESS", "")
    if address in ("", "auto"):  # then Ray uses the address of the last ``ray start``
        with suppress(OSError):
            address = Path(os.environ.get("RAY_TMPDIR") or gettempdir(), _LAST).read_text().strip()
    try:
        place = urlsplit(address if "://" in address else f"//{address}")
        if place.hostname and place.port:
            os.environ.setdefault(_ATTEMPTS, "1")
            socket.create_connection((place.hostname, place.port), _PATIENCE).close()
    except (OSError, ValueError) as error:
        text = f"Ray's cluster {address} does not respond: {sentence(error)}"
        remedy = 'start it with "ray start --head", or set RAY_ADDRESS (local: only this computer)'
        raise OneBotError(f"{text}; {remedy}") from None


def _common_facts(packed: bytes) -> dict[str, str]:
    """Return the facts of all nodes, after each has imported the modules of the work."""

    # This function is sent by value, since a node may lack this package.
    def facts_of_node(packed: bytes) -> dict[str, str]:
        from onebot_control.evaluation.episode import unpacked
        from onebot_control.evaluation.rows import machine_facts

        unpacked(packed)
        return machine_facts()

    facts, processors = machine_facts(), set()
    for node in ray.nodes():
        if not (node["Alive"] and node["Resources"].get("CPU")):
            continue
        where = NodeAffinitySchedulingStrategy(node["NodeID"], soft=False)
        ask = ray.remote(num_cpus=0, scheduling_strategy=where)(facts_of_node)
        name = f"Ray's node {node['NodeManagerAddress']}"
        try:
            others = ray.get(ask.remote(packed))
        except RayError as error:
            text = f"{name} cannot run the study: {sentence(getattr(error, 'cause', error))}"
            raise OneBotError(f"{text}; install the packages of this computer there") from None
        processors.add(others[PROCESSOR])
        for package in facts.keys() - {PROCESSOR}:
            if others.get(package) != facts[package]:
                other = f"{package} {others[package]}" if package in others else f"no {package}"
                text = f"{name} has {other}, but this computer {facts[package]}"
                raise OneBotError(f"{text}; install the same version")
    return {**facts, PROCESSOR: " and ".join(sorted(processors))}


def run_on_ray(
    packed: bytes, cases: Iterator[tuple[int, bytes]], count: int | None, timeout: float
) -> Outcomes:
    """Run episodes on all nodes; yield their outcomes as they end.

    Args:
        packed: the work.
        cases: numbers and packed cases.
        count: number of concurrent episodes; None for the number of processors.
        timeout: s of wall time after which an episode is ended.
    """
    # Twice the number of processors, so that no processor waits for its next episode.
    limit = count or 2 * max(1, int(ray.cluster_resources().get("CPU", 1)))
    episode, work = ray.remote(num_cpus=1)(_run), ray.put(packed)
    running: dict[Any, int] = {}
    try:
        while True:
            while len(running) < limit and (task := next(cases, None)):
                running[episode.remote(work, task[1], timeout)] = task[0]
            if not running:
                return
            reference = ray.wait([*running])[0][0]
            try:
                outcome = ray.get(reference)
            except RayError:
                outcome = EpisodeOutcome(b"", DIED)
            yield running.pop(reference), outcome
    finally:
        for reference in running:
            ray.cancel(reference, force=True)


@lru_cache(maxsize=1)
def _worker(packed: bytes) -> Worker:
    from onebot_description.ros.process_start import blas_variables

    os.environ.update(blas_variables())
    return Worker(packed, threading.Event())


def _run(packed: bytes, case: bytes, timeout: float) -> EpisodeOutcome:
    """Run an episode in a process beside Ray's, as Ray itself cannot end one that hangs."""
    return _worker(packed).run(case, timeout)
