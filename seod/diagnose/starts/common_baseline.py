"""Eq. 1 with what every user would give it: a constant offset of u, or of a speed y, and a delay."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from seod.diagnose.causes.base import BASE
from seod.diagnose.causes.table import CAUSES, LATE, LATE_PLACE, OFFSET, OFFSET_PLACE
from seod.diagnose.fitting.held_out import simulate_held_out
from seod.diagnose.fitting.initial_states import measured_places, simulated_states
from seod.diagnose.fitting.least_squares import fit
from seod.diagnose.fitting.linear_gain import linear_gain
from seod.diagnose.record.windows import Cut, fitted_windows
from seod.diagnose.result import Common
from seod.diagnose.starts.sizes import scales

if TYPE_CHECKING:
    from seod.diagnose.causes.scales import Values
    from seod.diagnose.fitting.least_squares import Fitted
    from seod.diagnose.fitting.model import Model
    from seod.diagnose.fitting.work import ParallelMap
    from seod.diagnose.record.closed_form import ClosedForm
    from seod.diagnose.starts.baseline import Fixed


def common_baseline(
    base: Fitted, to_fit: Cut, held_out: Cut, closed: ClosedForm, fixed: Fixed, parallel: ParallelMap
) -> Common:
    """Begun from Eq. 1 as it was fitted, and from its closed form; the better one is told."""
    sizes = replace(scales(base, base.cut), given=fixed.given)
    model, small = replace(base.model, scales=sizes), fitted_windows(to_fit)
    begins = [base.model.values(base.x), *([dict(closed.values)] if closed.values else [])]
    tried = [_with_common(model, begin, small, fixed.gain, parallel) for begin in begins]
    found = min(tried, key=lambda one: one.cost)
    values = found.model.values(found.x)
    delay = values.get(LATE_PLACE, fixed.effects.get(LATE, {}).get(CAUSES[LATE].pure_delay, 0.0))
    K_L, omega_n, zeta = (values[name] for name in BASE)
    volts = -2.0 * zeta * values[OFFSET_PLACE] / (omega_n * K_L)
    held = simulate_held_out(found.model, found.x, held_out)
    return Common(K_L, omega_n, zeta, volts, delay, held.nrmse)


def _with_common(
    model: Model, begin: Values, small: Cut, gain: float | None, parallel: ParallelMap
) -> Fitted:
    """Eq. 1 with offset and delay, from this plant."""
    model = model.turned(begin["K_L"])
    values = {of: begin[of] for of in BASE} | {LATE_PLACE: begin.get("delay", 0.0)}
    model = model if LATE in model.scales.given else model.with_effect(LATE)
    found = linear_gain(model, small, model.searched(values), measured_places(small), gain)
    if found.K_L * values["K_L"] > 0.0:
        values["K_L"] = found.K_L
    model = model.with_effect(OFFSET)
    x = model.searched(values | {OFFSET_PLACE: found.loads[OFFSET_PLACE]})
    return fit(model, small, x, simulated_states(model, x, small), parallel=parallel)
