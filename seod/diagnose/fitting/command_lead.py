"""When commands were given, where nobody tells, as a number beside the model.

A logger may note a command when it is given, or at a row after that, so that it seems later than it was; or
it may look now and then at what runs on between. A fit takes half a row for a lag, for friction or for
damping, and is sure of it. So numbers are told beside a lead of that size (Bayesian linear model; Kay,
Fundamentals of Statistical Signal Processing, vol. 1, 11.6).
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from seod.diagnose.causes.table import LATE
from seod.diagnose.fitting.least_squares import weighted
from seod.diagnose.record.command_timing import earlier, looks
from seod.diagnose.tuning.record import COMMAND_TIMING

if TYPE_CHECKING:
    from seod.diagnose.fitting.least_squares import Fitted
    from seod.diagnose.fitting.model import Model
    from seod.diagnose.record.series import Series
    from seod.diagnose.record.windows import Cut
    from seod.diagnose.result import Array


def untimed(cut: Cut, model: Model) -> Cut:
    """The same windows, with a lead beside the model where nobody tells when commands were given.

    A model with a delay has none: its delay counts from where commands are recorded.
    """
    late = LATE in model.names or LATE in model.fixed
    return replace(cut, untimed=not late and not any(one.timed for one in cut.series))


def lead_column(fitted: Fitted) -> Array | None:
    """What a lead of its deviation changes in the simulation, shape (n, 1); None where it is told."""
    if not fitted.cut.untimed:
        return None
    model, cut, x, start = fitted.model, fitted.cut, fitted.x, fitted.start
    change = COMMAND_TIMING.change
    residuals = [weighted(model, each, x, start) for each in (cut, led(cut, change))]
    return np.asarray((residuals[0] - residuals[1])[:, None] / change)


def led(cut: Cut, deviations: float) -> Cut:
    """The same windows with commands earlier by so many deviations."""
    return replace(cut, series=[earlier(one, deviations * lead_sd(one)) for one in cut.series])


def lead_sd(one: Series) -> float:
    """Deviation of when a recording's commands were given [rows]."""
    return COMMAND_TIMING.unsure * max(1, looks(one.u))


def possible(cut: Cut) -> tuple[float, float]:
    """By how many deviations earlier or later than they are commands may be."""
    low = max(-one.lead / lead_sd(one) for one in cut.series)
    high = min(COMMAND_TIMING.most / COMMAND_TIMING.unsure - one.lead / lead_sd(one) for one in cut.series)
    return low, high


def lead_remarks(fitted: Fitted) -> list[str]:
    """What is said of commands that are taken to have been given earlier than recorded."""
    one = max(fitted.cut.series, key=lambda each: each.lead)
    if one.lead < COMMAND_TIMING.mentioned * lead_sd(one):
        return []
    earlier_by = f"{one.lead * one.tick:.3g} s ({one.lead:.2g} rows)"
    return [
        f"numbers are told with commands {earlier_by} earlier than recorded: "
        "a logger notes them late, or they ran on between rows. A column t_u tells when they were given, "
        "--hold how they ran"
    ]
