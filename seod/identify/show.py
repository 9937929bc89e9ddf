"""The answer for people: a table and a plot."""

from __future__ import annotations

import io
import math
from typing import TYPE_CHECKING

import numpy as np
from rich import box
from rich.console import Console
from rich.table import Table

from seod.estimate.advice import INTERVAL
from seod.identify.problem import NAMES
from seod.identify.record import IdentifyError
from seod.text import number, with_sd

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from seod.identify.answer import Result
    from seod.identify.fit import Fit
    from seod.identify.record import Record

_SHOWN = {"omega_n": (1.0, "rad/s"), "zeta": (1.0, ""), "delay": (1000.0, "ms"), "K_L": (1.0, "unit/s/V")}
_DRAWN = 20_000
"""Most samples of a plot."""


def as_text(result: Result, names: Sequence[str], configured: Mapping[str, float]) -> str:
    """Values with 95 % intervals, what the recordings cannot tell, and the controller's gains."""
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
        [head, *why, _table(result, fit, configured), *outliers, *filter(None, live), *said, *_advice(result)]
    )


def _table(result: Result, fit: Fit, configured: Mapping[str, float]) -> str:
    table = Table(box=box.SIMPLE, pad_edge=False)
    for title in ("", "value", "95 % interval", "", *(["rig file"] if configured else [])):
        table.add_column(title, justify="right" if title else "left")
    for name in NAMES:
        factor, unit = _SHOWN[name]
        wide = INTERVAL * fit.sd[name] * factor
        told = with_sd(fit.value[name] * factor, wide if math.isfinite(wide) else None)
        value, _, interval = told.partition(" ± ")
        kind = "assumed" if name in result.assumed else "given" if wide == 0.0 else "not told"
        known = [number(configured[name] * factor)] if name in configured else []
        table.add_row(name, value, f"± {interval}" if interval else kind, unit, *known)
    page = io.StringIO()
    Console(file=page, width=100).print(table)
    return page.getvalue().strip("\n")


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


def plot(records: Sequence[Record], result: Result, to: Path) -> None:
    """Draw measurement, simulation and residual of each recording into a PNG file.

    Raises:
        IdentifyError: matplotlib is not installed, or there is no plant to draw.
        OSError: The file cannot be written.
    """
    try:
        from matplotlib.figure import Figure  # noqa: PLC0415 - optional
    except ImportError as error:
        raise IdentifyError("--plot needs matplotlib: pip install 'seod[plot]'") from error
    if result.fit is None:
        raise IdentifyError(f"nothing to draw: {result.message}")
    figure = Figure(figsize=(10.0, 4.5 * len(records)), layout="constrained")
    axes = figure.subplots(2 * len(records), 1, squeeze=False)[:, 0]
    for k, (record, left) in enumerate(zip(records, result.fit.residual, strict=True)):
        every = slice(None, None, 1 + len(record.t) // _DRAWN)
        above, below = axes[2 * k], axes[2 * k + 1]
        above.plot(record.t[every], record.y[every], linewidth=0.8, label="measured")
        above.plot(record.t[every], (record.y - left)[every], "--", linewidth=0.8, label="simulated")
        above.set_title(record.name, fontsize=9)
        above.legend(fontsize=8, loc="upper right")
        above.set_ylabel("y")
        below.plot(record.t[every], left[every], linewidth=0.6, color="tab:red")
        below.set_ylabel("residual")
        below.set_xlabel("t [s]")
    figure.savefig(to, format="png", dpi=110)
