"""What a model is good for, beside the verdict."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from seod.diagnose.fitting.held_out import ADEQUATE

if TYPE_CHECKING:
    from seod.diagnose.result import Account, Grade, Yardstick

DESIGN_ERROR: Final = 0.05
"""Held-out NRMSE up to which a controller can be designed by a model: as a loop gain off by 5 %."""
DESIGN_SYSTEMATIC: Final = 0.02
"""Of it systematic, at most: what a controller would meet each time."""
AS_GOOD: Final = 0.95
"""NRMSE of ARX or NARX, over the model's, down to which they are no better."""


def graded(
    before: float, after: float, adequacy: float, account: Account | None, other: Yardstick | None
) -> Grade:
    """The grade.

    Args:
        before: Held-out NRMSE of the baseline.
        after: Of the extended model.
        adequacy: Its mean squared error over the white noise's.
        account: Parts of it.
        other: What models without physics reach.
    """
    if not after < 1.0:
        return "useless"
    rest = after if account is None or not account.asked else account.systematic_nrmse
    beaten = other is not None and other.best < AS_GOOD * after
    nothing_shown = account is not None and account.asked and rest == 0.0
    if adequacy < ADEQUATE or (nothing_shown and not beaten):
        return "down_to_noise"
    if after <= DESIGN_ERROR and rest <= DESIGN_SYSTEMATIC:
        return "good_for_design"
    return "partly" if after < before else "useless"
