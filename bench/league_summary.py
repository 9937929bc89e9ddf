"""Bias, RMS over the bound and coverage of each method of the league, and the tables of all."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from accuracy_summary import NAMES, Z95, number, percent, share, table
from league_cases import GRID, QUICK, VARIED, factor
from league_rivals import TABLE
from league_runs import METHODS, OURS, STATES_INTERVALS

if TYPE_CHECKING:
    from accuracy_cases import Case
    from league_runs import Heard

Found = dict[str, list["Heard"]]
GOAL, FEWEST = 1.1, 0.2
"""RMS of `wave` over the bound; and the share of records with an answer below which a method has no RMS."""
SMALLER = 5.0
"""How many times smaller than the best other's the RMS of `wave` shall be at 1 % noise."""
AT = 0.01
NEEDS = {
    "wave": "K_L, delay (or neither: then wider)",
    "exact": "K_L, delay, hysteresis",
    "two-phase": "nothing",
    "peaks": "K_L",
} | {name: rival.told for name, rival in TABLE.items()}
CASES = list(dict.fromkeys([*GRID, *VARIED, *QUICK]))


@dataclass(frozen=True)
class Summary:
    """Of one method in one case, over its answers; pairs are of omega_n and zeta.

    Attributes:
        runs: Records.
        good: Answers.
        words: Why there was none, most frequent first.
        bias: Mean relative error.
        sd: Standard deviation of the relative errors.
        rms: Root mean square of the relative errors.
        ratio: The same of errors over each record's bound; nan without noise.
        covered: Answers whose 95 % interval holds the truth; None where a method states none.
    """

    runs: int
    good: int
    words: list[str]
    bias: tuple[float, float]
    sd: tuple[float, float]
    rms: tuple[float, float]
    ratio: tuple[float, float]
    covered: tuple[int, int] | None

    def chance(self, k: int) -> float:
        """By how much `ratio` may be off (95 %): that of as many normal errors."""
        return Z95 * self.ratio[k] / math.sqrt(2.0 * max(self.good, 1))

    @property
    def answers(self) -> bool:
        """Whether it answers often enough to be compared."""
        return self.good >= FEWEST * self.runs


