"""A Dask cluster that only its own coordinator can use: TLS with a certificate of its own, no HTTP
servers, loopback addresses.

Whoever can send a message to a scheduler or a worker of Dask runs code as their user, and any user
of the machine reaches loopback addresses. Dask's own local cluster takes messages from anybody, and
opens an HTTP server for each process.
"""

from __future__ import annotations

import logging
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from distributed import Client, Nanny, Scheduler, Security, SpecCluster, Worker

from microvib.io.files import library
from microvib.io.writing import workspace
from microvib.studies.workers import quiet_tracker

LOOPBACK = "127.0.0.1"


class _Quiet:
    """A server without the HTTP server that Dask gives to each."""

    def start_http_server(self, *args: Any, **options: Any) -> None:
        """Start none."""


class QuietScheduler(_Quiet, Scheduler):
    """A scheduler without an HTTP server."""


class QuietWorker(_Quiet, Worker):
    """A worker without an HTTP server."""


@contextmanager
def private_cluster(count: int) -> Iterator[Client]:
    """Client of a new cluster of ``count`` worker processes on this machine.

    The key of its TLS is kept in memory, made for this cluster alone; scheduler and workers take
    nobody without it. What workers write lies in a folder that only its owner can read. Raises
    MicrovibError where ``cryptography`` is missing.
    """
    library("cryptography")
    quiet_tracker()
    security = Security.temporary()
    shared = {"host": LOOPBACK, "protocol": "tls://", "security": security}
    with workspace(Path(tempfile.gettempdir()), "dask") as folder:
        worker = {
            "cls": Nanny,
            "options": {
                **shared,
                "nthreads": 1,
                "worker_class": QuietWorker,
                "dashboard": False,
                "local_directory": str(folder),
                "silence_logs": logging.CRITICAL,
            },
        }
        scheduler = {"cls": QuietScheduler, "options": {**shared, "port": 0, "dashboard": False}}
        with (
            SpecCluster(
                workers=dict.fromkeys(range(count), worker),
                scheduler=scheduler,
                security=security,
                silence_logs=logging.CRITICAL,
            ) as cluster,
            Client(cluster, security=security) as client,
        ):
            client.wait_for_workers(count)
            yield client
