"""Connections without a seat: not authorised yet, or more than `server.max_clients`.

They can authenticate and call an e-stop. They leave soon, and take no seat from those that have one.
"""

from __future__ import annotations

import asyncio
from collections import Counter
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from seod.gateway.connection import Connection

AUTHENTICATE_S = 3.0
"""Longest stay; a client authenticates with its first line."""
PLACES = 64
"""Most connections in it; then the oldest goes, of the computer that has most of them."""


class Lobby:
    """Who waits, oldest first, and who has a seat.

    Args:
        seats: How many clients may have one.
    """

    def __init__(self, seats: int) -> None:
        self.seated: set[Connection] = set()
        self.turned_away = 0
        """Connections that were closed here so far."""
        self._seats = seats
        self._waiting: dict[Connection, None] = {}

    def __len__(self) -> int:
        """How many wait."""
        return len(self._waiting)

    def enter(self, connection: Connection) -> None:
        """A new connection: it waits here until it takes a seat."""
        self._waiting[connection] = None
        connection.session.take_seat = lambda: self._seat(connection)
        if connection.session.may_read and self._seat(connection):
            return
        loop = asyncio.get_running_loop()
        connection.deadline = loop.call_later(AUTHENTICATE_S, self._be_late, connection)
        if len(self._waiting) > PLACES:
            self._turn_away(self._oldest_of_most())

    def leave(self, connection: Connection) -> None:
        """It has ended."""
        self._waiting.pop(connection, None)
        self.seated.discard(connection)

    def _seat(self, connection: Connection) -> bool:
        """Give a seat, if there is one or it has one already."""
        if connection in self._waiting and len(self.seated) < self._seats:
            del self._waiting[connection]
            self.seated.add(connection)
            if connection.deadline is not None:
                connection.deadline.cancel()
        return connection in self.seated

    def _be_late(self, connection: Connection) -> None:
        if connection in self._waiting:
            self._turn_away(connection)

    def _turn_away(self, connection: Connection) -> None:
        del self._waiting[connection]
        self.turned_away += 1
        connection.abort()

    def _oldest_of_most(self) -> Connection:
        hosts = Counter(each.host for each in self._waiting)
        crowd = hosts.most_common(1)[0][0]
        return next(each for each in self._waiting if each.host == crowd)
