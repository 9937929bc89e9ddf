"""What a model is good for, beside the verdict."""

from __future__ import annotations

from typing import TYPE_CHECKING

from seod.diagnose.tuning.account import GRADE
from seod.diagnose.tuning.fitting import HELD_OUT

if TYPE_CHECKING:
    from seod.diagnose.result import Account, Grade


def graded(
    before: float, after: float, adequacy: float, account: Account | None, *, clean: bool = False
) -> Grade:
    """The grade.

    Args:
        before: Held-out NRMSE of the baseline.
        after: Of the extended model.
        adequacy: Its mean squared error over the white noise's.
        account: Parts of it. Where ARX or NARX come nearer by more than chance, a part is systematic.
        clean: Eq. 1 alone is right, and its model is the extended one.
    """
    if not after < 1.0:
        return "useless"
    rest = _systematic(after, account)
    nothing_shown = (
        account is not None and account.systematic_nrmse == 0.0 and would_have_shown(account, after)
    )
    if adequacy < HELD_OUT.adequate or (nothing_shown and after <= before):
        return "down_to_noise"
    if after <= GRADE.design_error and rest <= GRADE.design_systematic:
        return "good_for_design"
    return "partly" if after < before or clean else "useless"


def would_have_shown(account: Account, after: float) -> bool:
    """Whether a systematic part of what is left would have been shown, had there been one that counts."""
    return account.asked and account.detectable_nrmse <= GRADE.told * after


def untold(account: Account, after: float) -> bool:
    """Whether much is left, and nothing would have been shown, had all of it been systematic."""
    return after > GRADE.untold and account.detectable_nrmse > after and account.systematic == 0.0


def _systematic(after: float, account: Account | None) -> float:
    """NRMSE of the systematic part; where nothing is shown what might have been there unseen."""
    if account is None or not account.asked:
        return after
    return account.systematic_nrmse or min(after, account.detectable_nrmse)
