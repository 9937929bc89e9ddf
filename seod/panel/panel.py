"""The panel as such: rows, what the gateway says, who has a page open, who commands."""

from __future__ import annotations

import asyncio
import time
from typing import TYPE_CHECKING, Any, Final, Protocol

from seod.observe.rows import RowReader
from seod.panel.commander import Commander
from seod.panel.fleet import FleetView
from seod.panel.history import HISTORY_S, AxisHistory
from seod.panel.house import House
from seod.panel.sessions import Sessions
from seod.processes.ring import FLAG_FRESH, AxisState
from seod.protocol.jsonrpc import json_text

if TYPE_CHECKING:
    import socket
    from pathlib import Path

    import numpy as np
    from numpy.typing import NDArray

    from seod.config.model import RigConfig
    from seod.config.server import ServerConfig
    from seod.processes.ring import Shared

POLL_S: Final = 0.008
"""How often rows are taken."""
STALE_S: Final = 0.5
"""Without rows for this long, what is shown is stale."""


class Page(Protocol):
    """An open page."""

    def tell(self, text: str) -> None:
        """Queue a notification."""


class Listener(Protocol):
    """Gets all rows, and all that the gateway tells; nothing here may wait."""

    def rows(self, rows: NDArray[np.void]) -> None:
        """Rows (dtype `seod.record.layout.row_dtype`) have come."""

    def told(self, topic: str, params: dict[str, Any]) -> None:
        """A notification has come."""


class Panel:
    """What all of the panel's clients share.

    Args:
        config: The rig file, with its tokens.
        shared: The memory shared with the loop.
        way: Where clients are handed in to the gateway.
        rig_file: The rig file.
    """

    def __init__(self, config: RigConfig, shared: Shared, way: socket.socket, rig_file: Path) -> None:
        self.config, self.shared, self.way, self.rig_file = config, shared, way, rig_file
        self.period = 1.0 / config.loop.rate_hz
        rows = int(HISTORY_S * config.loop.rate_hz)
        self.histories = {name: AxisHistory(rows) for name in config.axes}
        self.house = House(way, reading_token(config.server), config.axes, self._hand_on)
        self.fleet = None if config.mqtt is None else FleetView(config.rig, config.mqtt)
        self.commander = Commander()
        self.commander.told = self._tell_commander
        self.sessions = Sessions()
        self.pages: set[Page] = set()
        self.listeners: set[Listener] = set()
        self._reader = RowReader(shared, looks_on=True)
        self._last_rows = time.monotonic()

    async def run(self) -> None:
        """Take rows and hear the gateway; until cancelled."""
        hearing = [asyncio.create_task(self.house.run())]
        if self.fleet is not None:
            hearing.append(asyncio.create_task(self.fleet.run()))
        try:
            while True:
                self.take_rows()
                await asyncio.sleep(POLL_S)
        finally:
            for task in hearing:
                task.cancel()
            await asyncio.gather(*hearing, return_exceptions=True)
            self._reader.close()

    def take_rows(self) -> None:
        """Take what the loop has written since the last call."""
        while len(rows := self._reader.take()):
            self._last_rows = time.monotonic()
            for index, history in enumerate(self.histories.values()):
                block = rows["axes"][:, index]
                history.add(rows["tick_t"], block, block["flags"] & FLAG_FRESH != 0)
            for listener in self.listeners:
                listener.rows(rows)

    @property
    def newest_t(self) -> float:
        """Time of the newest row's tick [s]; 0 before there is one."""
        return max(history.newest_t for history in self.histories.values())

    @property
    def stale(self) -> bool:
        """Whether what is shown is."""
        return self.rows_age_s > STALE_S

    @property
    def rows_age_s(self) -> float:
        """Since when no rows have come [s]."""
        return time.monotonic() - self._last_rows

    def status(self) -> dict[str, Any]:
        """What every page is told five times a second."""
        return {
            "t": self.newest_t,
            "rows_age_s": self.rows_age_s,
            "stale": self.stale,
            "gateway": self.house.connected,
            "pages": len(self.pages),
            "axes": {name: self._axis(name, history) for name, history in self.histories.items()},
        }

    def _axis(self, name: str, history: AxisHistory) -> dict[str, Any]:
        newest = {key: history.newest(key) for key in ("y", "u", "reference", "e_a", "ps", "temperature")}
        return {
            "state": AxisState(history.state).name.lower(),
            **newest,
            "fault": self.house.faults.get(name),
        }

    def _hand_on(self, topic: str, params: dict[str, Any]) -> None:
        if topic == "event" and (params["event"] == "started" or params.get("code") == "loop_died"):
            self._reader.restart()  # another loop's ticks may count from anywhere
        for listener in self.listeners:
            listener.told(topic, params)
        if self.pages:
            text = json_text({"method": topic, "params": params})
            for page in self.pages:
                page.tell(text)

    def _tell_commander(self, sentence: str) -> None:
        event = {"event": "commander", "t": time.monotonic(), "axis": None, "why": sentence}
        self.house.events.append(event)
        self._hand_on("event", event)


def reading_token(server: ServerConfig) -> str | None:
    """The rig file's token with which the panel itself reads."""
    token = server.read_token or server.command_token
    return None if token is None else token.get_secret_value()
