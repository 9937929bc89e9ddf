"""Which part of a daemon's recording tells of the plant: under excitation, and after it has changed."""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from mcap.records import Channel, Chunk, Message
from mcap.stream_reader import breakup_chunk

from seod.record.layout import EVENTS, MODEL_ERRORS
from seod.record.read import BROKEN, RecordingError, beginning, records

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

LEAST_S: Final = 3.0
"""Of a part that is diagnosed alone."""


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

    None where there is neither, as in recordings of others. The daemon says so some stretches after the
    change: from then on all rows are of the changed rig.

    Args:
        path: Any recording.
        axis: Of a recording of several axes.
    """
    try:
        own = axis or beginning(path).axes[0]
    except (RecordingError, *BROKEN):
        return None
    left, excited = _Times(), _Times()
    for topic, told in _messages(path, (MODEL_ERRORS + own, EVENTS)):
        if topic != EVENTS:
            left.take(told["t"], told["left"])
        elif told.get("event") == "state" and told.get("axis") == own:
            excited.take(told["t"], told["state"] == "exciting")
    excited.take(math.inf, False)
    for times, why in ((left, "the rig had left its model"), (excited, "the rig was excited")):
        if times.longest[1] - times.longest[0] >= LEAST_S:
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
    for record in records(path):
        if not isinstance(record, Chunk):
            continue
        try:
            content = breakup_chunk(record, validate_crc=True)
        except BROKEN:
            continue
        for each in content:
            if isinstance(each, Channel):
                names[each.id] = each.topic
            elif isinstance(each, Message) and names.get(each.channel_id, "") in topics:
                yield names[each.channel_id], json.loads(each.data)
