"""Answers the gateway about the rig, and publishes what happens, over a link."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from seod.observe.feeds import Feeds
from seod.observe.rig import Rig
from seod.processes.ring import Word
from seod.protocol.jsonrpc import json_text

if TYPE_CHECKING:
    from collections.abc import Callable

    from seod.config.model import RigConfig
    from seod.estimate.base import Estimator, EstimatorSettings
    from seod.observe.recording import Recording
    from seod.processes.link import Link
    from seod.processes.ring import Shared


MESSAGES_A_TURN = 32
"""What clients ask is answered between rows, never instead of them."""


class Observer:
    """The rig, and the gateway's end of it.

    Args:
        config: The rig file.
        shared: The memory shared with the loop.
        link: To the gateway.
        make: Makes an estimator.
        clock: Time of the rows [s].
        recording: Takes all rows, estimates and events, and health.
    """

    def __init__(
        self,
        config: RigConfig,
        shared: Shared,
        link: Link,
        make: Callable[[EstimatorSettings], Estimator],
        clock: Callable[[], float],
        recording: Recording,
    ) -> None:
        self._shared, self._link = shared, link
        self._feeds = Feeds(link)
        self.rig = Rig(config, shared, self._feeds, make, clock, self._send, recording)
        self.ended = False

    def poll(self) -> None:
        """Do what the gateway asks, take events and rows, say that this process lives."""
        self._link.flush()
        for _ in range(MESSAGES_A_TURN):
            message = None if self.ended else self._link.receive()
            if message is None:
                break
            self._hear(message)
        self.rig.poll()
        self._shared.words[Word.OBSERVER_BEAT] += 1

    def _hear(self, message: dict[str, Any]) -> None:
        if not message or message.get("stop"):
            self.ended = True
        elif "ask" in message:
            self._answer(message)
        elif "feed" in message:
            self._feeds.obey(message)
        elif "clients" in message:
            self.rig.clients = message["clients"]
        elif "change" in message:
            self.rig.change(self.rig.axes[message["change"]], message["values"], message["told"])
        elif message.get("loop") == "died":
            self.rig.loop_died(message)

    def _answer(self, message: dict[str, Any]) -> None:
        """Answer a query, with all that happened before it was asked."""
        self.rig.take_events()
        self.rig.clients = message["clients"]
        axis = message["axis"]
        asked: dict[str, Callable[[], dict[str, Any]]] = {
            "info": self.rig.info,
            "status": self.rig.status,
            "get": lambda: self.rig.whole(self.rig.axes[axis]),
            "record_on": lambda: self.rig.record(True),
            "record_off": lambda: self.rig.record(False),
        }
        self._link.send({"answer": message["ask"], "text": json_text(asked[message["method"]]())})

    def _send(self, op: str, axis: int, values: dict[str, Any]) -> None:
        self._link.send({"send": op, "axis": axis, "values": values})

    def close(self) -> None:
        """Take the last rows, publish what they bring, end the recording."""
        self.rig.close()
        self._link.flush()
