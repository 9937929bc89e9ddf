"""The model beside the rig: how often it cries wolf, how soon it sees a rig that left it, what it costs.

    python bench/model_monitor.py [--minutes 10] [--changes 20]

Rows of a relay on a simulated rig go through what the gateway has: segments, model, statistic, verdict.
Beside each figure stands what theory says: of noise alone the statistic has mean -p / sqrt(2 n) with p free
numbers and n samples, and deviation 1 if the noise's were known; a change is told at the end of the third
segment that shows it, and the one in which it happens may or may not: two to four segments after it. Costs
are processor time per segment over its length, for four axes.
"""

from __future__ import annotations

import argparse
import math
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from seod.config.load import load_rig
from seod.files.shipped import configs_dir
from seod.model_monitor.judge import IN_A_ROW, SIGNIFICANT, Verdict, judge
from seod.model_monitor.kernel import KernelModel
from seod.model_monitor.linear import LinearModel
from seod.observe.segments import Segments
from seod.processes.ring import FLAG_EXCITING, FLAG_FRESH
from sim.config import PlantConfig
from sim.parameters import parameters
from sim.runs import RELAY, sampled_relay
from sim.state import new_state

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from numpy.typing import NDArray

    from seod.model_monitor.judge import ModelError
    from seod.model_monitor.window import Model, Segment

    Array = NDArray[np.float64]

RATE = 2000.0
PIECE = 40_000
ENTRY_S = 2.0
"""In which a relay begins to swing."""
NONE = np.empty(0)
NAN = math.nan
Effects = dict[str, dict[str, float]]


@dataclass
class Rig:
    """A plant under a relay.

    Attributes:
        name: Of the line.
        base: K_L, omega_n, zeta.
        effects: That it has, and its model.
        noise: Standard deviation.
        speed: Whether a speed is measured.
    """

    name: str
    base: tuple[float, float, float]
    effects: Effects = field(default_factory=dict)
    noise: float = 1e-3
    speed: bool = False

    def model(self) -> Model:
        """What runs beside it."""
        if self.effects:
            plant = load_rig(configs_dir() / "virtual.yaml").simulation.plants["motor"]
            K_L, omega_n, zeta = self.base
            own = {"K_L": K_L, "omega_n": omega_n, "zeta": zeta, "effects": self.effects}
            return KernelModel(PlantConfig.model_validate(plant.model_dump() | own))
        return LinearModel(*self.base, speed=self.speed)

    @property
    def free(self) -> int:
        """Numbers that the model fits to each segment."""
        return 4 if self.effects else 3 if self.speed else 4


RIGS = [
    Rig("linear, position", (17.0, 117.0, 0.21)),
    Rig("linear, noise of 10 %", (17.0, 117.0, 0.21), noise=0.016),
    Rig("linear, damped", (17.0, 60.0, 0.8), noise=2e-3),
    Rig("linear, speed", (17.4, 60.0, 0.8), noise=0.2, speed=True),
    Rig("friction (kernel)", (17.0, 117.0, 0.21), {"coulomb_friction": {"level": 300.0}}),
]
CHANGES: dict[str, tuple[tuple[float, float, float], Effects]] = {
    "coulomb_friction 300": ((1.0, 1.0, 1.0), {"coulomb_friction": {"level": 300.0}}),
    "transport_delay 2 ms": ((1.0, 1.0, 1.0), {"transport_delay": {"time": 2e-3}}),
    "valve_deadband 0.1 V": ((1.0, 1.0, 1.0), {"valve_deadband": {"half_width": 0.1}}),
    "backlash 0.05 rad": ((1.0, 1.0, 1.0), {"backlash": {"gap": 0.05}}),
    "K_L - 15 %": ((0.85, 1.0, 1.0), {}),
    "omega_n - 5 %": ((1.0, 0.95, 1.0), {}),
    "zeta + 40 %": ((1.0, 1.0, 1.4), {}),
    "zeta + 2 %": ((1.0, 1.0, 1.02), {}),
}
"""Factors of K_L, omega_n and zeta, and effects, that the first rig gets on the way."""


