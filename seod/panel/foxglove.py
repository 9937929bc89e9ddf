"""Live topics by Foxglove's WebSocket protocol, for Foxglove, Lichtblick, PlotJuggler and programs of others.

Source: https://github.com/foxglove/ws-protocol (docs/spec.md), sub-protocols `foxglove.websocket.v1` and
`foxglove.sdk.v1`. Topics and their messages are those of a recording (`seod.record.layout`), rows thinned.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import secrets
import struct
import time
from collections import deque
from typing import TYPE_CHECKING, Any, Final

from starlette.websockets import WebSocketDisconnect

from seod import __version__
from seod.protocol.jsonrpc import json_text
from seod.record.layout import (
    ESTIMATES,
    EVENTS,
    HEALTH,
    MODEL_ERRORS,
    ROW_SCHEMA,
    ROW_SCHEMA_NAME,
    ROWS,
    encode,
)

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy as np
    from numpy.typing import NDArray
    from starlette.websockets import WebSocket

    from seod.panel.panel import Panel

PROTOCOLS: Final = ("foxglove.sdk.v1", "foxglove.websocket.v1")
MESSAGE_DATA: Final = struct.Struct("<BIQ")
"""Operation 1, subscription, time [ns of the wall clock]; then the message."""
DATA: Final = 1
ROWS_HZ: Final = 200.0
"""Most rows of an axis a second."""
QUEUED: Final = 4000
"""Messages that wait for a client; those that come on top are dropped."""
SUBSCRIPTIONS: Final = 256
ANY_OBJECT: Final = json.dumps({"type": "object", "properties": {}})
WARNING: Final = 1


def choose_protocol(offered: str) -> str | None:
    """The sub-protocol to speak, of those that a client offers; None for none of ours."""
    names = [each.strip() for each in offered.split(",")]
    return next((each for each in PROTOCOLS if each in names), None)


class FoxgloveSocket:
    """Serves one client until it goes.

    Args:
        panel: Whose rows and notifications are served.
        socket: The client's WebSocket, accepted.
    """

    def __init__(self, panel: Panel, socket: WebSocket) -> None:
        self._panel, self._socket = panel, socket
        self._channels = list(channels(list(panel.histories)))
        self._ids = {each["topic"]: each["id"] for each in self._channels}
        self._subscribed: dict[int, int] = {}
        """Channel by subscription."""
        self._out: deque[str | bytes] = deque()
        self._soon = asyncio.Event()
        self._offset_ns = time.time_ns() - time.monotonic_ns()
        self._every = max(1, round(panel.config.loop.rate_hz / ROWS_HZ))

    async def serve(self) -> None:
        """Until the client goes."""
        about = {"op": "serverInfo", "name": f"seod {__version__}: {self._panel.config.rig}"}
        more = {
            "capabilities": [],
            "supportedEncodings": [],
            "metadata": {},
            "sessionId": secrets.token_hex(8),
        }
        self._put(json_text({**about, **more}))
        self._put(json_text({"op": "advertise", "channels": self._channels}))
        self._panel.listeners.add(self)
        tasks = [asyncio.create_task(each) for each in (self._receive(), self._send())]
        try:
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            self._panel.listeners.discard(self)
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    # ---- what the panel tells

    def rows(self, rows: NDArray[np.void]) -> None:
        """Rows have come: every so many of them go on."""
        thinned = rows[rows["tick"] % self._every == 0]
        for number, axis in enumerate(self._panel.histories):
            for subscription in self._subscriptions(ROWS + axis):
                for row in encode(thinned, number):
                    self._message(subscription, float(row["t_tick"]), row.tobytes())

    def told(self, topic: str, params: dict[str, Any]) -> None:
        """A notification has come."""
        of_axis = {"estimate": ESTIMATES, "model_error": MODEL_ERRORS}.get(topic)
        name = (
            {"event": EVENTS, "health": HEALTH}.get(topic, "")
            if of_axis is None
            else of_axis + params["axis"]
        )
        for subscription in self._subscriptions(name):
            self._message(subscription, params["t"], json_text(params).encode())

    def _subscriptions(self, topic: str) -> list[int]:
        channel = self._ids.get(topic)
        return [number for number, each in self._subscribed.items() if each == channel]

    def _message(self, subscription: int, t: float, data: bytes) -> None:
        if len(self._out) < QUEUED:
            stamp = max(0, round(t * 1e9) + self._offset_ns)
            self._put(MESSAGE_DATA.pack(DATA, subscription, stamp) + data)

    def _put(self, data: str | bytes) -> None:
        self._out.append(data)
        self._soon.set()

    # ---- what the client asks

    async def _receive(self) -> None:
        with contextlib.suppress(WebSocketDisconnect, KeyError):  # KeyError: starlette's, of a binary message
            while True:
                self._heard(await self._socket.receive_text())

    def _heard(self, text: str) -> None:
        try:
            message = json.loads(text)
            if message["op"] == "subscribe":
                for each in message["subscriptions"]:
                    self._subscribe(int(each["id"]), int(each["channelId"]))
            elif message["op"] == "unsubscribe":
                for number in message["subscriptionIds"]:
                    self._subscribed.pop(int(number), None)
            else:
                self._warn(f"{str(message['op'])[:40]!r} is not served here")
        except (ValueError, KeyError, TypeError):
            self._warn("not a message of the protocol")

    def _subscribe(self, number: int, channel: int) -> None:
        if channel not in self._ids.values():
            self._warn(f"there is no channel {channel}")
        elif len(self._subscribed) >= SUBSCRIPTIONS or not 0 <= number < 1 << 32:
            self._warn(f"subscription {number} is one too many, or no number for one")
        else:
            self._subscribed[number] = channel

    def _warn(self, why: str) -> None:
        self._put(json_text({"op": "status", "level": WARNING, "message": why}))

    async def _send(self) -> None:
        with contextlib.suppress(WebSocketDisconnect, RuntimeError):  # starlette's, once it has gone
            while True:
                await self._soon.wait()
                self._soon.clear()
                while self._out:
                    data = self._out.popleft()
                    if isinstance(data, str):
                        await self._socket.send_text(data)
                    else:
                        await self._socket.send_bytes(data)


def channels(axes: list[str]) -> Iterator[dict[str, Any]]:
    """What is advertised: a channel for each topic."""
    rows = {
        "encoding": "cdr",
        "schemaName": ROW_SCHEMA_NAME,
        "schema": ROW_SCHEMA,
        "schemaEncoding": "ros2msg",
    }
    topics = [(ROWS + axis, rows) for axis in axes]
    for topic, name in [
        *((ESTIMATES + axis, "seod.Estimate") for axis in axes),
        *((MODEL_ERRORS + axis, "seod.ModelError") for axis in axes),
        (EVENTS, "seod.Event"),
        (HEALTH, "seod.Health"),
    ]:
        schema = {
            "encoding": "json",
            "schemaName": name,
            "schema": ANY_OBJECT,
            "schemaEncoding": "jsonschema",
        }
        topics.append((topic, schema))
    for number, (topic, schema) in enumerate(topics, 1):
        yield {"id": number, "topic": topic, **schema}
