"""Calls by the workers of a Dask cluster, each of which ends, whatever happens to the workers."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import Future
from typing import Any


def submit(client: Any, options: Mapping[str, Any], function: Callable[..., Any], *arguments: Any) -> Future[Any]:
    """Let a worker of a cluster call a function.

    The executor of Dask (``distributed.cfexecutor``, 2026.8) leaves a future without an end where a worker dies between
    the end of a call and the fetching of its answer, and the call fails when it is repeated.

    Args:
        client: A ``distributed.Client`` with its own event loop.
        options: Keywords of its ``submit``.
        function: Importable by its name.
        arguments: Its arguments.

    Returns:
        A future that ends with what the call returns or raises; to cancel it is to cancel the call.
    """
    call = client.submit(function, *arguments, **options)
    outcome = Future[Any]()

    def cancel_call(ended: Future[Any]) -> None:
        if ended.cancelled():
            call.cancel()

    async def pass_on() -> None:
        try:
            answer = await call
        except BaseException as error:  # that of the event loop's end too
            if outcome.set_running_or_notify_cancel():
                outcome.set_exception(error)
        else:
            if outcome.set_running_or_notify_cancel():
                outcome.set_result(answer)

    outcome.add_done_callback(cancel_call)
    client.loop.add_callback(pass_on)
    return outcome
