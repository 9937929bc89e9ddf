"""Where to begin with an effect: as its table has it, a wave at the lines of what is left."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from seod.diagnose.causes.table import CAUSES, SHAKES, bare, group, wave_of
from seod.diagnose.fitting.initial_states import simulated_states
from seod.diagnose.fitting.least_squares import Fitted, settle
from seod.diagnose.fitting.simulate import POSITION, inside
from seod.diagnose.starts.lines import lines, wave_starts
from seod.diagnose.starts.unsigned import unsigned_starts
from seod.diagnose.tuning.starts import EFFECT_STARTS

if TYPE_CHECKING:
    from seod.diagnose.causes.scales import Values
    from seod.diagnose.record.windows import Cut


def effect_starts(parent: Fitted, name: str, cut: Cut) -> tuple[Values, ...]:
    """Where to begin with an effect; with a wave at the lines of what the parent leaves."""
    searched = group(name, parent.model.scales)
    if CAUSES[name].unsigned:
        return unsigned_starts(parent.model, name, cut) if bare(parent.model.names) else ()
    if CAUSES[name].wave is None:
        return searched.starts
    size = EFFECT_STARTS.wave_size * searched.coordinates[0].scale
    begun = wave_starts(name, _residual_lines(parent, name, cut), size)
    return begun + _where_it_oscillates(parent, size, cut) if name == SHAKES else begun


def _where_it_oscillates(parent: Fitted, size: float, cut: Cut) -> tuple[Values, ...]:
    """A disturbance where the plant oscillates, which is then damped: the parent may have taken it for that.

    A second one at the largest line near it that this one leaves: where it oscillates may be a fit of both.
    """
    values = parent.model.values(parent.x)
    own = values["omega_n"]
    if values["zeta"] >= EFFECT_STARTS.little_damped:
        return ()
    damped = replace(parent, x=parent.model.searched(values | {"zeta": EFFECT_STARTS.little_damped}))
    near = [
        line
        for line in _residual_lines(damped, SHAKES, cut)
        if abs(math.log(line / own)) < EFFECT_STARTS.other_plant
    ]
    return tuple(
        one | {"zeta": EFFECT_STARTS.little_damped} for one in wave_starts(SHAKES, [own, *near[:1]], size)
    )


def _residual_lines(parent: Fitted, name: str, cut: Cut) -> list[float]:
    """What the residual of all windows shows of a wave."""
    model, x = parent.model, parent.x
    begun = simulated_states(model, x, cut)
    start = settle(model, cut, x, begun, cut.good, most=EFFECT_STARTS.settling_steps)
    simulated, states = inside(model.kernel_parameters(x), cut, start)
    y, position, speed = cut.y, states[:, POSITION], None
    residual = np.where(cut.good, y - simulated, 0.0)
    if model.sees_speed:  # as it was read: simulated ones have the parent's errors
        speed = np.where(cut.good, y, 0.0)
        position = np.concatenate([cut.series[k].travelled[a:b] for k, a, b in cut.windows])
    return lines(wave_of(name), cut, residual, position, speed)
