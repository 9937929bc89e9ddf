"""What the gateway itself knows of the rig, and where it asks for the rest. Computes nothing."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from seod.config.settings import shown
from seod.gateway.mailbox import Mailbox
from seod.protocol.jsonrpc import NO_ANSWER, JsonText, RpcError

if TYPE_CHECKING:
    from collections.abc import Callable

    from seod.config.axis import AxisConfig
    from seod.config.model import RigConfig
    from seod.gateway.hub import Hub
    from seod.processes.link import Link
    from seod.processes.ring import Shared

    Query = tuple[str, str | None]

QUERY_S = 10.0
"""A query that is not answered within this time never is."""


@dataclass(slots=True)
class Axis:
    """An axis, with the settings in force."""

    name: str
    config: AxisConfig
    settings: dict[str, Any] = field(init=False)

    def __post_init__(self) -> None:
        self.settings = {**shown(self.config), "method": self.config.estimator.method}


class Desk:
    """The rig as far as commands go; queries go to the process that estimates.

    Args:
        config: The rig file.
        shared: The memory shared with the loop.
        link: To the process that estimates.
        hub: Takes what it publishes.
        restart_loop: Asks the supervisor for a new loop process.
    """

    def __init__(
        self, config: RigConfig, shared: Shared, link: Link, hub: Hub, restart_loop: Callable[[], None]
    ) -> None:
        self.config = config
        self.axes = {name: Axis(name, axis) for name, axis in config.axes.items()}
        self.mailbox = Mailbox(shared, restart_loop)
        self.clients: Callable[[], dict[str, Any]] = dict
        """Tells about the clients in `health`; the server sets it."""
        self._events, self._rows = shared.events, shared.row_ring
        self._rows_seen = self._rows.head[0]
        self._link, self._hub = link, hub
        self._asked: dict[Query, list[asyncio.Future[JsonText]]] = {}
        """Those who wait for a question that is still to be put, and for one that is under way."""
        self._under_way: dict[Query, list[asyncio.Future[JsonText]]] = {}
        self._clients_told: dict[str, Any] = {}

    def poll(self) -> None:
        """Take what the loop says to commands; send what waits."""
        self.mailbox.poll()
        try:
            for event in self._events.take():
                self._on_event(event)
        except ValueError:  # overwritten while it was read; whoever waits is told that no answer came
            pass
        if self._rows.head[0] != self._rows_seen:
            self._rows_seen = self._rows.head[0]
            self.mailbox.rows_come()
        self._link.flush()

    def _on_event(self, event: dict[str, Any]) -> None:
        kind = event["event"]
        if kind == "reply":
            self.mailbox.answered(event)
        elif kind == "started" and self.mailbox.loop_started(event["generation"]):
            for axis in self.axes.values():
                axis.settings |= shown(axis.config)
        elif kind == "changed" and event.get("axis") in self.axes:
            self.axes[event["axis"]].settings |= event["values"]

    def tell_clients(self) -> None:
        """Tell about the clients, for `health`, if something has changed."""
        clients = self.clients()
        if clients != self._clients_told:
            self._clients_told = clients
            self._link.send({"clients": clients})

    def hear(self, message: dict[str, Any]) -> None:
        """Take one message of the process that estimates."""
        if "told" in message:
            self._hub.deliver(message["told"])
        elif "answer" in message:
            self._answered(message)
        elif "send" in message:
            self.mailbox.send(message["send"], message["axis"], message["values"])
        elif "dropped" in message:
            self._hub.lose(message["dropped"])

    async def ask(self, method: str, axis: str | None = None) -> JsonText:
        """Have a query answered; those who ask the same meanwhile share one answer.

        Raises:
            RpcError: No answer comes.
        """
        query = (method, axis)
        future: asyncio.Future[JsonText] = asyncio.get_running_loop().create_future()
        self._asked.setdefault(query, []).append(future)
        self._put(query)
        try:
            async with asyncio.timeout(QUERY_S):
                return await future
        except TimeoutError:
            raise RpcError(NO_ANSWER, f"{method!r} was not answered within {QUERY_S:g} s") from None

    def _put(self, query: Query) -> None:
        """Put a question, unless the same one is under way: its answer may be older than what is asked."""
        if query in self._under_way or query not in self._asked:
            return
        self._under_way[query] = self._asked.pop(query)
        method, axis = query
        self._link.send({"ask": query, "method": method, "axis": axis, "clients": self.clients()})

    def _answered(self, message: dict[str, Any]) -> None:
        method, axis = message["answer"]
        text = JsonText(message["text"])
        for future in self._under_way.pop((method, axis), ()):
            if not future.done():
                future.set_result(text)
        self._put((method, axis))

    def change(self, axis: Axis, values: dict[str, Any], told: dict[str, Any]) -> None:
        """New settings are in force; `told` are those of which the loop does not tell the clients."""
        axis.settings |= values
        if told:  # of the others the loop's event tells
            self._link.send({"change": axis.name, "values": told, "told": told})

    async def reset(self, axis: int | None = None) -> None:
        """Leave the fault; where the loop has died, have a new one started and wait until it ticks.

        Args:
            axis: Number of one axis; None for all. A new loop has none in fault.

        Raises:
            RpcError: Refused, or the new loop does not come up.
        """
        if self.mailbox.dead_why:
            await self.mailbox.restart()
        else:
            await self.mailbox.post("reset", axis)

    def loop_died(self, death: dict[str, Any]) -> None:
        """The supervisor says that the loop process has died, and what became of the neutral command."""
        self.poll()  # what the loop still said comes first
        self.mailbox.loop_died(death["generation"], f"{death['why']}; {death['neutral']}")
        self._link.send(death)
