"""A stretch of a relay's recording from rest, and how near plants come to it."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING, Final

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.optimize import least_squares
from scipy.special import expit, logit

from seod.diagnose.cell import BENT, RUBS, SHAKEN, Cell, bristles
from seod.diagnose.model import grouped, tolerance
from seod.diagnose.simulate import LOOSE, STATES, simulate
from seod.diagnose.windows import Cut
from sim.effects import LEAST, STIFFEST
from sim.parameters import parameters

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.diagnose.answer import Array
    from seod.diagnose.coordinates import Values
    from seod.diagnose.windows import Series

BEFORE: Final = 12.0
PIECES: Final = 3
LONG: Final = 5.0
FEWEST: Final = 20
"""Limit cycles from rest until a plant is compared, pieces in which it is, and limit cycles and least samples
in each."""
REST: Final = 0.5
"""Place in its play where the load begins, from a flank, over the play."""
STEEPEST: Final = 1.001 / STIFFEST
"""Least speed at which friction has fallen, over its level."""
STALLED: Final = 1e-3
"""Least swing that a play is a share of, over half of that without effects."""
LATE: Final = (0.025, 0.05, 0.075, 0.1, 0.15)
RAMPS: Final = tuple(np.geomspace(0.06, 0.48, 16).tolist())
"""Delays, and how long a valve's ramps last, in periods of the limit cycle."""
CLOSE: Final = 1e-3
STRIDE: Final = 1e-3
MOST: Final = 160
"""Of the steps from a cell: the least share of the squares that they gain, the differences [1] of their
derivatives, and the most simulations. Each piece weighs as much as the others where they begin."""
WORSE: Final = 10.0
"""What is left by a plant that cannot be simulated, over the recording."""
RANGES: Final = ((0.1, 30.0), (0.01, 20.0), (1e-3, 0.3))
LONGEST: Final = 0.5
SHARED: Final = (0.01, 0.995)
"""Within which they go: omega_n over the limit cycle's frequency, zeta, delay over its period, or a ramp's
length, at most `LONGEST`, and shares."""
STRONG: Final = 1e5
"""Acceleration by which a plant is tried, at most [unit/s^2]."""
STEADY: Final = ("lugre_friction.stiffness", "lugre_friction.damping")
"""Of sizes: what a larger movement does not change."""


