"""What the report's pictures are made of: the held-out windows and both models' residuals in them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from seod.diagnose.report.chart import AFTER, BEFORE
from seod.diagnose.report.units import Units
from seod.diagnose.report.words import drives_load
from seod.diagnose.show.residual import Residual, residual
from seod.diagnose.verdict.figures import scored_windows

if TYPE_CHECKING:
    from seod.diagnose.result import Diagnosis, Window


@dataclass
class Pictures:
    """Of one diagnosis; `unit` is that of y."""

    diagnosis: Diagnosis
    unit: str

    @cached_property
    def windows(self) -> list[Window]:
        """Those that are shown."""
        return scored_windows(self.diagnosis)

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
    def models(self) -> list[tuple[str, str, list[Residual]]]:
        """Name, colour and residuals of each model that is shown."""
        shown = [("baseline", BEFORE, self.before)]
        return [*shown, ("extended", AFTER, self.after)] if self.diagnosis.extends else shown

    @property
    def tick(self) -> float:
        """Of the samples [s]."""
        return float(np.median(np.diff(self.windows[0].t)))

    @cached_property
    def units(self) -> Units:
        """Of what is drawn."""
        return Units.of(self.unit, self.diagnosis.output)

    @property
    def load(self) -> str:
        """What drives the load."""
        return drives_load(self.diagnosis)

    def noise(self, window: Window) -> float:
        """Standard deviation of the samples' noise; nan where it is not known."""
        sd = self.diagnosis.noise_sd
        return sd[window.file] if window.file < len(sd) else math.nan
