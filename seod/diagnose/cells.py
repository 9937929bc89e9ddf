"""Plants with dry friction, play, or both, or shaken ones, that a relay's recording may come from, by a grid.

Under a relay Eq. 1 alone fits a limit cycle to some percent with a plant far from the right one, from which
no descent leads there. How a plant sticks, or what it loses in a play, depends, but for its size, on three
numbers only: omega_n, zeta, and a share: friction over the pressure at which the load would stall, play over
the swing. With both it is one share more. A delay moves the answer in time. So each cell costs one simulation
from rest, whatever the gain and the delay. From the best cells least squares go on, at some fifty simulations
each: a play that takes most of the swing leaves valleys narrower than the grid.

A relay may have locked to a disturbance of its own frequency, which hides the plant in the limit cycle's
fundamental: of those plants only what is beside the fundamental is compared.
"""

from __future__ import annotations

import math
from itertools import pairwise, product
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from scipy.optimize import least_squares
from scipy.special import expit, logit

from seod.diagnose.command_period import relay_period_s
from seod.diagnose.model import grouped, tolerance
from seod.diagnose.simulate import LOOSE, STATES, simulate
from seod.diagnose.windows import Cut
from sim.effects import LEAST, STIFFEST
from sim.parameters import parameters

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from seod.diagnose.answer import Array
    from seod.diagnose.coordinates import Values
    from seod.diagnose.windows import Series

BEFORE: Final = 12.0
PIECES: Final = 3
LONG: Final = 5.0
FEWEST: Final = 20
"""Limit cycles from rest until a plant is compared, pieces in which it is, and limit cycles and least samples
in each."""
QUICKER: Final = (*np.geomspace(0.8, 5.0, 14).tolist(), 7.0, 10.0)
"""omega_n over the limit cycle's frequency."""
QUICKER_SHAKEN: Final = tuple(np.geomspace(0.4, 5.0, 18).tolist())
"""omega_n over the limit cycle's frequency; of a plant that a disturbance shakes."""
DAMPINGS: Final = (0.05, 0.15, 0.3, 0.6, 1.2, 4.0)
FALLEN: Final = 0.45
SHARES: Final[tuple[Values, ...]] = (
    *({"coulomb_friction.level": share} for share in (0.2, 0.4, 0.6, 0.75, 0.85, 0.93)),
    *(
        {"stribeck_friction.level": share, "stribeck_friction.speed": FALLEN}
        for share in (0.2, 0.4, 0.6, 0.75, 0.85, 0.93)
    ),
    *({"backlash.gap": share} for share in (0.1, 0.25, 0.4, 0.55, 0.7, 0.82, 0.92)),
    *(
        {"coulomb_friction.level": rubs, "backlash.gap": plays}
        for rubs, plays in product((0.3, 0.6, 0.85), (0.15, 0.35, 0.6, 0.9))
    ),
)
"""Of friction and of play; what play is left of a swing that friction makes smaller. The speed at which
friction has fallen is a share of the limit cycle's largest without it."""
CONTACTS: Final = frozenset(place.split(".")[0] for shares in SHARES for place in shares)
"""Effects that the grid has."""
REST: Final = 0.5
"""Place in its play where the load begins, from a flank, over the play."""
STEEPEST: Final = 1.001 / STIFFEST
"""Least speed at which friction has fallen, over its level."""
STALLED: Final = 1e-3
"""Least swing that a play is a share of, over half of that without effects."""
LATE: Final = (0.025, 0.05, 0.075, 0.1, 0.15)
"""Delays, in periods of the limit cycle."""
CLOSE: Final = 1e-3
STRIDE: Final = 1e-3
MOST: Final = 160
"""Of the steps from a cell: the least share of the squares that they gain, the differences [1] of their
derivatives, and the most simulations. Each piece weighs as much as the others where they begin."""
NEAR: Final = 3.0
"""Mean log error over the least, up to which a cell goes on with how the limit cycle grew."""
WORSE: Final = 10.0
"""What is left by a plant that cannot be simulated, over the recording."""
RANGES: Final = ((0.1, 30.0), (0.01, 20.0), (1e-3, 0.3))
SHARED: Final = (0.01, 0.995)
"""Within which they go: omega_n over the limit cycle's frequency, zeta, delay over its period, and shares."""
SLIGHT: Final = 0.05
"""Delay over the time of a radian of omega_n, up to which a plant may stand for one without."""
KEPT: Final = 4
KEPT_LATE: Final = 2
"""Cells that are kept, of different damping: without a delay, and with one."""
DELAYS: Final = frozenset({"transport_delay", "valve_lag", "sensor_lag"})
"""Effects that may stand for its delay."""
GIVE: Final = 0.04
STIFF: Final = 0.1
"""What bristles give way by, over half the swing; a share of it by which they begin to settle."""
BENT: Final = "lugre_friction.give"
RUBBED: Final = 2
"""Plants with plain friction that settle with bristles."""
RUBS: Final = "coulomb_friction"
SHAKEN: Final = "periodic_disturbance"
STEADY: Final = ("lugre_friction.stiffness", "lugre_friction.damping")
"""Of sizes: what a larger movement does not change."""
BEGUN: Final = DELAYS | CONTACTS | {SHAKEN, "lugre_friction"}
"""Effects that may be tried from a cell; bristles give way so little that they begin as plain friction."""


