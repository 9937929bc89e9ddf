"""The way to the loop: numbered commands in the shared ring, answered by `reply` events."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any

from seod.protocol import BUSY, NO_ANSWER, REFUSED, RpcError

if TYPE_CHECKING:
    from collections.abc import Callable

    from seod.ring import MessageRing

ANSWER_S = 1.0
RESTART_S = 20.0
"""A new loop must tick within this time after a reset asked for it."""
MAX_WAITING = 64
"""Commands under way; a quarter of the ring, so that none is overwritten before the loop reads it."""


class Mailbox:
    """Puts commands into the ring and gives each its answer.

    Args:
        ring: The shared command ring.
        restart_loop: Asks the supervisor for a new loop process.
        answer_s: How long the loop may take to answer [s].
    """

    def __init__(
        self, ring: MessageRing, restart_loop: Callable[[], None], answer_s: float = ANSWER_S
    ) -> None:
        self.ticking = False
        self.dead_why = ""
        """Why there is no loop any more; "" while there is one, or while the first has not started yet."""
        self._known = asyncio.Event()
        """Set once the first loop ticks, or has died before."""
        self._ring = ring
        self._restart_loop = restart_loop
        self._answer_s = answer_s
        self._dead_generation = 0
        self._last_id = 0
        self._waiting: dict[int, asyncio.Future[dict[str, Any]]] = {}
        self._restarted: asyncio.Future[None] | None = None

    async def post(self, op: str, axis: int | None, values: dict[str, Any] | None = None) -> None:
        """Send one command and wait until the loop has carried it out.

        Raises:
            RpcError: REFUSED with the loop's reason; NO_ANSWER; BUSY (never for `estop`).
        """
        await self._first_tick()
        if self.dead_why:
            raise RpcError(NO_ANSWER, f"there is no loop: {self.dead_why}; `reset` starts a new one")
        if len(self._waiting) >= MAX_WAITING and op != "estop":
            raise RpcError(BUSY, f"{MAX_WAITING} commands wait for the loop already; try again")
        self._last_id += 1
        number = self._last_id
        future = self._waiting[number] = asyncio.get_running_loop().create_future()
        self._ring.put({"id": number, "op": op, "axis": axis, "values": values or {}})
        try:
            async with asyncio.timeout(self._answer_s):
                reply = await future
        except TimeoutError:
            raise RpcError(NO_ANSWER, f"the loop did not answer {op!r} within {self._answer_s:g} s") from None
        finally:
            del self._waiting[number]
        if not reply.get("ok"):
            raise RpcError(REFUSED, str(reply.get("error") or f"the loop refused {op!r}"))

    def send(self, op: str, axis: int, values: dict[str, Any]) -> None:
        """Send one command that nobody waits for: events tell what became of it."""
        if self.ticking:
            self._last_id += 1
            self._ring.put({"id": self._last_id, "op": op, "axis": axis, "values": values})

    async def _first_tick(self) -> None:
        """Wait until the loop has started, for as long as it may take to answer."""
        try:
            async with asyncio.timeout(self._answer_s):
                await self._known.wait()
        except TimeoutError:
            raise RpcError(NO_ANSWER, "the loop has not started yet; try again") from None

    def answered(self, reply: dict[str, Any]) -> None:
        """Take a `reply` event; one that nobody waits for any more is dropped."""
        future = self._waiting.get(reply["id"])
        if future is not None and not future.done():
            future.set_result(reply)

    def rows_come(self) -> None:
        """Rows are proof of a loop, should its `started` event have been lost."""
        self.ticking = not self.dead_why
        self._known.set()

    def loop_started(self, generation: int) -> bool:
        """Take a `started` event; False if that loop has died meanwhile."""
        if generation <= self._dead_generation:
            return False
        self.ticking = True
        self._known.set()
        self.dead_why = ""
        if self._restarted is not None and not self._restarted.done():
            self._restarted.set_result(None)
        return True

    def loop_died(self, generation: int, why: str) -> None:
        """The loop is gone: what it has not answered it never will."""
        self.ticking = False
        self._known.set()
        self.dead_why = why
        self._dead_generation = generation
        for number, future in self._waiting.items():
            if not future.done():
                future.set_result({"id": number, "ok": False, "error": f"the loop died meanwhile: {why}"})
        if self._restarted is not None and not self._restarted.done():
            self._restarted.set_exception(RpcError(REFUSED, f"the new loop failed: {why}"))

    async def restart(self) -> None:
        """Have a new loop started and wait until it ticks; callers meanwhile share it.

        Raises:
            RpcError: It does not come up.
        """
        if self._restarted is None or self._restarted.done():
            self._restarted = asyncio.get_running_loop().create_future()
            self._restart_loop()
        try:
            async with asyncio.timeout(RESTART_S):
                await asyncio.shield(self._restarted)
        except TimeoutError:
            raise RpcError(NO_ANSWER, f"no new loop ticks within {RESTART_S:g} s") from None
