"""Calls by a cluster of Dask end, whatever happens to their answers."""

import time
from collections.abc import Iterator
from concurrent.futures import CancelledError
from typing import Any

import pytest

from pinarm.use.workers.dask_calls import submit

distributed = pytest.importorskip("distributed")
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def client() -> Iterator[Any]:
    with distributed.Client(
        processes=False, n_workers=1, threads_per_worker=1, dashboard_address="127.0.0.1:0"
    ) as client:  # fmt: skip
        yield client


def test_what_a_call_returns_or_raises_comes_back(client: Any) -> None:
    assert submit(client, {}, divmod, 7, 2).result(10) == (3, 1)
    with pytest.raises(ZeroDivisionError):
        submit(client, {}, divmod, 7, 0).result(10)


def test_a_call_whose_answer_is_lost_on_the_way_fails(client: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """The executor of Dask itself leaves its future without an end."""

    async def lost(*_: Any, **__: Any) -> None:
        raise distributed.KilledWorker("call", "worker", 1)

    monkeypatch.setattr(client, "_gather", lost)
    with pytest.raises(distributed.KilledWorker):
        submit(client, {}, divmod, 8, 3).result(10)


def test_a_call_is_called_off(client: Any) -> None:
    submit(client, {}, time.sleep, 0.2)
    waiting = submit(client, {}, divmod, 9, 4)
    assert waiting.cancel()
    with pytest.raises(CancelledError):
        waiting.result(10)
