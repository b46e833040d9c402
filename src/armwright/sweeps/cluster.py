"""Dask cluster of a sweep: a given one, or a local one for the duration of the sweep."""

from __future__ import annotations

import contextlib
import logging
import os
from collections.abc import Iterator
from typing import Any

from armwright.errors import ScenarioError

PATIENCE = 10  # [s] until a scheduler is taken to be absent
START = 120  # [s] for a worker of this machine to start, which a loaded processor makes long
LOGGERS = ("distributed", "distributed.client")  # the second has a level of its own
ENVIRONMENT = {  # of Dask's programs on this machine: no log, and seldom a look at what chunks that take seconds do not need
    "DASK_LOGGING__DISTRIBUTED": "critical",
    "DASK_DISTRIBUTED__ADMIN__TICK__INTERVAL": "1s",
    "DASK_DISTRIBUTED__ADMIN__SYSTEM_MONITOR__INTERVAL": "5s",
    "DASK_DISTRIBUTED__WORKER__MEMORY__MONITOR_INTERVAL": "1s",
    "DASK_DISTRIBUTED__WORKER__PROFILE__ENABLED": "False",
}


@contextlib.contextmanager
def connected(client: Any = None) -> Iterator[Any]:
    """A Dask client for the duration of the block.

    Args:
        client: a `distributed.Client`, which stays open; the address of a scheduler; or None: a cluster on this machine, with a
            process for each processor.
    Raises:
        ScenarioError: no scheduler there, or the extra `sweep` is not installed.
    """
    try:
        import distributed
    except ImportError:
        raise ScenarioError(
            "needs distributed, which is not installed", expected="pip install armwright[sweep]"
        ) from None
    if isinstance(client, distributed.Client):
        yield client
        return
    if client is not None and not isinstance(client, str):
        expected = "a distributed.Client, or an address such as 'tcp://host:8786'"
        raise ScenarioError(place="client", value=client, expected=expected)
    if client is not None:
        _check_address(client)
    with contextlib.ExitStack() as stack:
        stack.enter_context(_quiet())
        address = stack.enter_context(local_cluster()) if client is None else client
        try:
            joined = distributed.Client(address, timeout=PATIENCE, set_as_default=False)
        except (OSError, ValueError, TimeoutError) as error:
            what = f"cannot be reached: {' '.join(str(error).split())[:200]}"
            raise ScenarioError(
                what, place="scheduler", value=client, expected="the address of a Dask scheduler"
            ) from None
        yield stack.enter_context(joined)


def _check_address(address: str) -> None:
    """Refuses what is no address of a scheduler, on which a client would hang."""
    from distributed.comm.addressing import get_address_host_port, parse_address
    from distributed.comm.registry import get_backend

    try:
        scheme = parse_address(address)[0]
        get_backend(scheme)
        if scheme in ("tcp", "tls"):
            port = get_address_host_port(address, strict=False)[1]
            if not 0 < port < 65536:
                raise ValueError(f"no port {port}")
    except ValueError as error:
        expected = "the address of a Dask scheduler, such as tcp://host:8786"
        raise ScenarioError(str(error), place="scheduler", value=address, expected=expected) from None


@contextlib.contextmanager
def local_cluster(workers: int | None = None) -> Iterator[Any]:
    """A local Dask cluster, one thread in each worker process; a worker that dies is restarted.

    The workers are started by a program of their own, so that a script needs no `if __name__ == "__main__"`.

    Args:
        workers: how many; default: one for each processor.
    """
    import distributed

    count = workers or os.cpu_count() or 1
    with contextlib.ExitStack() as stack:
        stack.enter_context(_environment())
        if os.name == "nt":
            yield stack.enter_context(
                distributed.LocalCluster(n_workers=count, threads_per_worker=1, dashboard_address=":0")
            )
            return
        from distributed import SpecCluster
        from distributed.deploy.subprocess import SubprocessWorker

        options = {"nthreads": 1, "death_timeout": START, "dashboard": False, "host": "127.0.0.1"}
        worker = {"cls": SubprocessWorker, "options": {"worker_kwargs": options}}
        scheduler = {
            "cls": distributed.Scheduler,
            "options": {"host": "127.0.0.1", "port": 0, "dashboard": False, "dashboard_address": "127.0.0.1:0"},
        }
        several = dict.fromkeys(range(count), worker)
        yield stack.enter_context(SpecCluster(workers=several, scheduler=scheduler, silence_logs=False))


@contextlib.contextmanager
def _environment() -> Iterator[None]:
    """Environment variables of programs that start meanwhile; what the user has set stays."""
    added = {name: value for name, value in ENVIRONMENT.items() if name not in os.environ}
    os.environ |= added
    try:
        yield
    finally:
        for name in added:
            os.environ.pop(name, None)


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Keeps the log of Dask from the terminal; the sweep reports what matters."""
    loggers = [logging.getLogger(name) for name in LOGGERS]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)
