"""A loop on the bench for each test."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

from tests.unit.loop_bench import Bench

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator


@pytest.fixture
def bench() -> Iterator[Callable[..., Bench]]:
    made: list[Bench] = []

    def make(changes: dict[str, Any] | None = None) -> Bench:
        made.append(Bench(changes))
        made[-1].run(0.05)
        return made[-1]

    yield make
    for each in made:
        each.close()
