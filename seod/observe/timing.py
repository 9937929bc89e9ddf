"""How far the times in rows may be trusted, and what that does to an estimate."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

from drivers.base import UNKNOWN_STAMPS, UNTOLD_PERIODS, StampError
from seod.estimate.quality import NOISE_MAX

if TYPE_CHECKING:
    from collections.abc import Callable

    from seod.estimate.base import Estimate

JITTERS: Final = (
    "times of samples scatter by {scatter:.2g} ms, {part:.0%} of a radian of the limit cycle: let the board "
    "stamp its samples by a timer, or lower the frequency by more hysteresis"
)


@dataclass(slots=True)
class Timing:
    """Of one rig.

    Attributes:
        untold_delay: Standard deviation of what is under way unseen, as the driver says [s].
        stamps: How far the times of samples may be off now.
    """

    untold_delay: float
    stamps: Callable[[], StampError] = lambda: UNKNOWN_STAMPS

    @classmethod
    def of(cls, period: float, stamps: Callable[[], StampError] = lambda: UNKNOWN_STAMPS) -> Timing:
        """Before the driver has said anything, by the loop's period [s]."""
        return cls(UNTOLD_PERIODS * period, stamps)

    @property
    def delay_sd(self) -> float:
        """Standard deviation of a delay that nobody told [s]."""
        return math.hypot(self.untold_delay, _known(self.stamps().common))

    def weigh(self, answer: Estimate) -> Estimate:
        """The answer as far as the scatter of samples' times allows it.

        The mean over such times is smaller than the motion by exp(-(frequency scatter)^2 / 2), and its
        harmonics by more: that is no noise, and no window averages it out. A `nonlinear` plant cannot be
        told from it.
        """
        scatter = _known(self.stamps().scatter)
        turn = scatter * (answer.frequency or 0.0)
        if turn > NOISE_MAX and answer.quality in ("ok", "nonlinear"):
            return replace(answer, quality="noisy", advice=JITTERS.format(scatter=1e3 * scatter, part=turn))
        return replace(
            answer,
            omega_n_sd=_wider(answer.omega_n_sd, answer.omega_n, turn * turn),
            zeta_sd=_wider(answer.zeta_sd, answer.zeta, turn * turn),
        )


def _known(sd: float) -> float:
    return sd if math.isfinite(sd) else 0.0


def _wider(sd: float | None, value: float | None, part: float) -> float | None:
    return sd if sd is None or value is None else math.hypot(sd, part * value)
