"""Clients in their turn: work that fails costs that client alone."""

from __future__ import annotations

import asyncio
from typing import Any

from seod.gateway.turns import Turns


def test_work_that_fails_does_not_end_that_of_the_others() -> None:
    served, failed = [], []

    def fails() -> bool:
        raise MemoryError

    def works() -> bool:
        served.append(1)
        return len(served) < 3

    async def main() -> None:
        loop = asyncio.get_running_loop()
        loop.set_exception_handler(lambda _, context: failed.append(context["exception"]))
        turns = Turns()
        turns.sending.add(fails)
        await asyncio.sleep(0)
        turns.sending.add(works)  # asked after the failure
        for _ in range(1000):
            await asyncio.sleep(0)

    asyncio.run(main())
    assert [type(each) for each in failed] == [MemoryError]
    assert len(served) == 3


def test_work_behind_one_that_fails_is_still_done() -> None:
    served: list[str] = []

    def fails() -> bool:
        raise MemoryError

    def works() -> Any:
        served.append("done")

    async def main() -> None:
        asyncio.get_running_loop().set_exception_handler(lambda *_: None)
        turns = Turns()
        turns.commands.add(fails)
        turns.commands.add(works)
        turns.sending.add(works)
        for _ in range(1000):
            await asyncio.sleep(0)

    asyncio.run(main())
    assert served == ["done", "done"]
