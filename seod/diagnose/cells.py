"""Plants with dry friction, play, or both, or shaken ones, that a relay's recording may come from, by a grid.

Under a relay Eq. 1 alone fits a limit cycle to some percent with a plant far from the right one, from which
no descent leads there. How a plant sticks, or what it loses in a play, depends, but for its size, on three
numbers only: omega_n, zeta, and a share: friction over the pressure at which the load would stall, play over
the swing. With both it is one share more. A delay moves the answer in time. So each cell costs one simulation
from rest, whatever the gain and the delay.

A relay may have locked to a disturbance of its own frequency, which hides the plant in the limit cycle's
fundamental: of those plants only what is beside the fundamental is compared.
"""

from __future__ import annotations

import math
from itertools import pairwise, product
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from seod.diagnose.command_period import relay_period_s
from seod.diagnose.model import grouped, tolerance
from seod.diagnose.simulate import STATES, simulate
from seod.diagnose.windows import Cut
from sim.parameters import parameters

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from seod.diagnose.answer import Array
    from seod.diagnose.coordinates import Values
    from seod.diagnose.windows import Series

BEFORE: Final = 12.0
PIECES: Final = 3
LONG: Final = 5.0
"""Limit cycles from rest until a plant is compared, pieces in which it is, and limit cycles in each."""
QUICKER: Final = tuple(np.geomspace(0.8, 5.0, 14).tolist())
"""omega_n over the limit cycle's frequency."""
QUICKER_SHAKEN: Final = tuple(np.geomspace(0.4, 5.0, 18).tolist())
"""omega_n over the limit cycle's frequency; of a plant that a disturbance shakes."""
DAMPINGS: Final = (0.05, 0.15, 0.3, 0.6, 1.2, 4.0)
SHARES: Final[tuple[Values, ...]] = (
    *({"coulomb_friction.level": share} for share in (0.2, 0.4, 0.6, 0.75, 0.85, 0.93)),
    *({"stribeck_friction.level": share} for share in (0.2, 0.4, 0.6, 0.75, 0.85, 0.93)),
    *({"backlash.gap": share} for share in (0.1, 0.25, 0.4, 0.55, 0.7, 0.82)),
    *(
        {"coulomb_friction.level": rubs, "backlash.gap": plays}
        for rubs, plays in product((0.3, 0.6, 0.85), (0.15, 0.35, 0.6))
    ),
)
"""Of friction and of play; what play is left of a swing that friction makes smaller."""
CONTACTS: Final = frozenset(place.split(".")[0] for shares in SHARES for place in shares)
"""Effects that the grid has."""
LATE: Final = (0.025, 0.05, 0.075, 0.1, 0.15)
"""Delays, in periods of the limit cycle."""
KEPT: Final = 4
KEPT_LATE: Final = 2
"""Cells that are kept, of different damping: without a delay, and with one."""
FALLEN: Final = 0.45
"""Speed at which friction has fallen, over the limit cycle's largest without it."""
DELAYS: Final = frozenset({"transport_delay", "valve_lag", "sensor_lag"})
"""Effects that may stand for its delay."""
GIVE: Final = 0.04
"""What bristles give way by, over half the swing."""
SHAKEN: Final = "periodic_disturbance"
BEGUN: Final = DELAYS | CONTACTS | {SHAKEN, "lugre_friction"}
"""Effects that may be tried from a cell; bristles give way so little that they begin as plain friction."""


class Cell(NamedTuple):
    """A plant: what it leaves of the recording, its parameters, a delay, and its effects' parameters.

    `half` is half of its swing without the effects.
    """

    cost: float
    K_L: float
    omega_n: float
    zeta: float
    delay: float
    half: float
    sizes: Values

    @property
    def causes(self) -> frozenset[str]:
        """Its effects."""
        return frozenset(place.split(".")[0] for place in self.sizes)

    def begins(self, names: Iterable[str]) -> bool:
        """Whether a set of these effects may begin here."""
        late, own = not DELAYS.isdisjoint(names), self.causes
        return (
            CONTACTS.intersection(names) == own - {SHAKEN}
            and late == (self.delay > 0.0)
            and (SHAKEN not in own or SHAKEN in names)
        )

    def values(self) -> Values:
        """As a start, with the times of all that may stand for the delay."""
        own = {"K_L": self.K_L, "omega_n": self.omega_n, "zeta": self.zeta}
        own |= self.sizes
        if self.causes == {"coulomb_friction"}:
            own |= bristles(self.sizes["coulomb_friction.level"], self.half)
        return own | {f"{name}.time": self.delay for name in DELAYS if self.delay > 0.0}


def bristles(level: float, half: float) -> Values:
    """That bear a friction, of a load that swings so far either way."""
    stiff = level / (GIVE * half)
    return {"lugre_friction.stiffness": stiff, "lugre_friction.damping": 0.5 * math.sqrt(stiff)}


def cells(cut: Cut) -> tuple[Cell, ...]:
    """Of a relay's recording: the best plants of each kind without a delay, and the best with one."""
    grid, found = _Grid(cut), list[Cell]()
    kinds: dict[frozenset[str], list[Cell]] = {}
    for at in product(QUICKER, DAMPINGS, SHARES):
        some = grid.cells(*at)
        kinds.setdefault(some[0].causes, []).extend(some)
    for own in kinds.values():
        found += _kept(own)
    return (*found, *_shaken(cut))


