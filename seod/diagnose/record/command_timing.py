"""Commands that a logger took late, or seldom: recorded as steps, while they ran on between two looks."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple, Self

import numpy as np

from seod.diagnose.record.series import straight_on
from seod.diagnose.tuning.record import COMMAND_TIMING, SWITCH_TIMES

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.diagnose.record.series import Series
    from seod.diagnose.result import Array, Rows


class Timing(NamedTuple):
    """Commands that run straight on from look to look.

    Attributes:
        lead: By how many rows earlier than recorded they were given.
        holds: They hold from look to look instead.
    """

    lead: float
    holds: bool = False

    @classmethod
    def told_by(cls, one: Series) -> Self:
        """That of a recording with other commands."""
        return (
            cls(one.lead - COMMAND_TIMING.middle * looks(one.u)) if one.runs_on else cls(one.lead, holds=True)
        )

    def of(self, one: Series) -> Series:
        """A recording with such commands; as it is where they stay for many rows, and would run on."""
        if self.holds:
            return earlier(one, self.lead)
        t_u, u = one.t_u, one.u
        rows = looks(u)
        if not rows:
            return one
        if rows > 1:
            seen = np.arange(int(np.flatnonzero(np.diff(u))[0] + 1) % rows, len(u), rows)
            u = np.interp(t_u, t_u[seen], u[seen])
        lead = self.lead + COMMAND_TIMING.middle * rows
        return replace(one, other_drive=straight_on(t_u - self.lead * one.tick, u), lead=lead)


def earlier(one: Series, rows: float) -> Series:
    """A recording with its commands so many rows earlier."""
    times, volts = one.drive
    return replace(one, other_drive=(times - rows * one.tick, volts), lead=one.lead + rows)


def timings(every: Sequence[Series]) -> list[Timing]:
    """How commands may have been given other than recorded; none where they stay for many rows.

    From half a row later than straight on, as steps from row to row would be, to a row earlier. None is later
    where each row has a look of its own. Where it is told when they were given, they may have changed between
    two looks, but not earlier.
    """
    rows = {looks(one.u) for one in every}
    if len(rows) > 1 or 0 in rows or not all(one.as_recorded for one in every):
        return []
    told = any(not np.array_equal(one.t_u, one.t) for one in every)
    if told and 1 in rows:
        return []
    latest = 0.0 if 1 in rows else COMMAND_TIMING.latest_lead
    leads: Array = np.linspace(latest, COMMAND_TIMING.earliest_lead, COMMAND_TIMING.leads)
    return [Timing(lead) for lead in leads.tolist() if lead <= 0.0 or not told]


def looks(u: Array) -> int:
    """Rows from one look at the commands to the next; 0 where they stay for longer than that."""
    changes = np.flatnonzero(np.diff(u))
    if len(changes) < COMMAND_TIMING.fewest:
        return 0
    apart = np.bincount(np.diff(changes))
    rows = int(np.argmax(apart))
    regular = apart[rows] >= COMMAND_TIMING.mostly * (len(u) / rows)
    return rows if regular and rows <= COMMAND_TIMING.most_rows else 0


def switches(one: Series) -> Rows:
    """Rows that are the first with another command."""
    return np.flatnonzero(np.diff(one.u)) + 1


def switch_look(one: Series) -> int:
    """Rows from one look at a relay's commands to the next; 0 where nothing is to be told of its switches.

    All switches are whole numbers of looks apart.
    """
    apart = np.diff(switches(one))
    as_recorded = one.as_recorded and not one.timed and len(one.blocks) == 1
    if not one.relayed or not as_recorded or len(apart) < SWITCH_TIMES.fewest:
        return 0
    rows = int(np.gcd.reduce(apart))
    return rows if float(np.median(apart)) >= SWITCH_TIMES.apart * rows else 0


def switched(one: Series, leads: Array) -> Series:
    """A recording with each of its switches so many rows earlier, shape (switches,)."""
    begin = np.r_[0, switches(one)]
    times = one.t_u[begin]
    times[1:] -= leads * one.tick
    times = np.maximum.accumulate(times)
    return replace(one, other_drive=(times, one.u[begin]), lead=float(np.mean(leads)), timed=True)
