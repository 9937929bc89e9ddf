"""One recording as a fit needs it: what the plant did, freed of what its state before and an offset did."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import TYPE_CHECKING, Final, Literal

import numpy as np

from seod.data.problems import clipped
from seod.estimate.plant.free_motion import free_motion
from seod.identify.drive import Drive

if TYPE_CHECKING:
    from typing import Self

    from numpy.typing import NDArray

    from seod.estimate.arrays import Array
    from seod.estimate.plant.free_motion import Dynamics
    from seod.identify.drive import Hold

Output = Literal["position", "velocity"]
FEWEST: Final = 30
"""Samples of a recording."""
_LARGEST: Final = 1e12
"""Numbers beyond this are no measurements (and their squares would overflow)."""
_CLIPPED: Final = 0.01
"""Part of the samples that may stand at an end of the sensor's range."""


class IdentifyError(Exception):
    """A recording cannot be used; the message says why."""


class UntoldError(IdentifyError):
    """A recording tells nothing of the plant.

    Attributes:
        quality: The word for it.
    """

    def __init__(self, quality: str, message: str) -> None:
        super().__init__(message)
        self.quality = quality


class Record:
    """Samples and the voltage that caused them.

    Args:
        name: For messages.
        t: Sample times [s], rising, shape (n,).
        u: Voltages [V], shape (n,); nan where none was told.
        y: Samples [unit, or unit/s for the velocity]; nan where none came.
        t_u: When each voltage began [s]; None: at `t`.
        output: What `y` is: the position (G_L / s) or the velocity (G_L).
        offset: A velocity's sensor may have one, or the load a bias; a position has one always, and a ramp.
        hold: Whether each voltage holds until the next or runs straight on to it.

    Raises:
        UntoldError: Too few samples, or `u` or `y` stands still.
        IdentifyError: There is no `u`, or times do not rise.
    """

    def __init__(
        self,
        name: str | Path,
        t: Array,
        u: Array,
        y: Array,
        t_u: Array | None = None,
        output: Output = "position",
        offset: bool = True,
        hold: Hold = "zero",
    ) -> None:
        self.name, self.output, self.offset = str(name), output, offset
        applied = _measured(u) & _measured(t if t_u is None else t_u)
        if not applied.any():
            raise IdentifyError(f"{self.name}: has no command u: name its column by --columns u=...")
        began, volts = (t if t_u is None else t_u)[applied], u[applied]
        present = _measured(y) & _measured(t) & (t >= began[0])
        self.t, self.y = t[present], y[present]
        self._check(_measured(y).any(), began, volts)
        self.tick = float(np.median(np.diff(self.t)))
        self.since = self.t - self.t[0]
        self.span = float(self.since[-1])
        self.drive = Drive(began - self.t[0], volts, self.since, hold)

    def _check(self, measured: np.bool_, began: Array, volts: Array) -> None:
        if not measured:
            raise UntoldError("stale", f"{self.name}: has no sample of y that is a number")
        for what, times in (("t_u", began), ("t", self.t)):
            if np.any(np.diff(times) <= 0.0):
                message = f"{self.name}: times {what} do not rise; sort the rows, drop repeated ones"
                raise IdentifyError(message)
        if len(self.t) < FEWEST:
            message = f"{self.name}: has {len(self.t)} samples with a command, fewer than {FEWEST}"
            raise UntoldError("settling", message)
        for what, values in (("command u", volts), ("signal y", self.y)):
            if np.ptp(values) == 0.0:
                message = f"{self.name}: the {what} never changes: it tells nothing of the plant"
                raise UntoldError("no_oscillation", message)

    @property
    def is_clipped(self) -> bool:
        """Whether the sensor stands at an end of its range where the plant goes on."""
        found = clipped(Path(self.name), "y", self.y, np.arange(len(self.y)))
        at_ends = np.count_nonzero((self.y == self.y.max()) | (self.y == self.y.min()))
        return any(True for _ in found) and bool(at_ends > _CLIPPED * len(self.y))

    def thinned(self, most: int) -> Self:
        """Every k-th sample so that at most so many are left; the voltage is the same."""
        every = slice(None, None, -(-len(self.t) // most))
        thin = copy.copy(self)
        thin.t, thin.y, thin.since = self.t[every], self.y[every], self.since[every]
        thin.drive = self.drive.seen_at(thin.since)
        return thin

    def unit_response(self, plant: Dynamics) -> Array:
        """Of a plant of gain 1 from rest, but for what `nuisance` takes up; shape (n,)."""
        return self.drive.velocity(plant) if self.output == "velocity" else self.drive.position(plant)

    def nuisance(self, plant: Dynamics) -> Array:
        """Orthonormal columns: both free motions; offset, ramp of the position under a bias; shape (n, m)."""
        cosine, sine = free_motion(plant, self.since)
        columns = [cosine, sine * plant.omega_n]
        if self.output == "position" or self.offset:
            columns.append(np.ones_like(self.since))
        if self.output == "position":
            columns.append(self.since / self.span)
        return np.linalg.qr(np.stack(columns, axis=1))[0]

    def freed(self, plant: Dynamics) -> tuple[Array, Array]:
        """The unit response and the samples without what the nuisance columns explain."""
        basis = self.nuisance(plant)
        response = self.unit_response(plant)
        return response - basis @ (basis.T @ response), self.y - basis @ (basis.T @ self.y)


def _measured(x: Array) -> NDArray[np.bool_]:
    return np.asarray(np.abs(x) < _LARGEST)