def summary(heard: list[Heard], method: str) -> Summary | None:
    """None where the method was not asked."""
    said = [each[method] for each in heard if method in each]
    if not said:
        return None
    good = [x for x in said if x.numbers]
    numbers = np.array([x.numbers for x in good]).reshape(-1, 2, 2)
    limits = np.array([x.bound for x in good]).reshape(-1, 2)
    errors = numbers[:, :, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        scaled = np.where(limits > 0.0, errors / limits, math.nan)
    held = np.abs(errors) <= Z95 * numbers[:, :, 1]
    return Summary(
        runs=len(said),
        good=len(good),
        words=[word for word, _ in Counter(x.quality for x in said if not x.numbers).most_common()],
        bias=_pair(errors),
        sd=_pair((errors - np.mean(errors, axis=0)) ** 2, root=True) if good else (math.nan, math.nan),
        rms=_pair(errors**2, root=True),
        ratio=_pair(scaled**2, root=True),
        covered=tuple(np.count_nonzero(held, axis=0).tolist()) if method in STATES_INTERVALS else None,
    )


def _pair(values: np.ndarray, *, root: bool = False) -> tuple[float, float]:
    if not len(values):
        return math.nan, math.nan
    a, b = (float(x) for x in np.mean(values, axis=0))
    return (math.sqrt(a), math.sqrt(b)) if root else (a, b)


def of(found: Found, case: Case, method: str) -> Summary | None:
    """None where nothing was done, or the method answers too seldom."""
    s = summary(found.get(case.name, []), method)
    return s if s and s.answers else None


def done(found: Found, *, noisy: bool) -> list[Case]:
    """Cases with results, with noise or without."""
    return [case for case in CASES if case.name in found and (case.noise > 0.0) == noisy]


def label(case: Case) -> list[str]:
    """Plant, noise and what is varied."""
    return [f"{case.zeta:g}", f"{case.turn:g}", f"{100 * case.noise:g}", factor(case)]


HEAD = ["zeta", "omega_n Ts", "noise %", "what"]


def league(found: Found) -> str:
    """A line for each method: all cases with 1 % noise together, and the largest bias of those without."""
    head = ["method", "needs to know", "answers %", "RMS / bound, median (worst)", ""]
    head += [
        "RMS %, median (worst)",
        "",
        "bias without noise %, median (worst)",
        "",
        "95 % interval covers %",
        "",
    ]
    rows = [["", "", "", *NAMES * 4]]
    at = [case for case in done(found, noisy=True) if case.noise == AT]
    clean = done(found, noisy=False)
    for method in METHODS:
        every = [s for case in at if (s := summary(found[case.name], method))]
        if every:
            good = [s for s in every if s.answers]
            still = [s for case in clean if (s := of(found, case, method))]
            rows.append([method, NEEDS[method], percent(_answered(every))]
                        + [_spread([s.ratio[k] for s in good], number) for k in (0, 1)]
                        + [_spread([s.rms[k] for s in good], percent) for k in (0, 1)]
                        + [_spread([abs(s.bias[k]) for s in still], percent) for k in (0, 1)]
                        + [_coverage(good, k) for k in (0, 1)])  # fmt: skip
    return table(head, rows)


def _answered(every: list[Summary]) -> float:
    return sum(s.good for s in every) / sum(s.runs for s in every)


def _spread(values: list[float], form) -> str:
    return f"{form(float(np.median(values)))} ({form(max(values))})" if values else "-"


def _coverage(every: list[Summary], k: int) -> str:
    stated = [s for s in every if s.covered]
    return share(sum(s.covered[k] for s in stated), sum(s.good for s in stated)) if stated else "none stated"


def rivals_of_wave() -> list[str]:
    """All but ours."""
    return [method for method in METHODS if method not in OURS]


def best_other(found: Found, case: Case, k: int, left_out: tuple[str, ...] = ()) -> tuple[str, float] | None:
    """The rival with the smallest RMS, and that."""
    said = {
        name: s.rms[k] for name in rivals_of_wave() if name not in left_out and (s := of(found, case, name))
    }
    best = min(said, key=said.__getitem__, default=None)
    return (best, said[best]) if best else None


MAXIMUM_LIKELIHOOD = ("asymmetric", "asymmetric, told")
"""Rivals that fit the whole response, as `wave` does."""


def goals(found: Found) -> str:
    """`wave` in each case with noise: RMS over the bound, coverage, and the best others at 1 % noise."""
    head = [*HEAD, "answers", "RMS / bound (95 % of chance)", "", "95 % interval covers %", ""]
    head += ["best other's RMS over wave's", "", "best without a fit of the whole response", ""]
    rows = [["", "", "", "", "", *NAMES * 4]]
    for case in done(found, noisy=True):
        s = summary(found[case.name], "wave")
        cells = [*label(case), f"{s.good} of {s.runs}"]
        if s.answers:
            cells += [f"{s.ratio[k]:.2f} ± {s.chance(k):.2f}" for k in (0, 1)]
            cells += [share(s.covered[k], s.good) for k in (0, 1)]
            for out in ((), MAXIMUM_LIKELIHOOD):
                cells += [
                    _times(best_other(found, case, k, out), s.rms[k]) if case.noise == AT else ""
                    for k in (0, 1)
                ]
        else:
            cells += [f"`{s.words[0]}`", *[""] * 7]
        rows.append(cells)
    return table(head, rows)


def _times(best: tuple[str, float] | None, rms: float) -> str:
    return f"{best[1] / rms:.1f} ({best[0]})" if best else "-"


def verdict(found: Found) -> str:
    """The two goals, counted."""
    lines = [*_against_the_bound(found), *_against_the_others(found)]
    return "\n".join(f"- {line}" for line in lines) + "\n"


def _against_the_bound(found: Found) -> list[str]:
    cases, lines = done(found, noisy=True), []
    every = [(case, s) for case in cases if (s := of(found, case, "wave"))]
    for k, name in enumerate(NAMES):
        over = [_words(case) for case, s in every if s.ratio[k] - s.chance(k) > GOAL]
        squares, counts = zip(*((s.ratio[k] ** 2, s.good) for _, s in every), strict=True)
        pooled = math.sqrt(np.average(squares, weights=counts))
        lines.append(
            f"{name}: RMS of `wave` over the bound is {pooled:.3f}, {len(every)} cases together (at most"
            f" {GOAL:g} wanted); above that beyond chance in {len(over)}{': ' * bool(over)}{'; '.join(over)}."
        )
    silent = [_words(case) for case in cases if not of(found, case, "wave")]
    return [*lines, f"No answer of `wave` that is `ok`: {'; '.join(silent)}."] if silent else lines


def _against_the_others(found: Found) -> list[str]:
    lines, at = [], [case for case in done(found, noisy=True) if case.noise == AT]
    for title, out in (("all others", ()), ("those without a fit of the whole response", MAXIMUM_LIKELIHOOD)):
        for k, name in enumerate(NAMES):
            pairs = [(best_other(found, case, k, out), of(found, case, "wave")) for case in at]
            times = [best[1] / s.rms[k] for best, s in pairs if best and s]
            if times:
                lines.append(
                    f"{name} at 1 % noise, best of {title}: RMS over that of `wave` {np.median(times):.1f}"
                    f" (median; {min(times):.1f} to {max(times):.1f}), at least {SMALLER:g} in"
                    f" {sum(x >= SMALLER for x in times)} of {len(times)} cases."
                )
    return lines


def _words(case: Case) -> str:
    return " ".join(
        f"{name} {word}".strip()
        for name, word in zip(("zeta", "omega_n Ts", "noise %", ""), label(case), strict=True)
        if word
    )


def every_method(found: Found, k: int, *, noisy: bool) -> str:
    """RMS in % of all methods in each case with noise, or bias in % without."""
    names = [m for m in METHODS if any(m in each for heard in found.values() for each in heard[:1])]
    rows = [
        [*label(case), *(_cell(summary(found[case.name], method), k, noisy=noisy) for method in names)]
        for case in done(found, noisy=noisy)
    ]
    return table([*HEAD, *names], rows)


def _cell(s: Summary | None, k: int, *, noisy: bool) -> str:
    """How many answered where not nearly all did."""
    if s is None:
        return ""
    if not s.answers:
        return f"`{s.words[0]}`"
    text = percent(s.rms[k]) if noisy else percent(s.bias[k], "+")
    return text if s.good > 0.98 * s.runs else f"{text}; {100 * s.good / s.runs:.0f} % answer"
