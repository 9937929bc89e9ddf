"""A supervisor for each test, as it is made and as it runs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

from tests.unit.supervisor_bench import Bench

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator


@pytest.fixture
def make(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Bench]]:
    made: list[Bench] = []

    def one(**changes: Any) -> Bench:
        made.append(Bench(monkeypatch, **changes))
        return made[-1]

    yield one
    for bench in made:
        bench.close()


@pytest.fixture
def bench(make: Callable[..., Bench]) -> Bench:
    return make()


@pytest.fixture
def running(bench: Bench) -> Bench:
    return bench.started()
