"""Faults of a bus on command: frames go in, and come out lost, late, out of order, damaged, or not alone.

Pure: time is handed in and chance is seeded.
"""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, Literal, NamedTuple

from pydantic import BaseModel, ConfigDict, Field, model_validator

if TYPE_CHECKING:
    from collections.abc import Collection
    from random import Random

KINDS = ("drop", "delay", "reorder", "corrupt", "garbage", "freeze", "stop")


class Frame(NamedTuple):
    """A CAN frame on its way; `message` is its name in the DBC, "" for garbage."""

    message: str
    frame_id: int
    extended: bool
    data: bytes
    fd: bool = False


class Fault(BaseModel):
    """One fault; a new one replaces the one of the same kind.

    `drop`, `reorder` (swap with the next of its message) and `corrupt` (one byte is changed) hit each frame
    with `probability`; `delay` makes all later by `seconds`; `garbage` adds frames that nobody knows or that
    are of wrong length, at `rate_hz`; `freeze` repeats the last readings, counted as new; `stop` sends none.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    kind: Literal["drop", "delay", "reorder", "corrupt", "garbage", "freeze", "stop"]
    probability: Annotated[float, Field(ge=0, le=1)] | None = None
    seconds: Annotated[float, Field(ge=0, le=60)] | None = None
    rate_hz: Annotated[float, Field(gt=0, le=20000)] | None = None
    message: str | None = None
    """Only this message; none: all."""

    @model_validator(mode="after")
    def _has_what_its_kind_needs(self) -> Fault:
        needs = {"delay": "seconds", "garbage": "rate_hz", "freeze": None, "stop": None}
        needed = needs.get(self.kind, "probability")
        for name in ("probability", "seconds", "rate_hz"):
            given = getattr(self, name) is not None
            if given != (name == needed):
                raise ValueError(f"{self.kind} {'takes no' if given else 'needs'} {name}")
        return self


@dataclass
class FaultLine:
    """The line that sensor frames pass on their way to the bus.

    Attributes:
        random: Source of chance.
        known: Identifiers (id, extended) that garbage must not have.
        counts: How often each kind has struck.
    """

    random: Random
    known: Collection[tuple[int, bool]]
    counts: dict[str, int] = field(default_factory=lambda: dict.fromkeys(KINDS, 0))
    active: dict[str, Fault] = field(default_factory=dict)
    _queue: list[tuple[float, int, Frame]] = field(default_factory=list)
    _held: dict[str, Frame] = field(default_factory=dict)
    _entered: int = 0
    _next_garbage: float = math.inf
    _pattern: Frame | None = None

    def set(self, t: float, fault: Fault) -> None:
        """Have this fault from `t` [s] on."""
        self.active[fault.kind] = fault
        if fault.kind == "garbage":
            self._next_garbage = t

    def clear(self) -> None:
        """Have no faults; what is delayed or held back still comes."""
        self.active.clear()
        self._next_garbage = math.inf

    def hits(self, kind: str, message: str) -> bool:
        """Whether the fault of this kind strikes a frame of this message now; counted if so."""
        fault = self.active.get(kind)
        if fault is None or fault.message not in (None, message):
            return False
        struck = fault.probability is None or self.random.random() < fault.probability
        self.counts[kind] += struck
        return struck

    def put(self, t: float, frame: Frame) -> None:
        """A frame leaves the sensor at `t` [s]."""
        self._pattern = frame
        if self.active:
            self._strike(t, frame)
        else:
            self._release(t, frame)

    def _strike(self, t: float, frame: Frame) -> None:
        message = frame.message
        if self.hits("stop", message) or self.hits("drop", message):
            return
        if self.hits("corrupt", message):
            frame = self._damaged(frame)
        if message not in self._held and self.hits("reorder", message):
            self._held[message] = frame
            return
        late = self.active["delay"].seconds or 0.0 if self.hits("delay", message) else 0.0
        self._release(t + late, frame)

    def _release(self, due: float, frame: Frame) -> None:
        self._enqueue(due, frame)
        held = self._held.pop(frame.message, None) if self._held else None
        if held is not None:
            self._enqueue(due, held)

    def _enqueue(self, due: float, frame: Frame) -> None:
        self._entered += 1  # frames of one time stay in order
        heapq.heappush(self._queue, (due, self._entered, frame))

    def next_due(self) -> float:
        """When `take` will next have something [s]; inf if nothing is on its way."""
        return min(self._queue[0][0] if self._queue else math.inf, self._next_garbage)

    def take(self, t: float) -> list[Frame]:
        """The frames that reach the bus up to `t` [s], in order."""
        while self._next_garbage <= t:
            self._enqueue(self._next_garbage, self._garbage())
            self._next_garbage += 1.0 / (self.active["garbage"].rate_hz or math.inf)
        out = []
        while self._queue and self._queue[0][0] <= t:
            out.append(heapq.heappop(self._queue)[2])
        return out

    def _damaged(self, frame: Frame) -> Frame:
        if not frame.data:
            return frame
        data = bytearray(frame.data)
        data[self.random.randrange(len(data))] ^= self.random.randrange(1, 256)
        return frame._replace(data=bytes(data))

    def _garbage(self) -> Frame:
        self.counts["garbage"] += 1
        noise = self.random.randbytes(self.random.randrange(9))
        pattern = self._pattern
        if pattern is not None and len(noise) != len(pattern.data) and self.random.random() < 0.5:
            return pattern._replace(message="", data=noise, fd=False)
        while True:
            frame_id = self.random.randrange(0x800)
            if (frame_id, False) not in self.known:
                return Frame("", frame_id, False, noise)
