"""The way to the loop: e-stops by a word that it looks at before all else, commands by a ring.

Commands are numbered; `reply` events answer them.
"""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any, TypeVar

from seod.processes.ring import OVERTAKEN, TOO_OLD, Word
from seod.protocol.jsonrpc import NO_ANSWER, REFUSED, RpcError

if TYPE_CHECKING:
    from collections.abc import Callable

    from seod.processes.ring import Shared

T = TypeVar("T")

ANSWER_S = 1.0
RESTART_S = 20.0
"""A new loop must tick within this time after a reset asked for it."""
MAX_WAITING = 16
"""Commands in the ring; a small part of it, so that none is overwritten before the loop reads it."""


class Mailbox:
    """Hands the loop what clients command and gives each its answer.

    Args:
        shared: The memory shared with the loop.
        restart_loop: Asks the supervisor for a new loop process.
        answer_s: How long the loop may take to answer [s].
    """

    def __init__(self, shared: Shared, restart_loop: Callable[[], None], answer_s: float = ANSWER_S) -> None:
        self.ticking = False
        self.dead_why = ""
        """Why there is no loop any more; "" while there is one, or while the first has not started yet."""
        self._known = asyncio.Event()
        """Set once the first loop ticks, or has died before."""
        self._ring, self._words = shared.commands, shared.words
        self._restart_loop = restart_loop
        self._answer_s = answer_s
        self._dead_generation = 0
        self._last_id = 0
        self._room = asyncio.Semaphore(MAX_WAITING)
        self._waiting: dict[int, asyncio.Future[dict[str, Any]]] = {}
        self._estops: dict[int, asyncio.Future[None]] = {}
        self._restarted: asyncio.Future[None] | None = None

    @property
    def busy(self) -> bool:
        """Whether somebody waits for the loop."""
        return bool(self._waiting or self._estops)

    @property
    def estops(self) -> int:
        """E-stops so far: what was asked when there were fewer is not carried out."""
        number: int = self._words[Word.ESTOPS]
        return number

    def estop(self) -> asyncio.Future[None]:
        """Stop the rig now; what is returned is done once the loop has.

        Raises:
            RpcError: There is no loop.
        """
        if self.dead_why:
            raise self._no_loop()
        self._words[Word.ESTOPS] = number = self.estops + 1
        future = self._estops[number] = asyncio.get_running_loop().create_future()
        return future

    async def stopped(self, estop: asyncio.Future[None]) -> None:
        """Wait for an e-stop to be carried out.

        Raises:
            RpcError: The loop does not do it, or dies meanwhile.
        """
        await self._answer("estop", estop)
        if self.dead_why:
            raise RpcError(NO_ANSWER, f"the loop died meanwhile: {self.dead_why}")

    async def post(self, op: str, axis: int | None, values: dict[str, Any] | None = None) -> None:
        """Send one command and wait until the loop has carried it out.

        Raises:
            RpcError: REFUSED with the loop's reason, or because of an e-stop, or before a reset of a fault,
                meanwhile; NO_ANSWER.
        """
        estops, faults = self.estops, self._words[Word.FAULTS]
        await self._first_tick()
        async with self._room:
            await self._no_estop_under_way()
            if self.dead_why:
                raise self._no_loop()
            if estops != self.estops:
                raise RpcError(REFUSED, OVERTAKEN)
            if op == "reset" and faults != self._words[Word.FAULTS]:
                raise RpcError(REFUSED, TOO_OLD)
            number = self._put(op, axis, values or {})
            future = self._waiting[number] = asyncio.get_running_loop().create_future()
            try:
                reply = await self._answer(op, future)
            finally:
                del self._waiting[number]
        if not reply.get("ok"):
            raise RpcError(REFUSED, str(reply.get("error") or f"the loop refused {op!r}"))

    async def _answer(self, op: str, future: asyncio.Future[T]) -> T:
        try:
            async with asyncio.timeout(self._answer_s):
                return await asyncio.shield(future)
        except TimeoutError:
            raise RpcError(NO_ANSWER, f"the loop did not answer {op!r} within {self._answer_s:g} s") from None

    async def _no_estop_under_way(self) -> None:
        """Until the loop has obeyed: it refuses what it finds in the ring then."""
        if self._estops:
            await asyncio.wait(list(self._estops.values()), timeout=self._answer_s)

    def send(self, op: str, axis: int | None, values: dict[str, Any]) -> None:
        """Send one command that nobody waits for: events tell what became of it."""
        if self.ticking:
            self._put(op, axis, values)

    def _put(self, op: str, axis: int | None, values: dict[str, Any]) -> int:
        self._last_id += 1
        self._ring.put({"id": self._last_id, "op": op, "axis": axis, "values": values})
        return self._last_id

    def _no_loop(self) -> RpcError:
        return RpcError(NO_ANSWER, f"there is no loop: {self.dead_why}; `reset` starts a new one")

    async def _first_tick(self) -> None:
        """Wait until the loop has started, for as long as it may take to answer."""
        try:
            async with asyncio.timeout(self._answer_s):
                await self._known.wait()
        except TimeoutError:
            raise RpcError(NO_ANSWER, "the loop has not started yet; try again") from None

    def poll(self) -> None:
        """See which e-stops the loop has carried out."""
        obeyed = self._words[Word.ESTOPS_OBEYED]
        for number in [each for each in self._estops if each <= obeyed]:
            self._estops.pop(number).set_result(None)

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
        for estop in self._estops.values():
            estop.set_result(None)
        self._estops.clear()
        if self._restarted is not None and not self._restarted.done():
            self._restarted.set_exception(RpcError(REFUSED, f"the new loop failed: {why}"))
            self._restarted.exception()  # whoever waits gets it; who has left does not need it

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
