"""The events of the loop, as clients get them: JSON-able mappings."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from seod.loop.excite import PolarityResult
    from seod.loop.guard import Trip
    from seod.processes.ring import AxisState

Event = dict[str, Any]


def state(t: float, axis: str, now: AxisState, previous: AxisState | None, why: str) -> Event:
    """An axis is in another state from `t` [s] on."""
    before = None if previous is None else previous.name.lower()
    told = {"event": "state", "t": t, "axis": axis, "state": now.name.lower()}
    return {**told, "previous": before, "why": why}


def polarity(t: float, axis: str, result: PolarityResult, voltage: float) -> Event:
    """What the polarity pulse of `voltage` [V] showed."""
    told = {"event": "polarity", "t": t, "axis": axis, "ok": result.ok, "movement": result.movement}
    return {**told, "voltage": voltage, "why": result.why}


def two_phase(t: float, axis: str, phase: Mapping[str, float] | None, code: str, why: str) -> Event:
    """The relay has the second phase `phase` from `t` [s] on, None for none any more."""
    told = {"event": "two_phase", "t": t, "axis": axis, "phase": None if phase is None else dict(phase)}
    return {**told, "code": code, "why": why}


def warning(t: float, axis: str | None, code: str, why: str) -> Event:
    """Something that does not stop the axis, or where `axis` is None the rig."""
    return {"event": "warning", "t": t, "axis": axis, "code": code, "why": why}


def reply(number: int, error: str | None) -> Event:
    """What became of the command with this number; `error` is why it was not done."""
    return {"event": "reply", "id": number, "ok": error is None, "error": error}


def fault(t: float, axis: str | None, latched: Sequence[str], trip: Trip) -> Event:
    """The fault of `axis`, or of the rig, that put the axes `latched` to neutral."""
    numbers = {name: value for name, value in trip.numbers.items() if math.isfinite(value)}
    told = {"event": "fault", "t": t, "axis": axis, "latched": list(latched)}
    return {**told, "code": trip.code, "why": trip.why, "numbers": numbers}
