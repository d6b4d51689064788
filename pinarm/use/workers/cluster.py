"""Connection to a Dask cluster that runs already, on this machine or on many."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager, suppress
from importlib import import_module
from typing import Any

from pinarm.errors import InputError

TIMEOUT = 10.0
"""Time in which a scheduler has to answer [s]."""


@contextmanager
def cluster(address: str) -> Iterator[Executor]:
    """Yield the executor of a cluster; nothing listens here.

    Args:
        address: That of its scheduler, such as ``tcp://10.0.0.1:8786``; of ``tls://...`` the certificates are those of
            Dask's own configuration, ``distributed.comm.tls``.

    Raises:
        InputError: Dask is not installed, or no scheduler answers.
    """
    try:
        distributed: Any = import_module("distributed")
    except ImportError:
        raise InputError("Dask is not installed", hint="pip install 'pinarm[cluster]'") from None
    _quieten()
    if address.startswith("tls://") and not distributed.Security().get_connection_args("client").get("ssl_context"):
        raise InputError(f"{address} wants certificates, and none are configured",
                         expected="distributed.comm.tls in Dask's configuration: ca-file, client.key and client.cert",
                         hint="DASK_DISTRIBUTED__COMM__TLS__CA_FILE and the like") from None  # fmt: skip
    try:
        with asyncio.Runner() as runner:  # whose ``run`` would make of an interrupt a cancellation, which may be lost
            # a client that has not found a scheduler takes 20 s to give up
            runner.get_loop().run_until_complete(_identity(distributed, address))
        client = distributed.Client(address, timeout=TIMEOUT, set_as_default=False, name="pinarm")
    except (OSError, ValueError, TypeError, RuntimeError) as error:
        said = (str(error).strip().splitlines() or [type(error).__name__])[0]
        raise InputError(f"no scheduler of Dask answers at {address}: {said}",
                         expected="tcp://HOST:PORT, or tls://HOST:PORT with distributed.comm.tls configured",
                         hint="dask scheduler") from None  # fmt: skip
    try:
        yield client.get_executor()
    finally:
        with suppress(Exception):
            client.close(timeout=1.0)


async def _identity(distributed: Any, address: str) -> None:
    """Ask what listens at an address who it is.

    Raises:
        OSError: It is no scheduler, or does not answer in time.
        ValueError: It is no address.
    """
    given = distributed.Security().get_connection_args("client")
    async with distributed.rpc(address, timeout=TIMEOUT, connection_args=given) as scheduler:
        try:
            found = await asyncio.wait_for(scheduler.identity(), TIMEOUT)
        except TimeoutError:
            raise OSError(f"no answer in {TIMEOUT:.0f} s") from None
    if found.get("type") != "Scheduler":
        raise OSError(f"it is a {found.get('type')}")


def _quieten() -> None:
    """Let Dask print no messages, nor its event loop: that the connection is lost is told by the work under way."""
    names = [name for name in logging.root.manager.loggerDict if name.partition(".")[0] == "distributed"]
    for name in (*names, "tornado.application"):
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)
