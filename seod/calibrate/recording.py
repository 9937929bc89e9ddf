"""What was recorded of one drive."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    Array = NDArray[np.float64]


@dataclass(frozen=True)
class Recording:
    """A drive from its first voltage to its last, and some of the rest before it; arrays of one length.

    Attributes:
        t: Time of each sample [s]; those of the rest lie before `step_t`.
        y: Position, or in velocity mode speed [axis unit].
        volts: Voltage that was put out, bias included [V].
        step_t: When that voltage left [s].
        step: By how much it differed from the voltage before [V].
        ps: Mean supply pressure [Pa]; nan where no sensor tells it.
    """

    t: Array
    y: Array
    volts: float
    step_t: float
    step: float
    ps: float


def recording(rest: Sequence[dict[str, Any]], samples: Sequence[dict[str, Any]]) -> Recording:
    """Of `sample` notifications: of the rest before (idle), and of the drive (exciting).

    Raises:
        ValueError: Too few samples to say anything.
    """
    if not rest or len(samples) < 4:
        raise ValueError(f"a drive brought {len(samples)} samples; lengthen it or raise loop.rate_hz")
    fresh = [sample for sample in (*rest, *samples) if sample["fresh"]]
    volts = float(np.median([sample["u"] for sample in samples]))
    first = next(sample for sample in samples if sample["u"] == volts)
    pressures = [sample["ps"] for sample in samples if sample["ps"] is not None]
    return Recording(
        np.array([sample["t"] for sample in fresh]),
        np.array([sample["y"] for sample in fresh]),
        volts,
        first["t_u"],
        volts - rest[-1]["u"],
        float(np.mean(pressures)) if pressures else float("nan"),
    )
