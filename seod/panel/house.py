"""What the panel hears from the gateway, once for all its clients: estimates, events, health."""

from __future__ import annotations

import asyncio
import contextlib
from collections import deque
from typing import TYPE_CHECKING, Any, Final

from seod.panel.trends import Trend
from seod.processes.uplink import Uplink
from seod.protocol.jsonrpc import RpcError

if TYPE_CHECKING:
    import socket
    from collections.abc import Callable, Iterable

AGAIN_S: Final = 0.3
"""Between two attempts to reach the gateway."""
RATE_HZ: Final = 10.0
"""Estimates of an axis."""
EVENTS: Final = 200
"""The newest ones are kept, for pages that come later."""
TOPICS: Final = ("estimate", "event", "health", "model_error")


class House:
    """Keeps the newest of each, and hands on what comes.

    Args:
        way: Where clients are handed in to the gateway.
        token: With which it reads, if the rig file has tokens.
        axes: Their names.
        hand_on: Takes what comes: topic and parameters.
    """

    def __init__(
        self,
        way: socket.socket,
        token: str | None,
        axes: Iterable[str],
        hand_on: Callable[[str, dict[str, Any]], None],
    ) -> None:
        self._way, self._token, self._hand_on = way, token, hand_on
        self.trends = {name: Trend() for name in axes}
        self.estimates: dict[str, dict[str, Any]] = {}
        self.model_errors: dict[str, dict[str, Any]] = {}
        self.health: dict[str, Any] = {}
        self.info: dict[str, Any] = {}
        self.events: deque[dict[str, Any]] = deque(maxlen=EVENTS)
        self.faults: dict[str, dict[str, Any]] = {}
        """Present faults, by axis."""
        self.connected = False

    async def run(self) -> None:
        """Hear the gateway, and the next one once it is gone; until cancelled."""
        while True:
            gone = asyncio.Event()
            uplink = Uplink(self._way, ("panel", 0), self._heard, gone.set)
            try:
                await self._begin(uplink)
                self.connected = True
                await gone.wait()
            except RpcError:  # not there yet
                pass
            finally:
                self.connected = False
                with contextlib.suppress(RpcError):
                    await uplink.close()
            await asyncio.sleep(AGAIN_S)

    async def _begin(self, uplink: Uplink) -> None:
        await uplink.open(self._token)
        await uplink.call("subscribe", {"topics": ["event", "health"]})
        await uplink.call("subscribe", {"topics": ["estimate", "model_error"], "rate_hz": RATE_HZ})
        status = await uplink.call("status")
        self.info = {key: value for key, value in status.items() if key not in {"axes", "health"}}
        self.health = status["health"]
        for name, axis in status["axes"].items():
            self._note_fault(name, axis["fault"])

    def _heard(self, topic: str, params: dict[str, Any]) -> None:
        axis = params.get("axis")
        if topic == "estimate":
            self.estimates[params["axis"]] = params
            self.trends[params["axis"]].add(params)
        elif topic == "model_error":
            self.model_errors[params["axis"]] = params
        elif topic == "health":
            self.health = params
        elif topic == "event":
            self._heard_event(axis, params)
        self._hand_on(topic, params)

    def _heard_event(self, axis: str | None, event: dict[str, Any]) -> None:
        self.events.append(event)
        if event["event"] == "fault":
            for name in event.get("latched", self.trends):
                self._note_fault(name, event)
        elif event["event"] == "state" and axis is not None and event["state"] != "fault":
            self._note_fault(axis, None)
        elif event["event"] == "started":
            self.faults.clear()

    def _note_fault(self, axis: str, fault: dict[str, Any] | None) -> None:
        if fault is None:
            self.faults.pop(axis, None)
        else:
            self.faults[axis] = {"code": fault["code"], "why": fault["why"], "t": fault["t"]}
