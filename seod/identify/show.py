"""The answer for people: a table."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from rich import box
from rich.table import Table

from seod.estimate.advice import INTERVAL
from seod.identify.problem import NAMES
from seod.terminal import console
from seod.terminal.text import number, with_sd

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from seod.identify.answer import Result
    from seod.identify.fit import Fit

_SHOWN = {"omega_n": (1.0, "rad/s"), "zeta": (1.0, ""), "delay": (1000.0, "ms")}
"""Factor and unit of each value; that of K_L depends on the record."""


def as_text(
    result: Result, names: Sequence[str], configured: Mapping[str, float], gain_unit: str = "unit/s/V"
) -> str:
    """Values with 95 % intervals, what the recordings cannot tell, and the controller's gains.

    Args:
        result: What was identified.
        names: Of the recordings.
        configured: What the rig file says, where there is one.
        gain_unit: Unit of K_L.
    """
    fit, files = result.fit, ", ".join(names)
    why = [f"  {result.message}"] if result.message else []
    if fit is None:
        return "\n".join([f"{files}: {result.quality}", *why])
    noise = ", ".join(number(each, 3) for each in fit.noise)
    head = f"{files}: {result.quality}, error {100 * fit.nrmse:.2f} % (residual {noise})"
    outliers = [f"{fit.rejected} samples left out as outliers"] if fit.rejected else []
    live = [", ".join(f"{count} answers {word}" for word, count in result.answers.items())]
    said = [f"! {sentence}" for sentence in result.cannot_tell]
    return "\n".join(
        [
            head,
            *why,
            _table(result, fit, configured, gain_unit),
            *outliers,
            *filter(None, live),
            *said,
            *_advice(result),
        ]
    )


def _table(result: Result, fit: Fit, configured: Mapping[str, float], gain_unit: str) -> str:
    table = Table(box=box.SIMPLE, pad_edge=False)
    for title in ("", "value", "95 % interval", "", *(["rig file"] if configured else [])):
        table.add_column(title, justify="right" if title else "left")
    for name in NAMES:
        factor, unit = (1.0, gain_unit) if name == "K_L" else _SHOWN[name]
        wide = INTERVAL * fit.sd[name] * factor
        told = with_sd(fit.value[name] * factor, wide if math.isfinite(wide) else None)
        value, _, interval = told.partition(" ± ")
        kind = "assumed" if name in result.assumed else "given" if wide == 0.0 else "not told"
        known = [number(configured[name] * factor)] if name in configured else []
        table.add_row(name, value, f"± {interval}" if interval else kind, unit, *known)
    return console.as_text(table, width=100).strip("\n")


def _advice(result: Result) -> list[str]:
    advice = result.advice
    if advice is None:
        return []
    return [
        f"position loop, at the intervals' worst corner: oscillates at a velocity gain of "
        f"{number(advice.velocity_gain_limit)} 1/s "
        f"(controller gain {number(advice.controller_gain_limit)} V/unit)",
        f"  with gain margin {number(advice.gain_margin)} and phase margin "
        f"{np.degrees(advice.phase_margin):.0f} deg: {number(advice.velocity_gain)} 1/s "
        f"({number(advice.controller_gain)} V/unit)",
    ]
