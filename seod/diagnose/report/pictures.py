"""The report's pictures, each of the held-out windows."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Final

import numpy as np

from seod.diagnose.report.chart import AFTER, BEFORE, FLOOR, MEASURED, Chart, Curve, Map
from seod.diagnose.show.maps import binned, plane
from seod.diagnose.show.residual import Residual, residual, scored

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.diagnose.answer import Array, Diagnosis, Window

WIDE: Final = 940.0
_SHOWN_S: Final = 12.0
"""Periods of the plant's frequency that the overlay shows."""
_LAGS: Final = 4.0
"""Likewise that correlations reach to."""


@dataclass
class Pictures:
    """All pictures of one diagnosis; `unit` is that of y."""

    diagnosis: Diagnosis
    unit: str

    @cached_property
    def windows(self) -> list[Window]:
        """Those that are shown."""
        return scored(self.diagnosis)

    @cached_property
    def before(self) -> list[Residual]:
        """Residuals of the baseline in each."""
        d = self.diagnosis
        return [residual(w, w.y_baseline, d.baseline, d.output) for w in self.windows]

    @cached_property
    def after(self) -> list[Residual]:
        """Residuals of the extended model; both are seen through the baseline's Eq. 1, to be compared."""
        d = self.diagnosis
        return [residual(w, w.y_extended, d.baseline, d.output) for w in self.windows]

    @property
    def extended(self) -> bool:
        """Whether there is more than the baseline to show."""
        return bool(self.diagnosis.effects)

    @property
    def tick(self) -> float:
        """Of the samples [s]."""
        return float(np.median(np.diff(self.windows[0].t)))

    def overlay(self) -> str:
        """Measurement and both simulations where the baseline is at its worst."""
        window = self.windows[self._worst()]
        most = int(_SHOWN_S * 2.0 * math.pi / self.diagnosis.baseline.omega_n / self.tick)
        first = max(0, len(window.t) - max(most, 50))
        piece = slice(first, None)
        t = window.t[piece]
        curves = [
            Curve(t, window.y[piece], "measured", MEASURED, 2.2),
            Curve(t, window.y_baseline[piece], "baseline", BEFORE, 1.3),
        ]
        if self.extended:
            curves.append(Curve(t, window.y_extended[piece], "extended", AFTER, 1.3, "5 3"))
        title = "Where the baseline is at its worst: a held-out window, simulated from its beginning"
        return Chart(title, "t [s]", f"y [{self.unit}]", curves, WIDE, 280.0).svg()

    def errors(self) -> str:
        """What is left in the same window, against the noise."""
        at = self._worst()
        window, sd = self.windows[at], self.noise(self.windows[at])
        flat = np.full(len(window.t), 2.0 * sd)
        curves = [Curve(window.t, self.before[at].error, "error of the baseline", BEFORE, 1.0)]
        if self.extended:
            curves.append(Curve(window.t, self.after[at].error, "of the extended model", AFTER, 1.0))
        curves.append(Curve(window.t, -flat, "noise, two standard deviations", FLOOR, to=flat))
        return Chart("", "t [s]", f"y - simulated [{self.unit}]", curves, WIDE, 200.0).svg()

    def over_time(self) -> str:
        """Rms error of each window, by its place in the recording."""
        middle = np.array([float(np.mean(w.t)) for w in self.windows])
        kinds = [("baseline", BEFORE, self.before), ("extended", AFTER, self.after)]
        curves = [
            Curve(middle, self._rms(left), label, colour, dots=True)
            for label, colour, left in kinds[: 1 + self.extended]
        ]
        curves.append(
            Curve(middle, np.array([self.noise(w) for w in self.windows]), "noise", FLOOR, dash="4 3")
        )
        return Chart(
            "Over time: rms error of each held-out window", "t [s]", f"[{self.unit}]", curves, log_y=True
        ).svg()

    def maps(self) -> list[str]:
        """Residual force over the load's states, residual volts over the command, and over pressure."""
        base = self._base
        told = [
            ("Over velocity: a step at 0 is friction", f"velocity [{base}/s]", "force", "velocity"),
            (
                "Over position: a slope is a spring, waves are ripple",
                f"position [{base}]",
                "force",
                "position",
            ),
            ("Over load pressure: a bend is flow", f"load pressure [{base}/s²]", "volts", "pressure"),
            ("Over the command: a flat or a bend is the valve", "u [V]", "volts", "u"),
        ]
        if any(w.ps is not None for w in self.windows):
            told.append(("Over supply pressure", "[Pa]", "volts", "ps"))
        return [self._map(*each) for each in told]

    def planes(self) -> list[str]:
        """Residual force over position and velocity, before and after, in the same colours."""
        x, y = self._states("position"), self._states("velocity")
        kinds = [("baseline", self.before), ("extended", self.after)][: 1 + self.extended]
        tables = [plane(x, y, np.concatenate([r.force for r in left])) for _, left in kinds]
        most = float(np.nanquantile(np.abs(tables[0][2]), 0.98)) if np.isfinite(tables[0][2]).any() else 1.0
        base = self._base
        return [
            Map(
                f"Residual force, {label} (full colour {most:.3g} {base}/s²)",
                f"position [{base}]",
                f"velocity [{base}/s]",
                *table,
                most or 1.0,
            ).svg()
            for (label, _), table in zip(kinds, tables, strict=True)
        ]

    def _map(self, title: str, x_label: str, kind: str, quantity: str) -> str:
        label = "residual [V]" if kind == "volts" else f"residual force [{self._base}/s²]"
        return self.bins(title, x_label, label, self._states(quantity), kind)

    def bins(self, title: str, x_label: str, y_label: str, x: Array, kind: str) -> str:
        """A field of the residuals (`error`, `force`, `volts`) over `x`: means with intervals, of both."""
        correlated = (
            1.0
            if kind == "error"
            else max(1.0, math.pi / (4.0 * self.diagnosis.baseline.omega_n) / self.tick)
        )
        curves = []
        kinds = [("baseline", BEFORE, self.before), ("extended", AFTER, self.after)][: 1 + self.extended]
        for label, colour, left in kinds:
            found = binned(x, np.concatenate([getattr(r, kind) for r in left]), correlated)
            curves += [
                Curve(found.centre, found.mean, label, colour, 1.8),
                Curve(found.centre, found.low, "", colour, to=found.high),
            ]
        return Chart(title, x_label, y_label, curves).svg()

    def _states(self, name: str) -> Array:
        pieces = [getattr(w, name) for w in self.windows]
        missing = [np.full(len(w.t), np.nan) for w in self.windows]
        return np.concatenate([m if p is None else p for p, m in zip(pieces, missing, strict=True)])

    def _rms(self, left: Sequence[Residual]) -> Array:
        pairs = zip(self.windows, left, strict=True)
        return np.array([math.sqrt(float(np.nanmean(r.error[w.scored] ** 2))) for w, r in pairs])

    def _worst(self) -> int:
        return int(np.argmax(self._rms(self.before)))

    def noise(self, window: Window) -> float:
        """Standard deviation of the samples' noise; nan where it is not known."""
        sd = self.diagnosis.noise_sd
        return sd[window.file] if window.file < len(sd) else math.nan

    @property
    def _base(self) -> str:
        """Unit of the position."""
        return self.unit.removesuffix("/s")
