"""A campaign on Dask: a cluster of this machine, or one that runs already. Workers need no file of
the campaign.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from microvib.errors import OptionError
from microvib.studies.workers import Backend

CONNECT_TIMEOUT = "10s"


@dataclass
class _Dask:
    """Chunks are sent whole, and come back as bytes."""

    client: Any
    workers: int
    deaths: tuple[type[BaseException], ...]

    def executor(self) -> Executor:
        """The cluster mends itself: it is the same after a worker died."""
        submitting: Executor = self.client.get_executor(
            pure=False
        )  # each chunk is computed, though alike another
        return submitting

    def watch(self) -> None:
        """The scheduler does: it gives up workers that are silent for five minutes (its
        ``worker-ttl``).
        """


@contextmanager
def dask(workers: int | None = None, scheduler: str | None = None) -> Iterator[Backend]:
    """A cluster of ``workers`` processes on this machine, which nobody else can use, or the one at
    the address ``scheduler``.

    That one is reached with the credentials of Dask's own configuration (``distributed.comm.tls``).
    MicrovibError where no scheduler answers there, or it has no workers.
    """
    from distributed import Client
    from distributed.scheduler import KilledWorker

    if scheduler is None:
        from microvib.studies.campaign.dask_cluster import private_cluster

        count = workers or os.cpu_count() or 1
        with private_cluster(count) as client:
            yield _Dask(client, count, (KilledWorker,))
        return
    try:
        client = Client(scheduler, timeout=CONNECT_TIMEOUT)
    except (OSError, ValueError, TimeoutError) as error:
        raise OptionError(
            "scheduler", f"no Dask scheduler answers there: {error}", scheduler
        ) from None
    with client:
        count = len(client.scheduler_info()["workers"])
        if not count:
            raise OptionError(
                "scheduler", f"has no workers; start some with: dask worker {scheduler}", scheduler
            )
        yield _Dask(client, count, (KilledWorker,))