class Run:
    """A rig under its relay, piece by piece."""

    def __init__(self, rig: Rig, seed: int) -> None:
        self.rig, self.random, self.tick = rig, np.random.default_rng(seed), 0
        self._become(rig.base, rig.effects)
        self.state = new_state(self.record, 0.0)
        self.relay = np.zeros(1, RELAY)
        swing = 0.5 * rig.base[0] / (2.0 * rig.base[2] * rig.base[1])
        self.relay["e_a"], self.relay["hysteresis"] = 0.5, max(0.02 * swing, 4.0 * rig.noise)
        self.relay["velocity_mode"] = float(rig.speed)

    def _become(self, base: tuple[float, float, float], effects: Effects) -> None:
        self.record = parameters(*base, effects, measures_speed=float(self.rig.speed))

    def change(self, factors: tuple[float, float, float], effects: Effects) -> None:
        """Another plant from now on."""
        K_L, omega_n, zeta = (a * b for a, b in zip(self.rig.base, factors, strict=True))
        self._become((K_L, omega_n, zeta), effects)

    def rows(self, seconds: float) -> Iterator[list[tuple]]:
        """The next rows, as the ring has them, in pieces; computed at once, for a call loses a command."""
        n = round(seconds * RATE)
        t = (self.tick + np.arange(n)) / RATE
        self.tick += n
        y, u, t_u = np.empty((3, n))
        noise = self.random.normal(0.0, self.rig.noise, n)
        sampled_relay(self.record[0], self.state[0], self.relay[0], t, noise, NONE, NONE, NONE, y, u, t_u)
        flags = FLAG_EXCITING | FLAG_FRESH
        for k in range(0, n, PIECE):
            table = zip(*(x[k : k + PIECE].tolist() for x in (t, y, u)), strict=True)
            yield [(a, b, 0.0, c, a, 0.5, 0.0, 0.0, NAN, NAN, 17.0, 2, flags) for a, b, c in table]


def segments(run: Run, cut: Segments, seconds: float) -> Iterator[Segment]:
    """Those of the next rows."""
    for rows in run.rows(seconds):
        yield from cut.add(rows)


def errors(some: Iterable[Segment], model: Model) -> Iterator[ModelError]:
    """What the gateway would stream."""
    for segment in some:
        error = judge(segment, model.residual(segment), 0.0, model.name)
        if error is not None:
            yield error


def false_alarms(rig: Rig, minutes: float) -> None:
    """One line: the statistic of a rig that keeps to its model."""
    run, cut, model, verdict = Run(rig, 1), Segments(rig.base[1], None), rig.model(), Verdict()
    found, events, used, n = [], 0, 0.0, 0
    for number, segment in enumerate(segments(run, cut, 60.0 * minutes)):
        if number * cut.span < ENTRY_S:
            continue
        n, begun = len(segment.t), time.process_time()
        for error in errors([segment], model):
            found.append(error.statistic)
            events += verdict.add(error)
        used += time.process_time() - begun
    statistic = np.array(found)
    beyond = np.count_nonzero(statistic > SIGNIFICANT)
    told = f"{statistic.mean():+.2f} ({-rig.free / math.sqrt(2 * n):+.2f}), {statistic.std():.2f} (1)"
    cost = 4.0 * 100.0 * used / (len(statistic) * cut.span)
    cpu = 1e3 * used / len(statistic)
    print(
        f"{rig.name:22} {len(statistic):9d} {told:>26} {statistic.max():8.1f} {beyond:9d} {events:7d} "
        f"{cpu:9.1f} {cost:9.1f} %",
        flush=True,
    )


def delays(name: str, changes: int) -> None:
    """One line: how long after a change the event comes."""
    rig, after, sizes = RIGS[0], [], []
    factors, effects = CHANGES[name]
    span = Segments(rig.base[1], None).span
    for seed in range(changes):
        run, cut, model, verdict = Run(rig, seed), Segments(rig.base[1], None), rig.model(), Verdict()
        before = ENTRY_S + span * seed / changes
        assert not any(verdict.add(each) for each in errors(segments(run, cut, before), model))
        run.change(factors, effects)
        for error in errors(segments(run, cut, 20.0), model):
            sizes.append(error.nrmse)
            if verdict.add(error):
                after.append(error.t - before)
                break
    seen = np.array(after) / span
    told = f"{seen.min():.1f} to {seen.max():.1f}" if len(seen) else "-"
    mean = f"{np.mean(after):.2f} s" if after else "-"
    size = f"{100.0 * float(np.median(sizes)):.1f} %"
    theory = f"({IN_A_ROW - 1} to {IN_A_ROW + 1})"
    print(f"{name:22} {len(after):4d} of {changes:2d} {size:>10} {mean:>9} {told:>14}  {theory}", flush=True)


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--changes", type=int, default=20)
    options = parser.parse_args()
    head = ("segments", "mean, deviation (theory)", "largest", f"beyond {SIGNIFICANT:.0f}", "events")
    print(f"{options.minutes:g} simulated minutes that keep to the model")
    print(
        f"{'':22} {head[0]:>9} {head[1]:>26} {head[2]:>8} {head[3]:>9} {head[4]:>7} {'ms':>9} {'4 axes':>11}"
    )
    for rig in RIGS:
        false_alarms(rig, options.minutes)
    print("\nchanges of the first rig")
    print(f"{'':22} {'seen':>10} {'error':>10} {'after':>9} {'segments':>14}  (theory)")
    for name in CHANGES:
        delays(name, options.changes)


if __name__ == "__main__":
    main()