class Stretch:
    """A stretch of a recording, and what is compared of it: movements about a line in pieces of its end.

    With a frequency `hidden` [rad/s], what has it is not compared. With `grown` what comes before the pieces
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
        begin = max(0, first - round(BEFORE * cycle))
        end = min(last, first + round(PIECES * LONG * cycle))
        self.cut, self.rows = Cut([self.one], ((0, begin, end),)), slice(begin, end)
        self.t, self.good = self.one.t[self.rows], self.one.good[self.rows]
        edges = np.linspace(first - begin, end - begin, PIECES + 1).astype(int).tolist()
        if grown and begin == 0 and edges[0] > cycle:
            edges = [0, *edges]
        pieces = [slice(a, b) for a, b in pairwise(edges)]
        self.pieces = [rows for rows in pieces if np.count_nonzero(self.good[rows]) > FEWEST]
        self.omega = 2.0 * math.pi / self.one.period_s
        self.ramped = ramped
        self.ranges = [*RANGES[:2], (RANGES[2][0], LONGEST)] if ramped else RANGES
        self.delays = [late * self.one.period_s for late in (0.0, *(RAMPS if ramped else LATE))]
        self.unit = 1.0 / float(np.max(np.abs(self.one.u)))
        self.hidden = hidden
        self._swings: dict[tuple[float, ...], float] = {}
        self.lines = [self._line(rows) for rows in self.pieces]
        self.seen = self._abouts(self.one.y[self.rows])

    def cells(self, quicker: float, zeta: float, shares: Values) -> list[Cell]:
        """A plant without and with each delay, brought to size; none where no plant has these sizes."""
        try:
            plain, answer = self._plain(quicker, zeta, shares)
        except ValueError:
            return []
        return self._compared(answer, plain, self.delays)

    def _plain(self, quicker: float, zeta: float, shares: Values, rest: float = REST) -> tuple[Cell, Array]:
        """A plant before it is brought to the recording's size, and its answer."""
        omega_n = quicker * self.omega
        half = self._half(omega_n, zeta)
        sizes = self._sizes(omega_n, zeta, half, shares)
        plain = Cell(math.inf, self.unit, omega_n, zeta, 0.0, half, sizes, shares)
        return plain, self._answer(omega_n, zeta, sizes, rest)

    def settled(self, cell: Cell) -> Cell:
        """The best near a cell, by the steps of Levenberg and Marquardt."""
        late = [cell.delay / self.one.period_s] if cell.delay > 0.0 else []
        plant = [cell.omega_n / self.omega, cell.zeta, *late]
        plays = "backlash.gap" in cell.shares
        others = [*cell.shares.values(), *([REST] if plays else [])]
        low, high = np.array([*np.log(self.ranges[: len(plant)]), *[SHARED] * len(others)]).T
        first = logit((np.array([*np.log(plant), *others]) - low) / (high - low))
        best = cell._replace(cost=math.inf)

        def left(at: Array) -> list[Array]:
            nonlocal best
            there = low + (high - low) * expit(first + at - 1.0)
            quicker, zeta, *periods = np.exp(there[: len(plant)]).tolist()
            shared: list[float] = there[len(plant) :].tolist()
            rest = shared.pop() if plays else REST
            shares = dict(zip(cell.shares, shared, strict=True))
            try:
                found, remains = self._tried(quicker, zeta, shares, self.one.period_s * sum(periods), rest)
            except ValueError:  # a size that no plant may have
                return [WORSE * seen for seen in self.seen]
            best = min(best, found, key=lambda one: one.cost)
            return remains if math.isfinite(found.cost) else [WORSE * seen for seen in self.seen]

        def weighted(at: Array) -> Array:
            return np.concatenate([w * one for w, one in zip(weights, left(at), strict=True)])

        # MINPACK's differences are relative, so it is given what begins at one.
        at, strides = np.ones(len(first)), np.full(len(first), STRIDE)
        weights = [1.0 / max(float(np.linalg.norm(one)), 1e-300) for one in left(at)]
        least_squares(weighted, at, method="lm", diff_step=strides, ftol=CLOSE, max_nfev=MOST)
        return best

    def _tried(
        self, quicker: float, zeta: float, shares: Values, delay: float, rest: float
    ) -> tuple[Cell, list[Array]]:
        """A plant with a delay [s] that began at a place in its play, and what it leaves of the pieces."""
        plain, answer = self._plain(quicker, zeta, shares, rest)
        (cell,) = self._compared(answer, plain, [delay])
        late = self._late(answer, delay)
        gain = cell.K_L / self.unit
        left = [seen - gain * own for seen, own in zip(self.seen, self._abouts(late), strict=True)]
        return cell, left

    def shaken(self, plain: Cell) -> Cell:
        """The plant with the disturbance that makes up for what it leaves at the hidden frequency."""
        assert self.hidden is not None  # noqa: S101 - without it there is none
        whole = {f"{SHAKEN}.cosine": min(plain.omega_n * self.omega, STRONG), f"{SHAKEN}.sine": 0.0}
        whole[f"{SHAKEN}.omega"] = self.hidden
        still = self._answer(plain.omega_n, plain.zeta, {})
        moved = self._at_hidden(self._answer(plain.omega_n, plain.zeta, whole) - still)
        late = np.interp(self.t - plain.delay, self.t, still)
        share = self._at_hidden(self.one.y[self.rows] - plain.K_L / self.unit * late) / moved
        sizes = {
            f"{SHAKEN}.cosine": share.real * whole[f"{SHAKEN}.cosine"],
            f"{SHAKEN}.sine": -share.imag * whole[f"{SHAKEN}.cosine"],
        }
        return plain._replace(sizes=whole | sizes)

    def _at_hidden(self, y: Array) -> complex:
        """What of `y` has the hidden frequency: its real part times exp(j omega t) is that."""
        found = complex(0.0)
        for rows in self.pieces:
            *_, cosine, sine = np.linalg.lstsq(self._columns(rows), y[rows][self.good[rows]])[0]
            found += complex(cosine, -sine) / len(self.pieces)
        return found

    def _answer(
        self, omega_n: float, zeta: float, sizes: Values, rest: float = REST, *, moves: bool = False
    ) -> Array:
        """Of a plant from rest at a place in its play, shape (n,): its position, or what the sensor has."""
        start = np.zeros((1, STATES))
        start[0, LOOSE] = rest * sizes.get("backlash.gap", 0.0)
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
        """Half of the limit cycle's swing without friction or play, before it is brought to size."""
        omega, square = self.omega, omega_n * omega_n
        gain = square / omega / math.hypot(square - omega * omega, 2.0 * zeta * omega_n * omega)
        return 4.0 / math.pi * gain

    def _sizes(self, omega_n: float, zeta: float, half: float, shares: Values) -> Values:
        """Of shares of the pressure of the stalled load, and of the swing without play."""
        stalls = omega_n / (2.0 * zeta)
        sizes = {place: share * stalls for place, share in shares.items() if place.endswith(".level")}
        if "stribeck_friction.level" in shares:
            falls = shares["stribeck_friction.speed"] * self.omega * half
            sizes["stribeck_friction.speed"] = max(falls, STEEPEST * sizes["stribeck_friction.level"])
        if BENT in shares:
            sizes |= bristles(sizes[f"{RUBS}.level"], half, shares[BENT])
        if "backlash.gap" in shares:
            moves = max(self._swing(omega_n, zeta, sizes), STALLED * half)
            sizes["backlash.gap"] = max(shares["backlash.gap"] * moves, LEAST["backlash.gap"])
        return sizes

    def _swing(self, omega_n: float, zeta: float, sizes: Values) -> float:
        """From end to end of the load, without play."""
        at = (omega_n, zeta, *sizes.values())
        if at not in self._swings:
            moved = self._answer(omega_n, zeta, sizes, moves=True)
            self._swings[at] = float(np.median([np.ptp(own) for own in self._abouts(moved)]))
        return self._swings[at]

    def _compared(self, answer: Array, plain: Cell, delays: Sequence[float]) -> list[Cell]:
        """The plant with each delay: what is left of each piece at the gain that fits best."""
        moved = np.stack([self._late(answer, delay) for delay in delays])
        pairs = list(zip(self.seen, self._abouts(moved), strict=True))
        size = sum(np.sum(b * b, axis=1) for _, b in pairs)
        gains = sum(b @ a for a, b in pairs) / np.maximum(size, 1e-300)
        left = np.stack([np.mean((a - gains[:, None] * b) ** 2, axis=1) for a, b in pairs])
        costs = np.mean(np.log(np.maximum(left, 1e-300)), axis=0)
        costs = np.where(np.isfinite(costs) & (gains != 0.0), costs, math.inf)
        return [self._sized(plain, *at) for at in zip(costs.tolist(), gains.tolist(), delays, strict=True)]

    def _late(self, answer: Array, delay: float) -> Array:
        """An answer with a delay [s]; of ramps the mean over their time."""
        if not self.ramped:
            return np.interp(self.t - delay, self.t, answer)
        area = cumulative_trapezoid(answer, self.t, initial=0)
        return answer if delay == 0.0 else (area - np.interp(self.t - delay, self.t, area)) / delay

    def _sized(self, plain: Cell, cost: float, gain: float, delay: float) -> Cell:
        size, K_L = abs(gain), gain * plain.K_L
        sizes = {of: value if of in STEADY else size * value for of, value in plain.sizes.items()}
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
        """What each piece has beside what an initial state may add; `y` of shape (..., n)."""
        owns = [y[..., rows][..., self.good[rows]] for rows in self.pieces]
        return [own - (own @ line) @ line.T for own, line in zip(owns, self.lines, strict=True)]
