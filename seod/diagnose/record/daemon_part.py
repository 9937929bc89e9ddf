"""Which part of a daemon's recording tells of the plant: under excitation, and after it has changed."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

from mcap.records import Channel, Chunk, Message

from seod.diagnose.tuning.record import DAEMON_PART
from seod.files.damage import DamagedError
from seod.record.layout import EVENTS, MODEL_ERRORS
from seod.record.mcap_records import unpacked
from seod.record.read import RecordingError, beginning, message_json, records_of

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


class Part(NamedTuple):
    """Of a recording.

    Attributes:
        start: [s of the recording].
        end: Likewise; infinite where nothing ends it.
        why: What it is, in a sentence.
    """

    start: float
    end: float
    why: str


def telling_part(path: Path, axis: str | None) -> Part | None:
    """The longest time for which the daemon said that the rig had left its model, else that under excitation.

    None where there is neither, as in recordings of others. The daemon says so some segments after the
    change: from then on all rows are of the changed rig.

    Args:
        path: Any recording.
        axis: Of a recording of several axes.
    """
    try:
        own = axis or beginning(path).axes[0]
    except RecordingError:
        return None
    left, excited = _Times(), _Times()
    for topic, told in _messages(path, (MODEL_ERRORS + own, EVENTS)):
        if topic != EVENTS:
            left.take(told["t"], told.get("left") is True)
        elif told.get("event") == "state" and told.get("axis") == own:
            excited.take(told["t"], told.get("state") == "exciting")
    excited.take(math.inf, False)
    for times, why in ((left, "the rig had left its model"), (excited, "the rig was excited")):
        if times.longest[1] - times.longest[0] >= DAEMON_PART.least_s:
            return Part(*times.longest, why)
    return None


class _Times:
    """The longest time for which something was true."""

    def __init__(self) -> None:
        self.longest = 0.0, 0.0
        self._since: float | None = None

    def take(self, t: float, is_true: bool) -> None:
        """It is so at `t`."""
        if self._since is not None and t - self._since > self.longest[1] - self.longest[0]:
            self.longest = self._since, t
        if not is_true:
            self._since = None
        elif self._since is None:
            self._since = t


def _messages(path: Path, topics: tuple[str, ...]) -> Iterator[tuple[str, dict[str, Any]]]:
    """JSON messages of some topics, in their order; what is damaged is told by who reads the rows."""
    names: dict[int, str] = {}
    for record in records_of(path):
        if not isinstance(record, Chunk):
            continue
        try:
            content = unpacked(record)
        except DamagedError:
            continue
        for each in content:
            if isinstance(each, Channel):
                names[each.id] = each.topic
            elif isinstance(each, Message) and names.get(each.channel_id, "") in topics:
                told = message_json(each.data)
                if told:
                    yield names[each.channel_id], told
