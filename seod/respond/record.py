"""A segment of a recording in which the excitation is one and the same."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final, Literal, Self

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]
    Complex = NDArray[np.complex128]

Output = Literal["position", "velocity"]
FEWEST: Final = 60
"""Samples."""


class RespondError(Exception):
    """There is no frequency response to be had; the message says why and what would help."""


@dataclass(frozen=True)
class Segment:
    """Samples, and the stepwise voltage that caused them.

    Attributes:
        name: For messages.
        t: Sample times [s], rising, shape (n,).
        y: Samples [unit, or unit/s for the velocity], shape (n,).
        began: When each voltage left [s], rising, shape (m,); each holds until the next.
        u: Voltages [V], shape (m,).
        output: What `y` is: the position (G_L / s) or the velocity (G_L).
        period: Of the excitation [s]; None: not known, or it has none.
    """

    name: str
    t: Array
    y: Array
    began: Array
    u: Array
    output: Output = "position"
    period: float | None = None

    @classmethod
    def of(cls, name: str, t: Array, u: Array, y: Array, t_u: Array | None, **more: Any) -> Self:
        """From the columns of a recording, rows without a number left out.

        Raises:
            RespondError: Too few samples, or one that stands still.
        """
        left = t if t_u is None else t_u
        applied = np.isfinite(u) & np.isfinite(left)
        began, volts = left[applied], u[applied]
        rising = np.concatenate(([True], np.diff(began) > 0.0)) if len(began) else np.empty(0, np.bool_)
        began, volts = began[rising], volts[rising]
        present = np.isfinite(y) & np.isfinite(t) & (t >= (began[0] if len(began) else np.inf))
        made = cls(name, t[present], y[present], began, volts, **more)
        if len(made.t) < FEWEST:
            raise RespondError(
                f"{name}: has {len(made.t)} samples with a command; it takes {FEWEST} and three periods of a "
                "command that repeats, 512 of any other"
            )
        if not np.all(np.diff(made.t) > 0.0):
            raise RespondError(f"{name}: the times do not increase")
        for what, values in (("command u", made.u), ("signal y", made.y)):
            if np.ptp(values) == 0.0:
                raise RespondError(f"{name}: the {what} never changes: it tells no response")
        return made

    @property
    def tick(self) -> float:
        """Median interval of the samples [s]."""
        return float(np.median(np.diff(self.t)))

    def after(self, start: float) -> Segment:
        """What begins at `start` [s]; the voltage in force then included."""
        first = max(0, int(np.searchsorted(self.began, start, side="right")) - 1)
        kept = self.t >= start
        return replace(self, t=self.t[kept], y=self.y[kept], began=self.began[first:], u=self.u[first:])
