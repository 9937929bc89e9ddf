"""A segment of a relay's recording from rest, and how near plants come to it."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.optimize import least_squares
from scipy.special import expit, logit

from seod.diagnose.causes.cause import Cycle
from seod.diagnose.causes.table import CAUSES, GAPS, SHAKES, grows_with_movement, sized_by_shares
from seod.diagnose.fitting.model import grouped, tolerance
from seod.diagnose.fitting.simulate import LOOSE, STATES, simulate
from seod.diagnose.record.windows import Cut
from seod.diagnose.starts.relay.plant import GridPlant
from seod.diagnose.tuning.starts import COMPARE
from sim.parameters import parameters

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.diagnose.causes.scales import Values
    from seod.diagnose.record.series import Series
    from seod.diagnose.result import Array


class Segment:
    """A segment of a recording, and what is compared of it: movements about a line in parts of its end.

    With a frequency `hidden` [rad/s], what has it is not compared. With `grown` what comes before the parts
    is compared as well, if the recording begins there: how a limit cycle grew tells the plants of a valley
    apart. Where it is `ramped` a delay is how long the valve takes from one command to the other. Plants are
    simulated with a K_L `unit` of one over the command, whatever that is measured in.
    """

    def __init__(
        self, cut: Cut, hidden: float | None = None, *, grown: bool = False, ramped: bool = False
    ) -> None:
        k, first, last = cut.windows[0]
        self.one: Series = cut.series[k]
        self.tick = self.one.tick
        cycle = self.one.period_s / self.tick
        begin = max(0, first - round(COMPARE.cycles_before * cycle))
        end = min(last, first + round(COMPARE.parts * COMPARE.cycles_a_part * cycle))
        self.cut, self.rows = Cut([self.one], ((0, begin, end),)), slice(begin, end)
        self.t, self.good = self.one.t[self.rows], self.one.good[self.rows]
        edges = np.linspace(first - begin, end - begin, COMPARE.parts + 1).astype(int).tolist()
        if grown and begin == 0 and edges[0] > cycle:
            edges = [0, *edges]
        parts = [slice(a, b) for a, b in pairwise(edges)]
        self.parts = [rows for rows in parts if np.count_nonzero(self.good[rows]) > COMPARE.fewest_samples]
        self.omega = 2.0 * math.pi / self.one.period_s
        self.ramped = ramped
        self.ranges = (
            [*COMPARE.ranges[:2], (COMPARE.ranges[2][0], COMPARE.longest_ramp)] if ramped else COMPARE.ranges
        )
        self.delays = [
            late * self.one.period_s for late in (0.0, *(COMPARE.ramps if ramped else COMPARE.delays))
        ]
        self.unit = 1.0 / float(np.max(np.abs(self.one.u)))
        self.hidden = hidden
        self._oscillations: dict[tuple[float, ...], float] = {}
        self.lines = [self._line(rows) for rows in self.parts]
        self.seen = self._abouts(self.one.y[self.rows])

    def plants(self, quicker: float, zeta: float, shares: Values) -> list[GridPlant]:
        """A plant without and with each delay, brought to size; none where no plant has these sizes."""
        try:
            plain, answer = self._plain(quicker, zeta, shares)
        except ValueError:
            return []
        moved = np.stack([self._late(answer, delay) for delay in self.delays])
        return self._compared(moved, plain, self.delays)

    def _plain(
        self, quicker: float, zeta: float, shares: Values, rest: float = COMPARE.rest_in_gap
    ) -> tuple[GridPlant, Array]:
        """A plant before it is brought to the recording's size, and its answer."""
        omega_n = quicker * self.omega
        half = self._half(omega_n, zeta)
        sizes = self._sizes(omega_n, zeta, half, shares)
        plain = GridPlant(math.inf, self.unit, omega_n, zeta, 0.0, half, sizes, shares)
        return plain, self._answer(omega_n, zeta, sizes, rest)

    def settled(self, plant: GridPlant) -> GridPlant:
        """The best near a plant, by the steps of Levenberg and Marquardt."""
        late = [plant.delay / self.one.period_s] if plant.delay > 0.0 else []
        numbers = [plant.omega_n / self.omega, plant.zeta, *late]
        has_gap = not GAPS.isdisjoint(plant.shares)
        others = [*plant.shares.values(), *([COMPARE.rest_in_gap] if has_gap else [])]
        low, high = np.array([*np.log(self.ranges[: len(numbers)]), *[COMPARE.share_range] * len(others)]).T
        first = logit((np.array([*np.log(numbers), *others]) - low) / (high - low))
        best = plant._replace(cost=math.inf)

        def left(at: Array) -> list[Array]:
            nonlocal best
            there = low + (high - low) * expit(first + at - 1.0)
            quicker, zeta, *periods = np.exp(there[: len(numbers)]).tolist()
            shared: list[float] = there[len(numbers) :].tolist()
            rest = shared.pop() if has_gap else COMPARE.rest_in_gap
            shares = dict(zip(plant.shares, shared, strict=True))
            try:
                found, remains = self._tried(quicker, zeta, shares, self.one.period_s * sum(periods), rest)
            except ValueError:  # a size that no plant may have
                return [COMPARE.not_simulated * seen for seen in self.seen]
            best = min(best, found, key=lambda one: one.cost)
            return (
                remains if math.isfinite(found.cost) else [COMPARE.not_simulated * seen for seen in self.seen]
            )

        def weighted(at: Array) -> Array:
            return np.concatenate([w * one for w, one in zip(weights, left(at), strict=True)])

        # MINPACK's differences are relative, so it is given what begins at one.
        at, strides = np.ones(len(first)), np.full(len(first), COMPARE.derivative_step)
        weights = [1.0 / max(float(np.linalg.norm(one)), 1e-300) for one in left(at)]
        least_squares(
            weighted,
            at,
            method="lm",
            diff_step=strides,
            ftol=COMPARE.least_gain,
            max_nfev=COMPARE.most_simulations,
        )
        return best

    def _tried(
        self, quicker: float, zeta: float, shares: Values, delay: float, rest: float
    ) -> tuple[GridPlant, list[Array]]:
        """A plant with a delay [s] that began at a place in its gap, and what it leaves of the parts."""
        plain, answer = self._plain(quicker, zeta, shares, rest)
        late = self._late(answer, delay)
        (plant,) = self._compared(late[None], plain, [delay])
        gain = plant.K_L / self.unit
        left = [seen - gain * own for seen, own in zip(self.seen, self._abouts(late), strict=True)]
        return plant, left

    def shaken(self, plain: GridPlant) -> GridPlant:
        """The plant with the disturbance that makes up for what it leaves at the hidden frequency."""
        assert self.hidden is not None  # noqa: S101 - without it there is none
        whole = {
            f"{SHAKES}.cosine": min(plain.omega_n * self.omega, COMPARE.strongest_disturbance),
            f"{SHAKES}.sine": 0.0,
        }
        whole[f"{SHAKES}.omega"] = self.hidden
        still = self._answer(plain.omega_n, plain.zeta, {})
        moved = self._at_hidden(self._answer(plain.omega_n, plain.zeta, whole) - still)
        late = np.interp(self.t - plain.delay, self.t, still)
        share = self._at_hidden(self.one.y[self.rows] - plain.K_L / self.unit * late) / moved
        sizes = {
            f"{SHAKES}.cosine": share.real * whole[f"{SHAKES}.cosine"],
            f"{SHAKES}.sine": -share.imag * whole[f"{SHAKES}.cosine"],
        }
        return plain._replace(sizes=whole | sizes)

    def _at_hidden(self, y: Array) -> complex:
        """What of `y` has the hidden frequency: its real part times exp(j omega t) is that."""
        found = complex(0.0)
        for rows in self.parts:
            *_, cosine, sine = np.linalg.lstsq(self._columns(rows), y[rows][self.good[rows]])[0]
            found += complex(cosine, -sine) / len(self.parts)
        return found

    def _answer(
        self,
        omega_n: float,
        zeta: float,
        sizes: Values,
        rest: float = COMPARE.rest_in_gap,
        *,
        moves: bool = False,
    ) -> Array:
        """Of a plant from rest at a place in its gap, shape (n,): its position, or what the sensor has."""
        start = np.zeros((1, STATES))
        start[0, LOOSE] = rest * sum(size for place, size in sizes.items() if place in GAPS)
        record = parameters(
            self.unit,
            omega_n,
            zeta,
            grouped(sizes),
            accuracy=tolerance(omega_n, zeta, self.tick),
            measures_speed=float(self.one.sees_speed and not moves),
        )
        return simulate(record, self.cut, start)

    def _half(self, omega_n: float, zeta: float) -> float:
        """Amplitude of the limit cycle without friction or backlash, before it is brought to size."""
        omega, square = self.omega, omega_n * omega_n
        gain = square / omega / math.hypot(square - omega * omega, 2.0 * zeta * omega_n * omega)
        return 4.0 / math.pi * gain

    def _sizes(self, omega_n: float, zeta: float, half: float, shares: Values) -> Values:
        """Of shares of the limit cycle of Eq. 1, cause by cause in the order of the signal's way."""
        sizes: Values = {}
        cycle = Cycle(
            self.omega, half, omega_n / (2.0 * zeta), lambda known: self._peak_to_peak(omega_n, zeta, known)
        )
        for name in sorted({place.split(".")[0] for place in shares}, key=list(CAUSES).index):
            sizes |= sized_by_shares(name, shares, sizes, cycle)
        return sizes

    def _peak_to_peak(self, omega_n: float, zeta: float, sizes: Values) -> float:
        """From end to end of the load, with these sizes."""
        at = (omega_n, zeta, *sizes.values())
        if at not in self._oscillations:
            moved = self._answer(omega_n, zeta, sizes, moves=True)
            self._oscillations[at] = float(np.median([np.ptp(own) for own in self._abouts(moved)]))
        return self._oscillations[at]

    def _compared(self, moved: Array, plain: GridPlant, delays: Sequence[float]) -> list[GridPlant]:
        """The plant with each delay, its answer `moved` by it: what is left at the gain that fits best."""
        pairs = list(zip(self.seen, self._abouts(moved), strict=True))
        size = sum(np.sum(b * b, axis=1) for _, b in pairs)
        gains = sum(b @ a for a, b in pairs) / np.maximum(size, 1e-300)
        left = np.stack([np.mean((a - gains[:, None] * b) ** 2, axis=1) for a, b in pairs])
        costs = np.mean(np.log(np.maximum(left, 1e-300)), axis=0)
        costs = np.where(np.isfinite(costs) & (gains != 0.0), costs, math.inf)
        return [self._sized(plain, *at) for at in zip(costs.tolist(), gains.tolist(), delays, strict=True)]

    def _late(self, answer: Array, delay: float) -> Array:
        """An answer with a delay [s]; of ramps the mean over their time."""
        if delay == 0.0:
            return answer
        if not self.ramped:
            return np.interp(self.t - delay, self.t, answer)
        area = cumulative_trapezoid(answer, self.t, initial=0)
        return np.asarray((area - np.interp(self.t - delay, self.t, area)) / delay)

    def _sized(self, plain: GridPlant, cost: float, gain: float, delay: float) -> GridPlant:
        size, K_L = abs(gain), gain * plain.K_L
        sizes = {of: size * value if grows_with_movement(of) else value for of, value in plain.sizes.items()}
        return plain._replace(cost=cost, K_L=K_L, delay=delay, half=size * plain.half, sizes=sizes)

    def _line(self, rows: slice) -> Array:
        """Orthonormal columns of what is not compared: what an initial state may add, and what is hidden."""
        return np.asarray(np.linalg.qr(self._columns(rows))[0])

    def _columns(self, rows: slice) -> Array:
        """A place, of a position a slope, and of a hidden frequency cosine and sine; shape (n, 1 to 4)."""
        t = self.t[rows][self.good[rows]]
        columns = [np.ones(len(t))] if self.one.sees_speed else [np.ones(len(t)), t - t.mean()]
        if self.hidden is not None:
            columns += [np.cos(self.hidden * t), np.sin(self.hidden * t)]
        return np.stack(columns, axis=1)

    def _abouts(self, y: Array) -> list[Array]:
        """What each part has beside what an initial state may add; `y` of shape (..., n)."""
        owns = [y[..., rows][..., self.good[rows]] for rows in self.parts]
        return [own - (own @ line) @ line.T for own, line in zip(owns, self.lines, strict=True)]