class Cell(NamedTuple):
    """A plant: what it leaves of the recording, its parameters, a delay, and its effects' parameters.

    `half` is half of its swing without the effects; `shares` are what `sizes` were in the grid.
    """

    cost: float
    K_L: float
    omega_n: float
    zeta: float
    delay: float
    half: float
    sizes: Values
    shares: Values

    @property
    def causes(self) -> frozenset[str]:
        """Its effects."""
        return frozenset(place.split(".")[0] for place in self.sizes)

    def begins(self, names: Iterable[str]) -> bool:
        """Whether a set of these effects may begin here."""
        late, own = not DELAYS.isdisjoint(names), self.causes
        return (
            CONTACTS.intersection(names) == own & CONTACTS
            and (late or self.delay * self.omega_n < SLIGHT)
            and (not late or self.delay > 0.0)
            and own - CONTACTS <= set(names)
        )

    def values(self) -> Values:
        """As a start, with the times of all that may stand for the delay."""
        own = {"K_L": self.K_L, "omega_n": self.omega_n, "zeta": self.zeta}
        own |= self.sizes
        if self.causes == {RUBS}:
            own |= bristles(self.sizes["coulomb_friction.level"], self.half)
        return own | {f"{name}.time": self.delay for name in DELAYS if self.delay > 0.0}

    def on_bristles(self) -> Cell:
        """Where to settle with bristles that bear its friction."""
        return self._replace(shares=self.shares | {BENT: STIFF})


def bristles(level: float, half: float, share: float = 1.0) -> Values:
    """That bear a friction, of a load that swings so far either way."""
    stiff = min(level / (share * GIVE * half), STIFFEST * level)
    return {"lugre_friction.stiffness": stiff, "lugre_friction.damping": 0.5 * math.sqrt(stiff)}


def cells(cut: Cut) -> tuple[Cell, ...]:
    """Of a relay's recording: the best plants of each kind without a delay, and the best with one."""
    grid, grown, found = _Grid(cut), _Grid(cut, grown=True), list[Cell]()
    if not grid.pieces:
        return ()
    kinds: dict[frozenset[str], list[Cell]] = {}
    for at in product(QUICKER, DAMPINGS, SHARES):
        some = grid.cells(*at)
        kinds.setdefault(some[0].causes, []).extend(some)
    for own in kinds.values():
        found += [grid.settled(cell) for cell in _kept(own)]
    rubbed = [cell for cell in found if cell.causes == {RUBS} and cell.delay == 0.0]
    rubbed.sort(key=lambda cell: cell.cost)
    found += [grid.settled(cell.on_bristles()) for cell in rubbed[:RUBBED]]
    near = min(cell.cost for cell in found) + NEAR
    found += [grown.settled(cell) for cell in found if cell.cost < near]
    return (*found, *_shaken(cut))


