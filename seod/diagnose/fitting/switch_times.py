"""When each switch of a relay was given, where a record only has the row that saw it first.

Each is late by a time of its own, up to a look at the commands, which moves the load for good: an effect, or
a load that oscillates, takes the place of that. Times are told beside the numbers of a set (`linear_leads`),
and believed where they are far likelier than one time for all switches up and one for all down.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np

from seod.diagnose.fitting.beside import correlated_rows
from seod.diagnose.fitting.initial_states import begun_states
from seod.diagnose.fitting.least_squares import LeastSquares, fit, weighted
from seod.diagnose.fitting.linear_leads import LinearLeads, WindowColumns, solved_leads, without_end
from seod.diagnose.record.command_timing import switch_look, switched, switches
from seod.diagnose.record.windows import Cut, fitted_windows
from seod.diagnose.tuning.record import SWITCH_TIMES

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from seod.diagnose.fitting.least_squares import Fitted
    from seod.diagnose.fitting.linear_leads import SolvedLeads
    from seod.diagnose.fitting.work import ParallelMap
    from seod.diagnose.record.series import Series
    from seod.diagnose.result import Array, Mask, Rows

    Leads = Sequence[Array]


class SwitchTimes(NamedTuple):
    """When switches were given.

    Attributes:
        leads: By how many rows earlier than recorded, of each recording one for each switch.
        told_by: The set that tells them, fitted with them.
    """

    leads: Leads
    told_by: Fitted

    def of(self, every: Sequence[Series]) -> list[Series]:
        """The recordings with commands given at these times."""
        return [switched(one, leads) for one, leads in zip(every, self.leads, strict=True)]

    @property
    def sentence(self) -> str:
        """A remark."""
        every = np.concatenate(list(self.leads))
        return (
            f"each of the {len(every)} switches of the relay is taken to have been given at its own time, "
            f"{np.mean(every):.2g} ± {np.std(every):.2g} rows earlier than recorded: the plant moved so. "
            "A column t_u tells when commands were given"
        )


def switch_times(
    sets: Sequence[Fitted],
    windows: Cut,
    parallel: ParallelMap,
    begun: Callable[[], Sequence[Fitted]] = tuple,
    over: Callable[[], bool] = lambda: False,
) -> SwitchTimes | None:
    """When the switches in windows were given; None where that is told, or where two times do as well.

    Args:
        sets: Fitted to some of the windows.
        windows: All of the recordings, with commands as recorded.
        parallel: Maps a function over trials.
        begun: Sets to begin from where those are not believed. Their numbers and times go on together: fitted
            to commands as recorded they would be led away first.
        over: Tells when no further round begins.
    """
    if not all(switch_look(one) for one in windows.series):
        return None
    search = _Search(fitted_windows(windows), parallel, over)
    if not 0 < search.most <= SWITCH_TIMES.most_in_window:
        return None
    ended = list(parallel(search.run, sets))
    at = search.believed(ended) or search.believed([*ended, *parallel(search.begin, begun())])
    if at is None:
        return None
    at = _in_one_run(at, windows, parallel, over)
    return SwitchTimes(at.leads, at.fitted)


def _in_one_run(at: _At, windows: Cut, parallel: ParallelMap, over: Callable[[], bool]) -> _At:
    """The same so that one run of each recording keeps to it.

    Near its ends a window's initial state stands for the time of a switch. One that runs on is led away. So
    times are told anew in whole windows, and near their ends by windows from the middle of each to that of
    the next, with the same numbers: other ones would have other times. Not where a coarse sensor's rounding
    hides where a run has come to.
    """
    if windows.coarse:
        return at
    at = _in_longer(at, _Search(windows, parallel, over)) or at
    middles = _from_middle_to_middle(windows)
    alone = _Search(middles, parallel, over, times_alone=True) if middles.windows else None
    between = _in_longer(at, alone) if alone else None
    if between is None:
        return at
    pairs = enumerate(zip(windows.series, at.leads, between.leads, strict=True))
    leads = [
        np.where(_within_by(one, k, windows) >= _within_by(one, k, middles), old, new)
        for k, (one, old, new) in pairs
    ]
    return _Search(windows, parallel, over).fitted(at.fitted, leads)


def _from_middle_to_middle(windows: Cut) -> Cut:
    """Windows from the middle of each to that of the next, where that one follows at once."""
    pairs = pairwise(windows.windows)
    both = [(k, (a + b) // 2, (b + c) // 2) for (k, a, b), (other, d, c) in pairs if (other, d) == (k, b)]
    return Cut(windows.series, tuple(both))


def _in_longer(at: _At, search: _Search) -> _At | None:
    """The same in longer windows; None where these have too many switches, or none."""
    if not 0 < search.most <= SWITCH_TIMES.most_in_window:
        return None
    return search.ended(search.fitted(at.fitted, at.leads))[0]


def _within_by(one: Series, of: int, windows: Cut) -> Rows:
    """Rows from each switch of a recording to the nearer end of its window; below 0 outside of all."""
    rows = switches(one)
    by = np.full(len(rows), -1)
    for _, first, last in (each for each in windows.windows if each[0] == of):
        by = np.maximum(by, np.minimum(rows - first, last - 1 - rows))
    return by


class _At(NamedTuple):
    """A set fitted with switches that were given so many rows earlier."""

    fitted: Fitted
    leads: Leads


_Ended: TypeAlias = tuple[_At, LinearLeads]


class _Search:
    """What is the same in all rounds: windows, switches in each, the deviation of their leads [rows]."""

    def __init__(
        self,
        cut: Cut,
        parallel: ParallelMap,
        over: Callable[[], bool] = lambda: False,
        *,
        times_alone: bool = False,
    ) -> None:
        self.cut, self.parallel, self.over, self.times_alone = cut, parallel, over, times_alone
        self.own = _within(cut)
        self.most = max(len(each) for each in self.own)
        self.deviation = SWITCH_TIMES.unsure * max(switch_look(one) for one in cut.series)
        self.recorded = [np.full(len(switches(one)), one.lead) for one in cut.series]

    def run(self, fitted: Fitted) -> _Ended:
        """A set with the times and numbers that it comes to, fitted to commands as recorded before."""
        return self.ended(self.fitted(fitted, self.recorded))

    def begin(self, fitted: Fitted) -> _Ended:
        """Likewise from numbers as they are."""
        return self.ended(self.fitted(fitted, self.recorded, 0))

    def believed(self, ended: Sequence[_Ended]) -> _At | None:
        """The set that tells the times; None where its times are not believed.

        The first that errs, with its own times, about as little as any of them, those with fewer effects
        first, and whose switches up are as early as those down: an effect that is none bends the times to
        what it needs, and so does one that is missing.
        """
        least = min((at for at, _ in ended), key=lambda at: at.fitted.cost)
        fewer_first = sorted(ended, key=lambda one: len(one[0].fitted.model.names))
        ended = list(self.parallel(lambda one: self.nearest(one, least), fewer_first))
        most = least.fitted.cost + SWITCH_TIMES.alike
        alike = [one for one in ended if one[0].fitted.cost <= most]
        at, parts = next((one for one in alike if self.both_ways(one[0].leads)), alike[0])
        likelier = solved_leads(parts, together=False).evidence - solved_leads(parts, together=True).evidence
        return at if likelier > SWITCH_TIMES.likelier and self.are_within_a_look(at.leads) else None

    def nearest(self, ended: _Ended, least: _At) -> _Ended:
        """A set as it is, or as it is from the times and numbers of the set that errs least, if less so.

        From as recorded a set may not come to the plant, which a limit cycle hardly tells.
        """
        own, best = ended[0].fitted, least.fitted
        if own.cost <= best.cost + SWITCH_TIMES.alike or own.model.names == best.model.names:
            return ended
        x = own.model.searched(own.model.values(own.x) | best.model.values(best.x))
        other = self.ended(self.fitted(replace(own, x=x), least.leads))
        return min(ended, other, key=lambda one: one[0].fitted.cost)

    def ended(self, at: _At) -> _Ended:
        """The times and numbers that a set comes to, and what they change in the simulation."""
        parts = self.linear(at)
        for _ in range(SWITCH_TIMES.rounds):
            if self.over():
                break
            before, at = at, self.nearer(at, parts)
            parts = self.linear(at)
            if before.fitted.cost - at.fitted.cost < SWITCH_TIMES.enough:
                break
        return at, parts

    def fitted(self, fitted: Fitted, leads: Leads, steps: int = SWITCH_TIMES.fit_steps) -> _At:
        """The set fitted with these leads."""
        cut = self._given(leads)
        start = begun_states(fitted.model, fitted.x, cut)
        free = self._free(fitted)
        return _At(fit(fitted.model, cut, fitted.x, start, steps, self.parallel, free), leads)

    def _free(self, fitted: Fitted) -> Mask:
        return np.full(len(fitted.x), not self.times_alone)

    def _given(self, leads: Leads) -> Cut:
        every = [switched(one, each) for one, each in zip(self.cut.series, leads, strict=True)]
        return replace(self.cut, series=every)

    @without_end
    def linear(self, at: _At) -> LinearLeads:
        """What all numbers change in the simulation, to first order."""
        fitted, model = at.fitted, at.fitted.model
        search = LeastSquares(model, fitted.cut, self.parallel, self._free(fitted))
        left, error = search.tried(fitted.x, fitted.start)
        parts = search.derivatives(fitted.x, fitted.start, left, error)
        assert parts.table is not None  # noqa: S101 - a search has one
        windows = []
        for w, (rows, slopes) in enumerate(zip(fitted.cut.slices, self._slopes(at, left), strict=True)):
            k, weight = self.cut.windows[w][0], math.sqrt(parts.table.weights[w])
            columns, own = weight * parts.table.columns[rows], weight * self.deviation * slopes
            rises = _rises(self.cut.series[k])[self.own[w], None]
            leads = at.leads[k][self.own[w]] / self.deviation - 1.0
            states, numbers = columns[:, : parts.count], columns[:, parts.count : -1]
            kinds = own @ np.hstack([rises, ~rises])
            windows.append(WindowColumns(states, own, kinds, numbers, columns[:, -1] + own @ leads))
        free = parts.free
        low, high = (
            np.maximum(search.low - fitted.x, -search.reach),
            np.minimum(search.high - fitted.x, search.reach),
        )
        wide = math.sqrt(max(1.0, correlated_rows(fitted, left)))
        return LinearLeads(windows, free, low[free], high[free], wide)

    def _slopes(self, at: _At, left: Array) -> list[Array]:
        """What each window's switches change for each row that they are earlier, shapes (n, switches).

        One switch of every window is moved at a time: windows do not see each other's.
        """
        fitted = at.fitted

        def moved(number: int) -> Array:
            leads = [each.copy() for each in at.leads]
            for (k, _, _), own in zip(self.cut.windows, self.own, strict=True):
                leads[k][own[number : number + 1]] += SWITCH_TIMES.change
            cut = self._given(leads)
            other = np.where(cut.good, weighted(fitted.model, cut, fitted.x, fitted.start), 0.0)
            return np.asarray((left - other) / SWITCH_TIMES.change)

        every = np.stack(list(self.parallel(moved, range(self.most))), axis=1)
        return [every[rows, : len(own)] for rows, own in zip(fitted.cut.slices, self.own, strict=True)]

    def are_within_a_look(self, leads: Leads) -> bool:
        """Whether one is no more than a look before another, but for errors: more is what an effect does."""
        spread = np.quantile(np.concatenate(list(leads)), [SWITCH_TIMES.tail, 1.0 - SWITCH_TIMES.tail])
        return bool(np.ptp(spread) * SWITCH_TIMES.unsure <= SWITCH_TIMES.widest * self.deviation)

    def both_ways(self, leads: Leads) -> bool:
        """Whether switches up and down are given as early, but for chance: who notes them does not see which.

        A load that pushes to one side shortens one half of a limit cycle, as such times do.
        """
        rises = np.concatenate([_rises(one) for one in self.cut.series])
        ways = np.concatenate(list(leads))
        up, down = ways[rises], ways[~rises]
        variance = np.var(up) / max(len(up), 1) + np.var(down) / max(len(down), 1)
        return bool(abs(np.mean(up) - np.mean(down)) <= SWITCH_TIMES.one_way * math.sqrt(variance))

    def nearer(self, at: _At, parts: LinearLeads) -> _At:
        """The set with other leads if it errs less with these: all the way of a step, or a part of it.

        A limit cycle hardly tells a plant from one with another gain and damping: leads and numbers go a long
        way together, along a bend.
        """
        solved = solved_leads(parts, together=False)
        to, x = self._all_leads(at, solved), np.zeros(len(at.fitted.x))
        x[parts.free] = solved.step
        for part in SWITCH_TIMES.parts:
            leads = [old + part * (new - old) for old, new in zip(at.leads, to, strict=True)]
            tried = self.fitted(replace(at.fitted, x=at.fitted.x + part * x), leads)
            if tried.fitted.cost < at.fitted.cost:
                return tried
        return at

    def _all_leads(self, at: _At, solved: SolvedLeads) -> Leads:
        """Leads where a step goes. Switches that are in no window have the mean of the others."""
        out = [np.full(len(each), np.nan) for each in at.leads]
        for (k, _, _), own, leads in zip(self.cut.windows, self.own, solved.leads, strict=True):
            out[k][own] = self.deviation * np.clip(1.0 + leads, SWITCH_TIMES.latest, SWITCH_TIMES.earliest)
        mean = float(np.nanmean(np.concatenate(out)))
        return [np.where(np.isnan(each), mean, each) for each in out]


def _within(cut: Cut) -> list[Rows]:
    """Which of its recording's switches are within each window."""
    out = []
    for k, first, last in cut.windows:
        rows = switches(cut.series[k])
        out.append(np.flatnonzero((rows > first) & (rows < last)))
    return out


def _rises(one: Series) -> Mask:
    """Whether each switch is to a higher command, shape (switches,)."""
    return np.asarray(np.diff(one.u)[switches(one) - 1] > 0.0)