def _shaken(cut: Cut) -> list[Cell]:
    """Likewise plants with a disturbance of the limit cycle's frequency, where it has one."""
    one = cut.series[cut.windows[0][0]]
    period = relay_period_s(one.t_u, one.u)
    if period is None:
        return []
    grid = _Grid(cut, 2.0 * math.pi / period)
    every = [cell for at in product(QUICKER_SHAKEN, DAMPINGS) for cell in grid.cells(*at, {})]
    return [grid.shaken(cell) for cell in _kept(every) if math.isfinite(cell.cost)]


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

    With a frequency `hidden` [rad/s], what has it is not compared.
    """

    def __init__(self, cut: Cut, hidden: float | None = None) -> None:
        k, first, last = cut.windows[0]
        self.one: Series = cut.series[k]
        self.tick = self.one.tick
        cycle = self.one.period_s / self.tick
        begin = max(0, first - round(BEFORE * cycle))
        end = min(last, first + round(PIECES * LONG * cycle))
        edges = np.linspace(first - begin, end - begin, PIECES + 1).astype(int).tolist()
        self.pieces = [slice(a, b) for a, b in pairwise(edges)]
        self.cut, self.rows = Cut([self.one], ((0, begin, end),)), slice(begin, end)
        self.t, self.good = self.one.t[self.rows], self.one.good[self.rows]
        self.omega = 2.0 * math.pi / self.one.period_s
        self.delays = [late * self.one.period_s for late in (0.0, *LATE)]
        self.volts = float(np.max(np.abs(self.one.u)))
        self.hidden = hidden
        self.lines = [self._line(rows) for rows in self.pieces]
        self.seen = [self._about(self.one.y[self.rows], w) for w in range(PIECES)]

    def cells(self, quicker: float, zeta: float, shares: Values) -> list[Cell]:
        """A plant of K_L 1, without and with each delay, brought to the recording's size."""
        omega_n = quicker * self.omega
        half = self._half(omega_n, zeta)
        sizes = self._sizes(omega_n / (2.0 * zeta), half, shares)
        plain = Cell(math.inf, 1.0, omega_n, zeta, 0.0, half, sizes)
        return self._compared(self._answer(omega_n, zeta, sizes), plain)

    def shaken(self, plain: Cell) -> Cell:
        """The plant with the disturbance that makes up for what it leaves at the hidden frequency."""
        assert self.hidden is not None  # noqa: S101 - without it there is none
        whole = {f"{SHAKEN}.cosine": plain.omega_n * self.omega, f"{SHAKEN}.sine": 0.0}
        whole[f"{SHAKEN}.omega"] = self.hidden
        still = self._answer(plain.omega_n, plain.zeta, {})
        moved = self._at_hidden(self._answer(plain.omega_n, plain.zeta, whole) - still)
        late = np.interp(self.t - plain.delay, self.t, still)
        share = self._at_hidden(self.one.y[self.rows] - plain.K_L * late) / moved
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
            found += complex(cosine, -sine) / PIECES
        return found

    def _answer(self, omega_n: float, zeta: float, sizes: Values) -> Array:
        """Of a plant of K_L 1 from rest, shape (n,)."""
        record = parameters(
            1.0,
            omega_n,
            zeta,
            grouped(sizes),
            accuracy=tolerance(omega_n, zeta, self.tick),
            measures_speed=float(self.one.sees_speed),
        )
        return simulate(record, self.cut, np.zeros((1, STATES)))

    def _half(self, omega_n: float, zeta: float) -> float:
        """Half of the limit cycle's swing without friction or play."""
        omega, square = self.omega, omega_n * omega_n
        gain = square / omega / math.hypot(square - omega * omega, 2.0 * zeta * omega_n * omega)
        return 4.0 / math.pi * self.volts * gain

    def _sizes(self, stalls: float, half: float, shares: Values) -> Values:
        """Of shares of the pressure of the stalled load, per volt, and of the swing without play."""
        rubs = shares.get("coulomb_friction.level", 0.0)
        whole = {
            "backlash.gap": 2.0 * half * math.sqrt(1.0 - rubs * rubs),
            "coulomb_friction.level": stalls * self.volts,
            "stribeck_friction.level": stalls * self.volts,
        }
        sizes = {place: share * whole[place] for place, share in shares.items()}
        if "stribeck_friction.level" in shares:
            sizes["stribeck_friction.speed"] = FALLEN * self.omega * half
        return sizes

    def _compared(self, answer: Array, plain: Cell) -> list[Cell]:
        """The plant without and with each delay: what is left of each piece at the gain that fits best."""
        moved = np.stack([np.interp(self.t - delay, self.t, answer) for delay in self.delays])
        pairs = [(self.seen[w], self._about(moved, w)) for w in range(PIECES)]
        size = sum(np.sum(b * b, axis=1) for _, b in pairs)
        gains = sum(b @ a for a, b in pairs) / np.maximum(size, 1e-300)
        left = np.stack([np.mean((a - gains[:, None] * b) ** 2, axis=1) for a, b in pairs])
        costs = np.mean(np.log(np.maximum(left, 1e-300)), axis=0)
        costs = np.where(np.isfinite(costs) & (gains != 0.0), costs, math.inf)
        return [
            self._sized(plain, *at) for at in zip(costs.tolist(), gains.tolist(), self.delays, strict=True)
        ]

    def _sized(self, plain: Cell, cost: float, K_L: float, delay: float) -> Cell:
        size = abs(K_L)
        sizes = {of: size * value for of, value in plain.sizes.items()}
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

    def _about(self, y: Array, w: int) -> Array:
        """What a piece has beside what an initial state may add; `y` of shape (..., n)."""
        rows = self.pieces[w]
        own = y[..., rows][..., self.good[rows]]
        return np.asarray(own - (own @ self.lines[w]) @ self.lines[w].T)
