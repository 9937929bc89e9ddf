"""One rig at the broker: birth, what the outbox has, last will; commands where these are allowed."""

from __future__ import annotations

import asyncio
import time
from contextlib import suppress
from typing import TYPE_CHECKING, Any, Final

import aiomqtt

from seod.fleet.broker import FIRST_S, GOODBYE_S, LONGEST_S, WINDOW, opened
from seod.fleet.topics import decode, encode, key_of, topic_of

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable

    from seod.fleet.broker import Broker
    from seod.fleet.outbox import Outbox

    OnCommand = Callable[[aiomqtt.Message], Awaitable[tuple[str, dict[str, Any]]]]

UNDER_WAY: Final = 8
"""Commands in work; more are not taken."""


class Publisher:
    """Keeps a rig at the broker, whatever that does.

    Args:
        broker: Where it is.
        outbox: What there is to tell.
        birth: What the rig says of itself at each connection.
        command: Carries out a command; returns suffix and body of its answer. None: none are listened to.
        told: Takes a sentence when the broker is reached, or is not.
    """

    def __init__(
        self,
        broker: Broker,
        outbox: Outbox,
        birth: Callable[[], dict[str, Any]],
        command: OnCommand | None = None,
        told: Callable[[str], None] = lambda _: None,
    ) -> None:
        self._broker, self._outbox, self._birth = broker, outbox, birth
        self._command, self._told = command, told
        self._more = asyncio.Event()
        self._connection = 0
        self._commands: set[asyncio.Task[None]] = set()
        self._said = ""
        self.connected = False
        """Whether the broker has us."""

    def put(self, suffix: str, body: dict[str, Any]) -> None:
        """Tell something, now or once the broker is there."""
        self._outbox.put(suffix, body)
        self._more.set()

    async def run(self) -> None:
        """Until cancelled; then the broker is told that it ends."""
        pause = FIRST_S
        while True:
            try:
                await self._connected()
            except (aiomqtt.MqttError, OSError, ValueError) as error:
                if self.connected:
                    pause = FIRST_S
                self._say(f"the broker at {self._broker.address} is away: {error}; what comes is stored")
            self.connected = False
            self._outbox.store.sync()
            await asyncio.sleep(pause)
            pause = min(LONGEST_S, 2.0 * pause)

    def _say(self, sentence: str) -> None:
        if sentence != self._said:
            self._said = sentence
            self._told(sentence)

    async def _connected(self) -> None:
        self._connection += 1
        rig = self._outbox.rig
        will = aiomqtt.Will(topic_of(rig, "death"), encode(self._death("gone")), qos=1, retain=True)
        client = self._broker.client(f"seod-{rig}", will)
        async with opened(client):
            try:
                await self._serve(client)
            except asyncio.CancelledError:
                with suppress(aiomqtt.MqttError, TimeoutError):
                    async with asyncio.timeout(GOODBYE_S):
                        await self._publish(client, "death", encode(self._death("ended")), retain=True)
                raise

    async def _serve(self, client: aiomqtt.Client) -> None:
        rig = self._outbox.rig
        if self._outbox.archive is not None:
            await client.subscribe(topic_of(rig, "confirm"), qos=1)
        await self._publish(client, "birth", encode(self._born()), retain=True)
        if self._command is not None:
            await client.subscribe(topic_of(rig, "command"), qos=1)
        self.connected = True
        self._say(f"the broker at {self._broker.address} is there")
        self._outbox.begin()
        tasks = [asyncio.create_task(self._forward(client)), asyncio.create_task(self._hear(client))]
        try:
            done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            for task in done:
                task.result()
        finally:
            for task in (*tasks, *self._commands):
                task.cancel()
            await asyncio.gather(*tasks, *self._commands, return_exceptions=True)

    def _born(self) -> dict[str, Any]:
        newest, archive = self._outbox.store.newest, self._outbox.archive
        keys = {"rig": self._outbox.rig, "session": newest.session, "connection": self._connection}
        store = {"seq": newest.seq, "archive": archive, "store": self._outbox.store.report()}
        return {**keys, "at": time.time(), **store, "commands": self._command is not None, **self._birth()}

    def _death(self, why: str) -> dict[str, Any]:
        session = self._outbox.store.session
        return {"rig": self._outbox.rig, "session": session, "connection": self._connection, "why": why}

    async def _publish(
        self, client: aiomqtt.Client, suffix: str, payload: bytes, *, retain: bool = False
    ) -> None:
        await client.publish(topic_of(self._outbox.rig, suffix), payload, qos=1, retain=retain)

    async def _forward(self, client: aiomqtt.Client) -> None:
        """All that the outbox has, in order."""
        while True:
            self._more.clear()
            parcels = self._outbox.batch(WINDOW)
            if not parcels:
                await self._more.wait()
                continue
            sending = [
                client.publish(each.topic, each.payload, qos=1, retain=each.retain) for each in parcels
            ]
            await asyncio.gather(*sending)
            self._outbox.taken(parcels[-1].key, time.monotonic())

    async def _hear(self, client: aiomqtt.Client) -> None:
        confirm = topic_of(self._outbox.rig, "confirm")
        async for message in client.messages:
            if message.topic.value == confirm:
                self._confirmed(message)
            elif len(self._commands) < UNDER_WAY:
                task = asyncio.create_task(self._carry_out(client, message))
                self._commands.add(task)
                task.add_done_callback(self._commands.discard)

    def _confirmed(self, message: aiomqtt.Message) -> None:
        body = decode(message.payload) or {}
        key = key_of([body.get("session"), body.get("seq")])
        if key is not None and body.get("archive") == self._outbox.archive:
            self._outbox.confirmed(key, bool(body.get("again")), time.monotonic())
            self._more.set()

    async def _carry_out(self, client: aiomqtt.Client, message: aiomqtt.Message) -> None:
        if self._command is None:
            return
        suffix, answer = await self._command(message)
        with suppress(aiomqtt.MqttError):
            await self._publish(client, suffix, encode({"rig": self._outbox.rig, **answer}))
