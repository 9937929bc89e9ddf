"""The contract's figures of a model, and the arrays that a report draws."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from seod.diagnose.causes.base import BASE
from seod.diagnose.fitting.simulate import POSITION
from seod.diagnose.result import Score, Whole, Window

if TYPE_CHECKING:
    from collections.abc import Mapping

    from seod.diagnose.fitting.held_out import HeldOut
    from seod.diagnose.fitting.model import Model
    from seod.diagnose.record.windows import Cut
    from seod.diagnose.result import Array, Diagnosis, Effects


def score(
    model: Model, x: Array, held: HeldOut, whole_nrmse: float, diverged: bool, sd: Mapping[str, float]
) -> Score:
    """The contract's figures of a model."""
    values = model.values(x)
    K_L, omega_n, zeta = (values[name] for name in BASE)
    effects: Effects = model.effects(x)
    return Score(K_L, omega_n, zeta, held.nrmse, whole_nrmse, diverged, effects, dict(sd))


def windows(baseline: HeldOut, extended: HeldOut, *, held_out: bool) -> list[Window]:
    """Both simulations of the same windows."""
    out = []
    y = np.where(baseline.cut.good, baseline.cut.y, np.nan)
    for (k, first, last), p in zip(baseline.cut.windows, baseline.cut.slices, strict=True):
        one = baseline.cut.series[k]
        pressure, velocity, position = extended.states[p, : POSITION + 1].T
        out.append(
            Window(
                file=k,
                rows=(first, last),
                t=one.t[first:last],
                u=one.u[first:last],
                y=y[p],
                ps=one.supply[first:last] if len(one.supply) else None,
                f=one.force[first:last] if len(one.force) else None,
                y_baseline=baseline.simulated[p],
                y_extended=extended.simulated[p],
                velocity=velocity,
                position=position,
                pressure=pressure,
                scored=extended.scored[p],
                held_out=held_out,
            )
        )
    return out


def scored_windows(diagnosis: Diagnosis) -> list[Window]:
    """The held-out windows; all, where there are none."""
    held_out = [window for window in diagnosis.windows if window.held_out]
    return held_out or list(diagnosis.windows)


def drawn(series: Cut, baseline: list[Array], extended: list[Array]) -> tuple[Whole, ...]:
    """Whole recordings with both simulations."""
    out = []
    for one, base, more in zip(series.series, baseline, extended, strict=True):
        out.append(Whole(one.t, np.where(one.good, one.y, np.nan), base, more))
    return tuple(out)
