"""The fleet as the panel shows it: all rigs at the rig file's broker."""

from __future__ import annotations

import os
import time
from typing import TYPE_CHECKING, Any, Final

from seod.fleet.board import Board
from seod.fleet.broker import BrokerError, broker_of, need_library

if TYPE_CHECKING:
    from seod.config.mqtt import MqttConfig

POINTS: Final = 32
"""Of a course, as small as it is shown."""


class FleetView:
    """Listens to all rigs.

    Args:
        rig: Our own, for the name at the broker.
        mqtt: The rig file's section.
    """

    def __init__(self, rig: str, mqtt: MqttConfig) -> None:
        self._rig, self._mqtt = rig, mqtt
        self._board = Board()
        self._said = "the broker has not answered yet"

    async def run(self) -> None:
        """Until cancelled, or until it is clear that there is no way."""
        try:
            need_library()
            from seod.fleet.listener import Listener  # noqa: PLC0415 - an extra

            identity = f"seod-panel-{self._rig}-{os.getpid()}"
            await Listener(broker_of(self._mqtt), identity, self._board, told=self._say).run()
        except BrokerError as error:
            self._say(str(error))

    def _say(self, sentence: str) -> None:
        self._said = sentence

    def answer(self) -> dict[str, Any]:
        """For the page: a row for each axis of each rig, `trend` the course of zeta; how the broker does."""
        rows = self._board.rows(time.monotonic())
        for row in rows:
            zetas = [zeta for _, zeta, _ in row["trend"] if zeta is not None]
            row["trend"] = zetas[:: max(1, -(-len(zetas) // POINTS))]
        return {"broker": self._said, "rows": rows}
