"""What acts on the load besides its pressure: measured, but with the extended model's plant and valve."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from seod.diagnose.show.residual import residual
from sim.effects import EFFECTS
from sim.parameters import parameters
from sim.runs import follow
from sim.state import new_state

if TYPE_CHECKING:
    from seod.diagnose.result import Array, Diagnosis, Effects, Window

_NOTHING = np.empty(0)


def acting(d: Diagnosis, window: Window) -> Array | None:
    """Force against the load by the measurement, band-limited, shape (n,); None where no cause acts on it.

    Unlike the baseline's residual it is that of the plant without these causes: they appear as what they
    are, not as what a fit that lacks them makes of them [unit/s^2].
    """
    rest = _without_load(d.extended.effects)
    if len(rest) == len(d.extended.effects):
        return None
    bare = _simulated(d, window, rest)
    return residual(window, bare, d.extended, d.output).force if np.isfinite(bare).all() else None


def _without_load(effects: Effects) -> Effects:
    return {name: values for name, values in effects.items() if EFFECTS[name].enters != "load"}


def _simulated(d: Diagnosis, window: Window, effects: Effects) -> Array:
    """Where the load would go if nothing else acted on it, from the window's first state."""
    model = d.extended
    rest = {name: values for name, values in effects.items() if EFFECTS[name].enters != "record"}
    p = parameters(model.K_L, model.omega_n, model.zeta, rest, measures_speed=float(d.output == "velocity"))
    s = new_state(p, float(window.t[0]), float(window.position[0]))
    s["pressure"], s["velocity"] = window.pressure[0], window.velocity[0]
    y = np.empty(len(window.t))
    supply = _NOTHING if window.ps is None else window.ps
    force = _NOTHING if window.f is None else window.f
    follow(p[0], s[0], window.t, window.u, window.t, _NOTHING, supply, _NOTHING, force, y)
    return y
