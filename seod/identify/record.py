"""One recording as a fit needs it: what the plant did, freed of what its state before and an offset did."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, Literal

import numpy as np

from seod.estimate.plant_response import StepwiseVoltage, free_motion

if TYPE_CHECKING:
    from pathlib import Path

    from seod.estimate.limit_cycle import Array
    from seod.estimate.plant_response import Dynamics

Output = Literal["position", "velocity"]
FEWEST: Final = 30
"""Samples of a recording."""


class IdentifyError(Exception):
    """A recording tells nothing; the message says why."""


class Record:
    """Samples and the stepwise voltage that caused them.

    Args:
        name: For messages.
        t: Sample times [s], rising, shape (n,).
        u: Voltages [V], each holding until the next; shape (n,).
        y: Samples [unit, or unit/s for the velocity]; nan where none came.
        t_u: When each voltage began [s]; None: at `t`.
        output: What `y` is: the position (G_L / s) or the velocity (G_L).
        offset: A velocity's sensor may have one; a position has one always, and a ramp.

    Raises:
        IdentifyError: Too few samples, or `u` or `y` stands still.
    """

    def __init__(
        self,
        name: str | Path,
        t: Array,
        u: Array,
        y: Array,
        t_u: Array | None = None,
        output: Output = "position",
        offset: bool = False,
    ) -> None:
        self.name, self.output, self.offset = str(name), output, offset
        applied = np.isfinite(u) & (np.isfinite(t) if t_u is None else np.isfinite(t_u))
        if not applied.any():
            raise IdentifyError(f"{self.name}: has no command u: name its column by --columns u=...")
        began = (t if t_u is None else t_u)[applied]
        present = np.isfinite(y) & (t >= began[0])
        self.t, self.y = t[present], y[present]
        if len(self.t) < FEWEST:
            raise IdentifyError(f"{self.name}: has {len(self.t)} samples with a command, fewer than {FEWEST}")
        for what, values in (("command u", u[applied]), ("signal y", self.y)):
            if np.ptp(values) == 0.0:
                raise IdentifyError(f"{self.name}: the {what} never changes: it tells nothing of the plant")
        self.voltage = StepwiseVoltage(began, u[applied], self.t)
        self.since = self.t - self.t[0]

    @property
    def tick(self) -> float:
        """Median interval [s]."""
        return float(np.median(np.diff(self.t)))

    def unit_response(self, plant: Dynamics) -> Array:
        """Of a plant of gain 1 from rest, but for what `nuisance` takes up; shape (n,)."""
        if self.output == "velocity":
            return self.voltage.velocity(plant)
        return self.voltage.position(plant)

    def nuisance(self, plant: Dynamics) -> Array:
        """Orthonormal columns: both free motions; offset, ramp of the position under a bias; shape (n, m)."""
        cosine, sine = free_motion(plant, self.since)
        columns = [cosine, sine * plant.omega_n]
        if self.output == "position" or self.offset:
            columns.append(np.ones_like(self.since))
        if self.output == "position":
            columns.append(self.since / self.since[-1])
        return np.linalg.qr(np.stack(columns, axis=1))[0]

    def freed(self, plant: Dynamics) -> tuple[Array, Array]:
        """The unit response and the samples without what the nuisance columns explain."""
        basis = self.nuisance(plant)
        response = self.unit_response(plant)
        return response - basis @ (basis.T @ response), self.y - basis @ (basis.T @ self.y)
