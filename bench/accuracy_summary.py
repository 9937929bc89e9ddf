"""Bias, scatter relative to the bound and coverage of one method in one case, and the tables of all."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from accuracy_cases import GRID, PLANTS, TURNS, ZETAS, Case, about_the_plants
from accuracy_runs import METHODS

if TYPE_CHECKING:
    from collections.abc import Callable

    from accuracy_runs import Heard

Z95 = 1.959964
NAMES = ("omega_n", "zeta")
PLAIN = [Case(*plant) for plant in PLANTS]
Found = dict[str, list["Heard"]]


@dataclass(frozen=True)
class Summary:
    """Of the answers that are `ok` at the records' ends; pairs are of omega_n and zeta.

    Attributes:
        runs: Records.
        words: How many ended with which quality.
        bias: Mean relative error.
        sd: Standard deviation of the relative errors.
        ratio: The same with each error over its record's bound; nan without noise.
        rms: Root mean square of errors over stated standard deviations.
        covered: Answers whose 95 % interval holds the truth.
        first: Cycles to the first `ok`, shape (those that have one,).
        first_covered: Intervals of these first answers that hold the truth.
    """

    runs: int
    words: Counter[str]
    bias: tuple[float, float]
    sd: tuple[float, float]
    ratio: tuple[float, float]
    rms: tuple[float, float]
    covered: tuple[int, int]
    first: np.ndarray
    first_covered: tuple[int, int]

    @property
    def good(self) -> int:
        """Answers that are `ok`."""
        return self.words["ok"]


def summary(heard: list[Heard], method: str) -> Summary | None:
    """None where the method does not suit the case."""
    said = [(each.bound, each.said[method]) for each in heard if method in each.said]
    if not said:
        return None
    good = [(limit, x.last) for limit, x in said if x.quality == "ok" and x.last]
    numbers = np.array([x for _, x in good]).reshape(-1, 2, 2)
    limits = np.array([limit for limit, _ in good]).reshape(-1, 2)
    first = [x.first for _, x in said if x.first]
    first_after = np.array([x.first_after for _, x in said if x.first_after is not None])
    errors, stated = numbers[:, :, 0], np.maximum(numbers[:, :, 1], 1e-12)
    with np.errstate(divide="ignore", invalid="ignore"):
        scaled = np.where(limits > 0.0, errors / limits, math.nan)
    return Summary(
        runs=len(said),
        words=Counter(x.quality for _, x in said),
        bias=_pair(_or_nan(np.mean, errors)),
        sd=_pair(_or_nan(np.std, errors)),
        ratio=_pair(_or_nan(np.std, scaled)),
        rms=_pair(np.sqrt(_or_nan(np.mean, (errors / stated) ** 2))),
        covered=_covered(numbers),
        first=first_after,
        first_covered=_covered(np.array(first).reshape(-1, 2, 2)),
    )


def _pair(values: np.ndarray) -> tuple[float, float]:
    return float(values[0]), float(values[1])


def _or_nan(of: Callable[..., np.ndarray], x: np.ndarray) -> np.ndarray:
    return of(x, axis=0) if len(x) else np.full(2, math.nan)


def _covered(numbers: np.ndarray) -> tuple[int, int]:
    held = np.abs(numbers[:, :, 0]) <= Z95 * numbers[:, :, 1]
    a, b = np.count_nonzero(held, axis=0).tolist()
    return a, b


def wilson(hits: int, count: int) -> tuple[float, float]:
    """95 % interval of a share (Wilson, J. Am. Stat. Assoc. 22, 1927)."""
    if count == 0:
        return 0.0, 1.0
    share, z2 = hits / count, Z95**2
    centre = (share + z2 / (2 * count)) / (1.0 + z2 / count)
    half = Z95 / (1.0 + z2 / count) * math.sqrt(share * (1.0 - share) / count + z2 / (4.0 * count**2))
    return centre - half, centre + half


def share(hits: int, count: int, interval: bool = True) -> str:
    """As `95.1 (93.6-96.3)` %."""
    if count == 0:
        return "-"
    low, high = wilson(hits, count)
    text = f"{100 * hits / count:.1f}"
    return f"{text} ({100 * low:.1f}-{100 * high:.1f})" if interval else text


def number(x: float, digits: int = 2) -> str:
    """With a dash for what is undefined."""
    return f"{x:.{digits}f}" if math.isfinite(x) else "-"


def percent(x: float, sign: str = "") -> str:
    """Two digits, no exponent."""
    x *= 100.0
    if abs(x) < 5e-4:
        return "0"
    return f"{x:{sign}.0f}" if abs(x) >= 10.0 else f"{x:{sign}.2g}"


def table(head: list[str], rows: list[list[str]]) -> str:
    """As Markdown."""
    return "\n".join("| " + " | ".join(row) + " |" for row in [head, ["---"] * len(head), *rows]) + "\n"


def goals(found: Found) -> str:
    """`wave` against the goals, by case of the grid; errors in %."""
    head = [
        "zeta",
        "omega_n Ts",
        "runs",
        "ok %",
        "sd / bound",
        "",
        "bias %",
        "",
        "95 % interval covers %",
        "",
    ]
    head.append("first ok, cycles")
    rows = [["", "", "", "", *["omega_n", "zeta"] * 3, "median, 99 %"]]
    for case in (*PLAIN, *GRID):
        s = summary(found.get(case.name, []), "wave")
        if s:
            rows.append([f"{case.zeta:g}", f"{case.turn:g}", str(s.runs), f"{100 * s.good / s.runs:.1f}",
                         *(number(x) for x in s.ratio), *(f"{100 * x:+.3f}" for x in s.bias),
                         *(share(x, s.good) for x in s.covered),
                         f"{np.median(s.first):.2f}, {np.quantile(s.first, 0.99):.2f}"])  # fmt: skip
    return table(head, rows)


def totals(found: Found) -> str:
    """`wave` over all these cases together."""
    every = [s for case in (*PLAIN, *GRID) if (s := summary(found.get(case.name, []), "wave"))]
    if not every:
        return ""
    good, first = sum(s.good for s in every), np.concatenate([s.first for s in every])
    rows = [
        [
            name,
            str(good),
            number(math.sqrt(sum(s.good * s.ratio[k] ** 2 for s in every) / good)),
            f"{max(abs(s.bias[k]) for s in every) * 100:.3f}",
            share(sum(s.covered[k] for s in every), good),
            share(sum(s.first_covered[k] for s in every), len(first)),
        ]
        for k, name in enumerate(NAMES)
    ]
    head = [
        "all together",
        "answers",
        "sd / bound",
        "largest bias %",
        "95 % interval covers %",
        "and of first answers",
    ]
    within = share(int(np.count_nonzero(first <= 2.0)), sum(s.runs for s in every))
    return table(head, rows) + f"\nA first `ok` within two cycles from rest: {within} % of the records.\n"


def methods(found: Found, which: int) -> str:
    """All methods on the grid: bias and standard deviation in % and how many intervals hold the truth."""
    rows = []
    for turn in TURNS:
        for zeta in ZETAS:
            case = next(c for c in GRID if (c.zeta, c.turn) == (zeta, turn))
            if case.name in found:
                cells = [_cell(summary(found[case.name], method), which) for method in METHODS]
                rows.append([f"{zeta:g}", f"{turn:g}", *cells])
    return table(["zeta", "omega_n Ts", *METHODS], rows)


def varied(found: Found, which: int) -> str:
    """The same for what is varied about the plants."""
    rows = []
    for _, case in about_the_plants():
        if case.name in found:
            cells = [_cell(summary(found[case.name], method), which) for method in METHODS]
            label = " ".join(case.name.split()[2:]) or "plain"
            rows.append([str(1 + PLANTS.index((case.zeta, case.turn))), label, *cells])
    return table(["plant", "what", *METHODS], rows)


def _cell(s: Summary | None, which: int) -> str:
    """Bias and standard deviation in %, coverage; how many were `ok` where not nearly all."""
    if s is None:
        return ""
    worst = s.words.most_common(1)[0][0]
    if s.good < 0.02 * s.runs:
        return f"`{worst}`"
    covered = f"{100 * s.covered[which] / max(s.good, 1):.0f} %"
    text = f"{percent(s.bias[which], '+')} ± {percent(s.sd[which])}, {covered}"
    others = [word for word, _ in s.words.most_common() if word != "ok"]
    return text if s.good > 0.98 * s.runs else f"{text}; {100 * s.good / s.runs:.0f} % ok, else `{others[0]}`"
