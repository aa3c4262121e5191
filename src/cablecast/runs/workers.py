"""Numbered tasks, in this process or on the workers of a Ray cluster.

A task is a function of plain arguments, so that it gives the same wherever it runs. Its result
comes back to this process, which alone writes files. A worker or a node that dies costs the tasks
that it had under way: Ray gives them to another one.
"""

import contextlib
import os
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from cablecast.errors import CablecastError, InputError, MissingExtraError

LOCAL, RAY = "local", "ray"

# Tasks that wait for each worker, so that none is idle while a result travels; more would only
# hold memory.
_TASKS_PER_CORE = 2
_STARTED_TASKS_MIN = 4


def check_workers(workers: str) -> str:
    """Return the workers of a run if they can be had.

    They are "local" for this process, "ray" for a cluster on this machine or the one that the
    process is already connected to, or "ray:ADDRESS" for a cluster.

    Raises:
        InputError: They are none of these.
        MissingExtraError: Ray is not installed.
    """
    kind, colon, address = str(workers).partition(":")
    if workers == LOCAL:
        return workers
    if kind != RAY or bool(colon) != bool(address):
        raise InputError(f"workers {str(workers)[:80]!r} must be local, ray or ray:ADDRESS")
    import importlib.util

    if importlib.util.find_spec("ray") is None:
        raise MissingExtraError("ray", "ray", "work on a cluster")
    return workers


@contextlib.contextmanager
def connected(workers: str) -> Iterator[None]:
    """Keep the connection to a cluster through several runs of tasks; nothing for this process.

    Raises:
        InputError: The cluster cannot be reached.
    """
    if check_workers(workers) == LOCAL:
        yield
        return
    import ray

    if ray.is_initialized():
        yield
        return
    _connect(workers.partition(":")[2])
    try:
        yield
    finally:
        ray.shutdown()


def run_tasks(
    function: Callable[..., Any],
    tasks: Sequence[tuple[int, tuple[Any, ...]]],
    workers: str = LOCAL,
    shared: tuple[Any, ...] = (),
) -> Iterator[tuple[int, Any]]:
    """Yield the number and the result of each numbered task, in any order; see `check_workers`.

    The function is one of a module. Its last arguments are the shared ones, which travel to each
    node once.

    Raises:
        InputError: The cluster cannot be reached.
        CablecastError: A task raised it.
    """
    if workers == LOCAL:
        for number, arguments in tasks:
            yield number, function(*arguments, *shared)
        return
    with connected(workers):
        yield from _run_on_ray(function, tasks, shared)


def _run_on_ray(
    function: Callable[..., Any],
    tasks: Sequence[tuple[int, tuple[Any, ...]]],
    shared: tuple[Any, ...],
) -> Iterator[tuple[int, Any]]:
    import ray

    # A node may die more than once during a long run: a task is tried until it is done.
    remote = ray.remote(num_cpus=1, max_retries=-1)(function)
    references = [ray.put(value) for value in shared]
    limit = max(_STARTED_TASKS_MIN, _TASKS_PER_CORE * int(_core_count()))
    waiting, running = list(reversed(tasks)), {}
    while waiting or running:
        while waiting and len(running) < limit:
            number, arguments = waiting.pop()
            running[remote.remote(*arguments, *references)] = number
        ready, _ = ray.wait(list(running), num_returns=1)
        for reference in ready:
            yield running.pop(reference), _result(reference)


def _connect(address: str) -> None:
    """Connect to a cluster, or start one on this machine."""
    import logging

    import ray

    # No usage statistics are sent.
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    options: dict[str, Any] = {"address": address} if address else {"include_dashboard": False}
    try:
        ray.init(log_to_driver=False, logging_level=logging.ERROR, **options)
    except (ConnectionError, RuntimeError, ValueError, TimeoutError) as error:
        line = " ".join(str(error).split())[:200]
        raise InputError(f"no Ray cluster at {address or 'this machine'}: {line}") from None


def _core_count() -> float:
    import ray

    return ray.cluster_resources().get("CPU", 1.0)


def _result(reference: Any) -> Any:
    """Return the result of a task, or raise what it raised."""
    import ray
    from ray.exceptions import RayTaskError

    try:
        return ray.get(reference)
    except RayTaskError as error:
        if isinstance(error.cause, CablecastError):
            raise error.cause from None
        raise