def _shaken(cut: Cut) -> list[Cell]:
    """Likewise plants with a disturbance of the limit cycle's frequency, where it has one."""
    one = cut.series[cut.windows[0][0]]
    period = relay_period_s(one.t_u, one.u)
    if period is None:
        return []
    grid = _Grid(cut, 2.0 * math.pi / period)
    every = [cell for at in product(QUICKER_SHAKEN, DAMPINGS) for cell in grid.cells(*at, {})]
    kept = [grid.settled(cell) for cell in _kept(every) if math.isfinite(cell.cost)]
    return [grid.shaken(cell) for cell in kept]


def _kept(some: Sequence[Cell]) -> list[Cell]:
    prompt = _best(cell for cell in some if cell.delay == 0.0)[:KEPT]
    return prompt + _best(cell for cell in some if cell.delay > 0.0)[:KEPT_LATE]


def _best(some: Iterable[Cell]) -> list[Cell]:
    best: dict[float, Cell] = {}
    for cell in sorted(some, key=lambda one: one.cost):
        best.setdefault(cell.zeta, cell)
    return list(best.values())


class _Grid:
    """A stretch of a recording, and what is compared of it: movements about a line in pieces of its end.

    With a frequency `hidden` [rad/s], what has it is not compared. With `grown` what comes before the pieces
    is compared as well, if the recording begins there: how a limit cycle grew tells the plants of a valley
    apart.
    Plants are simulated with a K_L `unit` of one over the command, whatever that is measured in.
    """

    def __init__(self, cut: Cut, hidden: float | None = None, *, grown: bool = False) -> None:
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
        self.delays = [late * self.one.period_s for late in (0.0, *LATE)]
        self.unit = 1.0 / float(np.max(np.abs(self.one.u)))
        self.hidden = hidden
        self._swings: dict[tuple[float, ...], float] = {}
        self.lines = [self._line(rows) for rows in self.pieces]
        self.seen = self._abouts(self.one.y[self.rows])

    def cells(self, quicker: float, zeta: float, shares: Values) -> list[Cell]:
        """A plant without and with each delay, brought to the recording's size."""
        plain, answer = self._plain(quicker, zeta, shares)
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
        others = [*cell.shares.values(), *([REST] if "backlash.gap" in cell.shares else [])]
        low, high = np.array([*np.log(RANGES[: len(plant)]), *[SHARED] * len(others)]).T
        first = logit((np.array([*np.log(plant), *others]) - low) / (high - low))
        best = cell._replace(cost=math.inf)

        def left(at: Array) -> list[Array]:
            nonlocal best
            there = low + (high - low) * expit(first + at - 1.0)
            quicker, zeta, *periods = np.exp(there[: len(plant)]).tolist()
            shares = dict(zip(cell.shares, there[len(plant) :].tolist(), strict=False))
            delay = self.one.period_s * sum(periods)
            try:
                found, remains = self._tried(quicker, zeta, shares, delay, there[-1])
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
        late = np.interp(self.t - delay, self.t, answer)
        gain = cell.K_L / self.unit
        left = [seen - gain * own for seen, own in zip(self.seen, self._abouts(late), strict=True)]
        return cell, left

    def shaken(self, plain: Cell) -> Cell:
        """The plant with the disturbance that makes up for what it leaves at the hidden frequency."""
        assert self.hidden is not None  # noqa: S101 - without it there is none
        whole = {f"{SHAKEN}.cosine": plain.omega_n * self.omega, f"{SHAKEN}.sine": 0.0}
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
        moved = np.stack([np.interp(self.t - delay, self.t, answer) for delay in delays])
        pairs = list(zip(self.seen, self._abouts(moved), strict=True))
        size = sum(np.sum(b * b, axis=1) for _, b in pairs)
        gains = sum(b @ a for a, b in pairs) / np.maximum(size, 1e-300)
        left = np.stack([np.mean((a - gains[:, None] * b) ** 2, axis=1) for a, b in pairs])
        costs = np.mean(np.log(np.maximum(left, 1e-300)), axis=0)
        costs = np.where(np.isfinite(costs) & (gains != 0.0), costs, math.inf)
        return [self._sized(plain, *at) for at in zip(costs.tolist(), gains.tolist(), delays, strict=True)]

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
