"""A connection to a daemon for programs that use asyncio. Standard library only."""

from __future__ import annotations

import asyncio
import json
import ssl
from contextlib import suppress
from typing import TYPE_CHECKING, Any, Self

from seod.client.connection import (
    DEFAULT_HOST,
    DEFAULT_PORT,
    ClientError,
    EndedError,
    UnreachableError,
    answer,
)

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Sequence
    from pathlib import Path

    Message = dict[str, Any]

LONGEST = 1 << 24
"""Most bytes of a line."""
WAITING = 10_000
"""Notifications that may wait; beyond that the oldest are dropped."""
RETRY_S = 0.05


class AsyncClient:
    """A connection to a daemon; any number of tasks may use it at once.

        async with AsyncClient() as rig:
            await rig.start()
            async for e in rig.estimates():
                print(e["zeta"])

    Args:
        host: Where the daemon runs.
        port: Its `server.port`.
        token: Its read or command token, where it wants one.
        tls: Certificate (PEM) to trust, True for those that the system trusts, None for no TLS.
        timeout: How long to wait for an answer [s].
        wait: How long to wait for the daemon to come up [s].
    """

    def __init__(
        self,
        host: str = DEFAULT_HOST,
        port: int = DEFAULT_PORT,
        token: str | None = None,
        tls: Path | bool | None = None,
        timeout: float = 10.0,
        wait: float = 0.0,
    ) -> None:
        self.address = f"{host}:{port}"
        self._host, self._port, self._token, self._tls = host, port, token, tls
        self._timeout, self._wait = timeout, wait
        self._last_id = 0
        self._asked: dict[int, asyncio.Future[Message]] = {}
        self._listeners: list[asyncio.Queue[Message | None]] = []
        self._writer: asyncio.StreamWriter | None = None
        self._reading: asyncio.Task[None] | None = None

    async def __aenter__(self) -> Self:
        await self.connect()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    async def connect(self) -> None:
        """Connect, and tell the token.

        Raises:
            UnreachableError: No daemon answers there.
            RequestError: It does not accept the token.
        """
        reader, self._writer = await self._opened()
        self._reading = asyncio.create_task(self._read(reader), name=f"seod client of {self.address}")
        if self._token is not None:
            try:
                await self.call("authenticate", token=self._token)
            except ClientError:
                await self.close()
                raise

    async def _opened(self) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
        context = None
        if self._tls:
            context = ssl.create_default_context(cafile=None if self._tls is True else str(self._tls))
        loop = asyncio.get_running_loop()
        deadline = loop.time() + self._wait
        while True:
            try:
                return await asyncio.open_connection(self._host, self._port, ssl=context, limit=LONGEST)
            except ConnectionRefusedError:
                if loop.time() >= deadline:
                    what = f"no daemon listens at {self.address}; start one with `seod run CONFIG`"
                    raise UnreachableError(what) from None
                await asyncio.sleep(RETRY_S)
            except OSError as error:
                raise UnreachableError(f"cannot reach {self.address}: {error.strerror or error}") from error

    async def close(self) -> None:
        """Close the connection; the daemon goes on."""
        if self._reading is not None:
            self._reading.cancel()
            with suppress(asyncio.CancelledError):
                await self._reading
        if self._writer is not None:
            self._writer.close()
            with suppress(OSError):
                await self._writer.wait_closed()

    async def _read(self, reader: asyncio.StreamReader) -> None:
        try:
            while line := await reader.readline():
                self._take(json.loads(line))
        except (OSError, ValueError, asyncio.IncompleteReadError):
            pass  # as an end: whoever waits is told
        finally:
            for future in self._asked.values():
                if not future.done():
                    future.set_exception(self._ended())
            for listener in self._listeners:
                _put(listener, None)

    def _ended(self) -> EndedError:
        return EndedError(f"the daemon at {self.address} has ended the connection")

    def _take(self, message: Message) -> None:
        if "method" in message:
            for listener in self._listeners:
                _put(listener, message)
            return
        number = message.get("id")
        future = self._asked.pop(number, None) if isinstance(number, int) else None
        if future is not None and not future.done():
            future.set_result(message)

    async def call(self, method: str, /, **params: Any) -> Message:
        """Call a method of the protocol; parameters that are None are left out.

        Raises:
            RequestError: Refused, with the daemon's reason.
            EndedError: The daemon ended.
            ClientError: No answer in time.
        """
        if self._writer is None or self._reading is None or self._reading.done():
            raise (
                self._ended() if self._writer is not None else ClientError("not connected: use `async with`")
            )
        self._last_id += 1
        number = self._last_id
        given = {key: value for key, value in params.items() if value is not None}
        request = {"jsonrpc": "2.0", "id": number, "method": method, "params": given}
        future = self._asked[number] = asyncio.get_running_loop().create_future()
        try:
            self._writer.write(json.dumps(request).encode() + b"\n")
            await self._writer.drain()
            async with asyncio.timeout(self._timeout):
                return answer(await future)
        except TimeoutError:
            what = f"{self.address} did not answer {method!r} within {self._timeout:g} s"
            raise ClientError(what) from None
        except OSError as error:
            raise EndedError(f"the daemon at {self.address} is gone: {error.strerror or error}") from error
        finally:
            self._asked.pop(number, None)

    async def notifications(self) -> AsyncIterator[Message]:
        """What the subscriptions bring from now on, as `{"method": topic, "params": {...}}`.

        Raises:
            EndedError: The daemon ended.
        """
        waiting: asyncio.Queue[Message | None] = asyncio.Queue(WAITING)
        self._listeners.append(waiting)
        try:
            while (message := await waiting.get()) is not None:
                yield message
            raise self._ended()
        finally:
            self._listeners.remove(waiting)

    async def estimates(self, axis: str | None = None) -> AsyncIterator[Message]:
        """Estimates as they come, of one axis or all.

        Raises:
            EndedError: The daemon ended.
        """
        subscription = await self.subscribe(["estimate"], None if axis is None else [axis])
        try:
            async for message in self.notifications():
                if message["method"] == "estimate" and axis in (None, message["params"]["axis"]):
                    yield message["params"]
        finally:
            with suppress(ClientError):
                await self.unsubscribe(subscription)

    async def subscribe(
        self, topics: Sequence[str], axes: Sequence[str] | None = None, rate_hz: float | None = None
    ) -> int:
        """Ask for `estimate`, `sample`, `event` or `health`; returns the subscription's number."""
        told = await self.call("subscribe", topics=topics, axes=axes, rate_hz=rate_hz)
        number: int = told["subscription"]
        return number

    async def unsubscribe(self, subscription: int) -> None:
        """End a subscription."""
        await self.call("unsubscribe", subscription=subscription)

    async def info(self) -> Message:
        """Versions, rig, axes, whether the loop is real-time, and the truth of a simulated rig."""
        return await self.call("info")

    async def status(self) -> Message:
        """Everything about the rig at once."""
        return await self.call("status")

    async def get(self, axis: str | None = None) -> Message:
        """State, settings and newest estimate of an axis."""
        return await self.call("get", axis=axis)

    async def set(self, axis: str | None = None, **values: float | str) -> Message:
        """Change settings of an axis; returns them. A number is in SI, `"400 mV"` is understood too."""
        return await self.call("set", axis=axis, **values)

    async def start(self, axis: str | None = None) -> Message:
        """Excite an axis, or all."""
        return await self.call("start", axis=axis)

    async def stop(self, axis: str | None = None) -> Message:
        """End the excitation of an axis, or all; it goes back to where it stood."""
        return await self.call("stop", axis=axis)

    async def estop(self) -> Message:
        """Neutral at once; needs a reset afterwards."""
        return await self.call("estop")

    async def reset(self, axis: str | None = None) -> Message:
        """Leave the fault, of an axis or of all; starts a new loop where it has died."""
        return await self.call("reset", axis=axis)

    async def keepalive(self) -> Message:
        """Tell a rig with `guard.dead_man` that somebody is still there."""
        return await self.call("keepalive")


def _put(waiting: asyncio.Queue[Message | None], message: Message | None) -> None:
    if waiting.full():
        waiting.get_nowait()
    waiting.put_nowait(message)
