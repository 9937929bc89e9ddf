"""Effects that the samples themselves show: defects of a record, and how its sensor reads."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from seod.diagnose.fitting.held_out import nrmse
from seod.diagnose.result import FoundEffect, Gain

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.diagnose.fitting.held_out import HeldOut
    from seod.diagnose.record.defects import Defect, Defects
    from seod.diagnose.result import Array


def shown_by_samples(checked: Sequence[Defects]) -> list[Defect]:
    """Causes that samples themselves show, which an extended rig has too: the first of each."""
    every = [each for defects in checked for each in (defects.coarse, defects.held) if each is not None]
    return list({each.name: each for each in reversed(every)}.values())


def record_effects(checked: Sequence[Defects], held: HeldOut, fitted: HeldOut) -> list[FoundEffect]:
    """Defects of the recordings, named as effects; rows that are none were left out of all figures.

    `held` and `fitted` are the model's simulations of the windows held out, and of the others.
    """
    out: dict[str, FoundEffect] = {}
    same = Gain(held.nrmse, held.nrmse)
    for k, defects in enumerate(checked):
        one = held.cut.series[k]
        measured = np.where(one.good, one.y, np.nan)
        for each in defects.confirmed(one.t, measured, _by_row(k, held, fitted)):
            out.setdefault(each.name, FoundEffect(each.name, each.parameters, same, each.p_value))
        if defects.coarse is not None and defects.coarse.name not in out:
            out[defects.coarse.name] = _rounded(defects.coarse, defects.step, held)
    return list(out.values())


def _by_row(file: int, *parts: HeldOut) -> Array:
    """Simulated readings of a recording, NaN in rows of no window; shape (n,)."""
    out = np.full(len(parts[0].cut.series[file].t), np.nan)
    for one in parts:
        for (k, first, last), inside in zip(one.cut.windows, one.cut.slices, strict=True):
            if k == file:
                out[first:last] = one.simulated[inside]
    return out


def _rounded(coarse: Defect, step: float, held: HeldOut) -> FoundEffect:
    """A sensor's step: its gain is that of rounding what was simulated."""
    y = held.cut.y
    rounded = step * np.floor(held.simulated / step + 0.5)
    with_it = nrmse([(y[p], rounded[p], held.scored[p]) for p in held.cut.slices])
    return FoundEffect(coarse.name, coarse.parameters, Gain(held.nrmse, with_it), coarse.p_value)
