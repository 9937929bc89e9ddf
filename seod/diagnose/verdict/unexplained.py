"""What the extended model leaves above the noise, and what that depends on."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from seod.diagnose.account.grade import untold
from seod.diagnose.fitting.simulate import POSITION, PRESSURE, VELOCITY
from seod.diagnose.result import Unexplained
from seod.diagnose.tuning.fitting import HELD_OUT
from seod.diagnose.tuning.verdict import UNEXPLAINED
from seod.identify.spread import correlation_time

if TYPE_CHECKING:
    from seod.diagnose.fitting.held_out import HeldOut
    from seod.diagnose.result import Account, Array


def unexplained(baseline: HeldOut, extended: HeldOut) -> Unexplained:
    """The share of the baseline's squared error above the noise that remains; none where noise alone does.

    Whether more than noise is left is asked of the extended model's error over the noise's (`adequacy`), not
    of the share. `systematic_part` says how much of it counts.
    """
    if extended.adequacy < HELD_OUT.adequate:
        return Unexplained(0.0)
    return _fraction(_above_noise(baseline), _above_noise(extended), extended)


def systematic_part(
    left: Unexplained,
    account: Account | None,
    rest: float,
    relevance: float,
    *,
    named: bool,
    noise_alone: bool = False,
) -> Unexplained:
    """Of what is left above white noise what is systematic; nothing, where that is not relevant.

    Args:
        left: By `unexplained`.
        account: Parts of the baseline's squared error; where nobody could ask all that is left counts, and
            where the model simulates no better than a mean: by a plant that it is not, nothing can be asked.
        rest: NRMSE of what is left.
        relevance: Systematic NRMSE up to which it does not matter.
        named: Causes are. Where none is, Eq. 1 is said to be right: that has to be told then.
        noise_alone: Prediction errors are noise: it is the plant, however little of the movement it makes.
    """
    if left.fraction == 0.0:
        return left
    no_plant = rest >= 1.0 and not noise_alone
    if account is None or not account.asked or no_plant or (not named and untold(account, rest)):
        return relevant(left, rest, relevance)
    above = account.explained + account.systematic
    if not account.systematic_nrmse > relevance or not above > 0.0:
        return Unexplained(0.0)
    return replace(left, fraction=account.systematic / above)


def relevant(left: Unexplained, rest: float, relevance: float) -> Unexplained:
    """What is left, where its NRMSE (`rest`) counts; else nothing."""
    return left if rest > relevance else Unexplained(0.0)


def _fraction(before: float, after: float, extended: HeldOut) -> Unexplained:
    """By squared errors above the noise."""
    fraction = min(1.0, after / before) if before > 0.0 else 1.0
    if fraction < UNEXPLAINED.negligible:
        return Unexplained(0.0)
    shares = _shares(extended)
    named = tuple(name for name, share in shares.items() if share > UNEXPLAINED.named_share)
    return Unexplained(fraction, named, shares)


def _above_noise(held: HeldOut) -> float:
    return float(held.counts @ (held.square - held.cut.allowed**2))


def _shares(held: HeldOut) -> dict[str, float]:
    """Share of the residual that a function of each signal alone tells, by means over quantiles; sorted."""
    rows = held.scored
    residual = held.error[rows]
    signals = {
        "input": held.cut.gathered("u"),
        "pressure": held.states[:, PRESSURE],
        "velocity": held.states[:, VELOCITY],
        "position": held.states[:, POSITION],
        "time": held.cut.gathered("t"),
    }
    if all(len(recording.supply) for recording in held.cut.series):
        signals["supply_pressure"] = held.cut.gathered("supply")
    if all(len(recording.force) for recording in held.cut.series):
        signals["measured_channel"] = held.cut.gathered("force")
    independent = max(len(residual) / max(correlation_time(residual), 1.0), UNEXPLAINED.bins + 2.0)
    shares = {name: _share(residual, signal[rows], independent) for name, signal in signals.items()}
    return dict(sorted(shares.items(), key=lambda one: -one[1]))


def _share(residual: Array, signal: Array, independent: float) -> float:
    """Between-bin part of the variance, less what as many means of noise would tell."""
    edges = np.unique(np.quantile(signal, np.linspace(0.0, 1.0, UNEXPLAINED.bins + 1)[1:-1]))
    index = np.searchsorted(edges, signal)
    count = np.bincount(index)
    total = np.bincount(index, weights=residual)
    used = count > 0
    between = float(np.sum(total[used] ** 2 / count[used])) - residual.sum() ** 2 / len(residual)
    variance = float(np.sum((residual - residual.mean()) ** 2))
    share = between / variance if variance > 0.0 else 0.0
    by_chance = (int(used.sum()) - 1) / independent
    return max(0.0, (share - by_chance) / max(1.0 - by_chance, 1e-9))
