"""In which order messages go to the broker, from where on they go again, and when they are forgotten.

The broker's confirmation says that it has a message, not that an archive has it: one that is killed loses
what it has confirmed. So messages are forgotten only later, and sent again after each connection. Who listens
takes each key once.
"""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from seod.fleet.topics import RETAINED, Key, encode, enveloped, kind_of, topic_of

if TYPE_CHECKING:
    from collections.abc import Mapping

    from seod.fleet.store import Store

MARGIN_S: Final = 30.0
"""Without an archive that confirms: so long after the broker's confirmation a message is kept [s]; chosen."""
SAVE_S: Final = 5.0
"""How often it is written down what is released [s]; after a kill what came since is sent again."""


class Parcel(NamedTuple):
    """One message as it is sent."""

    key: Key
    topic: str
    payload: bytes
    retain: bool


class Outbox:
    """What a rig has to tell.

    Args:
        rig: Its name in the fleet.
        store: Where it waits.
        archive: Name of the archive that confirms; None for none.
    """

    def __init__(self, rig: str, store: Store, archive: str | None = None) -> None:
        self.rig, self.archive = rig, archive
        self.store = store
        self._reader = store.reader(store.released)
        self._sent = store.released
        """The newest that was ever sent."""
        self._taken: deque[tuple[float, Key]] = deque()
        self._saved = 0.0

    def put(self, suffix: str, body: Mapping[str, Any]) -> None:
        """Keep a message to be sent."""
        self.store.append(suffix, encode(body))

    def begin(self) -> None:
        """A connection begins: all that is not released is sent again."""
        self._reader = self.store.reader(self.store.released)

    def batch(self, count: int) -> list[Parcel]:
        """The next messages to send, at most so many."""
        parcels = []
        previous = self._reader.key
        for record in self._reader.take(count):
            head: dict[str, Any] = {"rig": self.rig, "session": record.key.session, "seq": record.key.seq}
            head["prev"] = previous
            if previous <= self.store.released:
                head["oldest"] = True
            if self.archive is not None:
                head["archive"] = self.archive
            payload, retain = enveloped(head, record.body), kind_of(record.suffix) in RETAINED
            parcels.append(Parcel(record.key, topic_of(self.rig, record.suffix), payload, retain))
            previous = record.key
        self._sent = max(self._sent, previous)
        return parcels

    def taken(self, key: Key, now: float) -> None:
        """The broker has confirmed all up to this key, at `now` [s] of any clock."""
        if self.archive is None:
            self._taken.append((now, key))
            self.age(now)

    def age(self, now: float) -> None:
        """Forget what the broker has had for long enough."""
        released = None
        while self._taken and now - self._taken[0][0] > MARGIN_S:
            released = self._taken.popleft()[1]
        if released is not None:
            self._release(released, now)

    def confirmed(self, key: Key, again: bool, now: float) -> None:
        """The archive has all up to this key; `again`: send what is behind it once more."""
        if key <= self._sent:
            self._release(key, now)
        if again:
            self.begin()

    def _release(self, key: Key, now: float) -> None:
        self.store.release(key)
        if now - self._saved > SAVE_S:
            self._saved = now
            self.store.save()

    def close(self) -> None:
        """Write down how far it came."""
        self.store.close()
        self.store.save()
