"""The second phase of the relay: how late its switches come, chosen from what is known of the plant.

The later, the lower the frequency of the second phase, and the better gain, damping and delay are told apart;
but the farther the axis swings. That is computed beforehand, on the plant that the first phase showed.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from seod.estimate.known import Known
from seod.estimate.noise import WHITE
from seod.estimate.plant.response import StepwiseVoltage
from seod.estimate.two_phase.relay_run import Drive, Run, run
from seod.estimate.wave.search import Search
from seod.estimate.wave.window import Window

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.estimate.plant.free_motion import Dynamics

SHIFTS: Final = (0.03, 0.045, 0.06, 0.08, 0.1, 0.125, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4)
"""Latenesses that are looked at, in periods of the first phase."""
SD: Final = 2.0
"""So many standard deviations off the plant may be, for the limits."""
MARGIN: Final = 0.8
"""Part of each limit that the second phase may be expected to reach."""
HEADROOM: Final = 1.25
"""Of the swing expected; beyond it the loop goes back to the first phase. MARGIN * HEADROOM is 1."""


class Seen(NamedTuple):
    """The first estimate.

    Attributes:
        plant: omega_n, zeta and delay.
        zeta_sd: Its standard deviation.
        gain: K_L [axis unit/s/V].
        swing: Half the peak-to-peak movement of the first phase, as measured [axis unit]; 0: not known.
    """

    plant: Dynamics
    zeta_sd: float
    gain: float
    swing: float = 0.0


class Reach(NamedTuple):
    """How far an axis goes, or may go; inf for no limit.

    Attributes:
        swing: Half the peak-to-peak movement [axis unit].
        excursion: Largest distance from the set point [axis unit].
        speed: Largest, either way [axis unit/s].
        growth: Swing with the second phase, as a multiple of that of the first alone.
    """

    swing: float
    excursion: float
    speed: float
    growth: float


class Choice(NamedTuple):
    """A second phase.

    Attributes:
        shift: Lateness in periods of the first phase.
        late: The same [s].
        period: Of the first phase [s].
        reach: What is expected of it at worst.
        bound: Cramer and Rao's on the relative standard deviation of K_L from one alternation, in parts of
            the noise's standard deviation over the first phase's swing.
    """

    shift: float
    late: float
    period: float
    reach: Reach
    bound: float


def choose(seen: Seen, drive: Drive, limits: Reach, cycles: int, longest: float) -> Choice | str:
    """The latest second phase within `MARGIN` of the limits: it tells K_L best; or why there is none.

    Args:
        seen: The first estimate.
        drive: The relay.
        limits: Of the axis.
        cycles: Of each phase.
        longest: Largest lateness, in periods of the first phase.
    """
    plants = _plants(seen)
    first = [run(*plant, drive, 0.0, cycles) for plant in plants]
    alone = [each for each in first if each is not None]
    if len(alone) < len(plants):
        return "the plant that was found does not oscillate under this relay"
    why = ""
    for shift in (longest, *[s for s in reversed(SHIFTS) if s < longest]):
        late = shift * alone[0].period
        both = [each for plant in plants if (each := run(*plant, drive, late, cycles)) is not None]
        if len(both) < len(plants):
            why = "it would not oscillate any more"
            continue
        reach = _farthest(alone, both, seen.swing)
        why = _beyond(reach, limits)
        if not why:
            bound = _bound(both[0], seen, drive) * alone[0].swing
            return Choice(shift, late, alone[0].period, reach, bound)
    return why


def _plants(seen: Seen) -> list[tuple[Dynamics, float]]:
    """The plant found, and those as far off as it may be: zeta with K_L, for their ratio is known better."""
    plants = []
    for step in (0.0, SD, -SD):
        zeta = max(seen.plant.zeta + step * seen.zeta_sd, 0.2 * seen.plant.zeta)
        plants.append((seen.plant._replace(zeta=zeta), seen.gain * zeta / seen.plant.zeta))
    return plants


def _farthest(alone: Sequence[Run], both: Sequence[Run], swing: float) -> Reach:
    """The farthest that any plant goes with both phases; farther where `swing` was more than that of one."""
    reaches = []
    for one, two in zip(alone, both, strict=True):
        larger = max(1.0, swing / one.swing)  # what the model does not know
        sizes = (two.swing, float(np.max(np.abs(two.y))), float(np.max(np.abs(two.v))))
        reaches.append([*(larger * size for size in sizes), two.swing / one.swing])
    return Reach(*[max(values) for values in zip(*reaches, strict=True)])


def _beyond(reach: Reach, limits: Reach) -> str:
    """What would come too near to its limit; empty for nothing."""
    for name, value, limit in zip(Reach._fields, reach, limits, strict=True):
        if value > MARGIN * limit:
            part = f"{MARGIN:.0%} of the limit {limit:.4g}"
            return f"the {name} would be {value:.4g}, over {part}"
    return ""


def _bound(motion: Run, seen: Seen, drive: Drive) -> float:
    """Cramer and Rao's bound on the relative deviation of K_L, for noise of one axis unit in each tick."""
    t, u = motion.step * np.arange(len(motion.y), dtype=np.float64), motion.u
    known = Known(seen.gain, math.inf), Known(seen.plant.delay, math.inf)
    known_from = t >= seen.plant.delay
    t_y, y = t[known_from], motion.y[known_from]
    window = Window(t_y, y, StepwiseVoltage(t, u, t_y), *known)
    theta = np.array([math.log(seen.plant.omega_n), math.log(seen.plant.zeta), seen.plant.delay])
    search = Search(window, WHITE, 1.0)
    gram = search.at(theta).gram
    scale = 1.0 / np.sqrt(gram.diagonal())
    place = len(search.searched)
    variance = np.linalg.inv(gram * np.outer(scale, scale))[place, place] * scale[place] ** 2
    return math.sqrt(max(variance, 0.0) * drive.tick / motion.step) / seen.gain
