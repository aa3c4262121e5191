"""Numbered tasks, in this process, in a process for each core, or on the workers of a Ray cluster.

A task is a function of plain arguments, so that it gives the same wherever it runs. Its result
comes back to this process, which alone writes files. A worker or a node that dies costs the tasks
that it had under way: Ray gives them to another one.
"""

import concurrent.futures
import contextlib
import os
import pickle
import queue
import signal
import subprocess
import sys
import typing
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from cablecast.errors import CablecastError, InputError, MissingExtraError
from cablecast.files import core_count

LOCAL, PROCESSES, RAY = "local", "processes", "ray"

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
    if workers == PROCESSES:
        yield from _run_in_processes(function, tasks, shared)
        return
    with connected(workers):
        yield from _run_on_ray(function, tasks, shared)


def _run_in_processes(
    function: Callable[..., Any],
    tasks: Sequence[tuple[int, tuple[Any, ...]]],
    shared: tuple[Any, ...],
) -> Iterator[tuple[int, Any]]:
    # Not multiprocessing, which would run the user's script again in each process.
    command = [sys.executable, "-c", "from cablecast.runs.workers import serve; serve()"]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    idle: queue.SimpleQueue[subprocess.Popen[bytes]] = queue.SimpleQueue()
    count = min(core_count(), len(tasks))
    with contextlib.ExitStack() as stack:
        pool = stack.enter_context(concurrent.futures.ThreadPoolExecutor(count))
        for _ in range(count):
            process = subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environment
            )
            stack.enter_context(process)
            # Whatever ends this function, no task goes on.
            stack.callback(process.kill)
            idle.put(process)
        stack.callback(pool.shutdown, wait=False, cancel_futures=True)

        def ask(arguments: tuple[Any, ...]) -> Any:
            process = idle.get()
            try:
                asked, answers = (
                    typing.cast(typing.IO, p) for p in (process.stdin, process.stdout)
                )
                pickle.dump((function, (*arguments, *shared)), asked)
                asked.flush()
                return pickle.load(answers)
            except (EOFError, OSError, pickle.UnpicklingError):
                return CablecastError("a process that simulates ended: is there enough memory?")
            finally:
                idle.put(process)

        waiting = {pool.submit(ask, arguments): number for number, arguments in tasks}
        for done in concurrent.futures.as_completed(waiting):
            result = done.result()
            if isinstance(result, BaseException):
                raise result
            yield waiting[done], result


def serve() -> None:
    """Answer tasks from standard input until it ends; see `run_tasks`."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    answers = os.fdopen(os.dup(1), "wb")
    # Libraries may print; an answer must stay whole.
    os.dup2(2, 1)
    with contextlib.suppress(EOFError, BrokenPipeError):
        while True:
            function, arguments = pickle.load(sys.stdin.buffer)
            try:
                result = function(*arguments)
            except Exception as error:
                result = error
            pickle.dump(result, answers)
            answers.flush()


def _run_on_ray(
    function: Callable[..., Any],
    tasks: Sequence[tuple[int, tuple[Any, ...]]],
    shared: tuple[Any, ...],
) -> Iterator[tuple[int, Any]]:
    import ray

    # A node may die more than once during a long run: a task is tried until it is done.
    remote = ray.remote(num_cpus=1, max_retries=-1)(function)
    references = [ray.put(value) for value in shared]
    cores = int(ray.cluster_resources().get("CPU", 1.0))
    limit = max(_STARTED_TASKS_MIN, _TASKS_PER_CORE * cores)
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
