"""Listens to all rigs at a broker: keeps a board up to date, and an archive."""

from __future__ import annotations

import asyncio
import time
from typing import TYPE_CHECKING, Final

import aiomqtt

from seod.fleet.broker import FIRST_S, LONGEST_S, opened
from seod.fleet.topics import ALL, NOTHING, encode, topic_of

if TYPE_CHECKING:
    from collections.abc import Callable

    from seod.fleet.board import Board, Heard
    from seod.fleet.broker import Broker
    from seod.fleet.day_files import DayFiles

BATCH: Final = 500
"""Messages that are written to the disk at once, at most."""
CONFIRM_S: Final = 2.0
"""Between two confirmations to one rig [s]."""


class Listener:
    """A subscriber.

    Args:
        broker: Where it is.
        identity: Client identifier; one connection has it at a time.
        board: Takes what comes.
        files: Keeps what comes; None: nothing is kept.
        take: Gets what was taken, in order.
        told: Takes a sentence when the broker is reached, or is not.
    """

    def __init__(
        self,
        broker: Broker,
        identity: str,
        board: Board,
        files: DayFiles | None = None,
        take: Callable[[Heard], None] = lambda _: None,
        told: Callable[[str], None] = lambda _: None,
    ) -> None:
        self._broker, self._identity, self._board, self._files = broker, identity, board, files
        self._take, self._told = take, told
        self._confirmed: dict[str, float] = {}
        self._due: dict[str, None] = {}
        self._said = ""
        self.connected = False
        """Whether the broker has us."""

    async def run(self) -> None:
        """Until cancelled.

        Raises:
            OSError: The archive's disk takes no more.
        """
        pause = FIRST_S
        while True:
            try:
                await self._connected()
            except (aiomqtt.MqttError, ConnectionError, TimeoutError, ValueError) as error:
                pause = FIRST_S if self.connected else pause
                self._say(f"the broker at {self._broker.address} is away: {error}")
            self.connected = False
            await asyncio.sleep(pause)
            pause = min(LONGEST_S, 2.0 * pause)

    def _say(self, sentence: str) -> None:
        if sentence != self._said:
            self._said = sentence
            self._told(sentence)

    async def _connected(self) -> None:
        client = self._broker.client(self._identity, clean=self._files is None)
        if self._files is not None:  # the broker is told only what is on the disk
            client._client.manual_ack_set(on=True)
        async with opened(client):
            await client.subscribe(ALL, qos=1)
            self.connected = True
            self._say(f"the broker at {self._broker.address} is there")
            await self._hear(client)

    async def _hear(self, client: aiomqtt.Client) -> None:
        messages = client.messages
        confirming = asyncio.create_task(self._confirm_all(client))
        try:
            while True:
                batch = [await anext(messages)]
                while len(messages) and len(batch) < BATCH:
                    batch.append(await anext(messages))
                await self._took(client, batch)
                if confirming.done():
                    confirming.result()
        finally:
            confirming.cancel()
            await asyncio.gather(confirming, return_exceptions=True)

    async def _took(self, client: aiomqtt.Client, batch: list[aiomqtt.Message]) -> None:
        now = time.monotonic()
        board = self._board
        taken = [
            heard
            for each in batch
            if (heard := board.take(each.topic.value, each.payload, each.retain, now)) is not None
        ]
        if self._files is not None:
            if taken:
                await asyncio.to_thread(self._files.add, taken)
            for each in batch:
                if each.qos:
                    client._client.ack(each.mid, each.qos)
        for heard in taken:
            self._due[heard.rig.name] = None
            self._take(heard)

    # ---- confirmations to rigs that wait for this archive

    async def _confirm_all(self, client: aiomqtt.Client) -> None:
        while self._files is not None:
            now = time.monotonic()
            for name in (*self._board.gaps, *self._due):
                await self._confirm(client, name, now)
            await asyncio.sleep(0.2)

    async def _confirm(self, client: aiomqtt.Client, name: str, now: float) -> None:
        rig = self._board.rigs[name]
        if rig.birth.get("archive") != self._board.archive:
            self._board.gaps.discard(name)
            self._due.pop(name, None)
            return
        if now - self._confirmed.get(name, 0.0) < CONFIRM_S:
            return
        key, again = rig.last or NOTHING, name in self._board.gaps
        self._confirmed[name] = now
        self._board.gaps.discard(name)
        self._due.pop(name, None)
        body = {"archive": self._board.archive, **key._asdict(), "again": again}
        await client.publish(topic_of(name, "confirm"), encode(body), qos=1)
