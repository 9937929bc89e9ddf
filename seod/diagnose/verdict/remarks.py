"""Sentences beside an answer: what it rests on, what it leaves open, what a longer recording would tell."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from seod.diagnose.causes.table import OFFSET_DRIFT_PLACE
from seod.diagnose.fitting.uncertainty import at_limits, base_sd, covariance
from seod.diagnose.record.sweep import sweeps
from seod.diagnose.search.final_choice import above_noise
from seod.diagnose.tuning.search import PRUNE
from seod.diagnose.tuning.verdict import ANSWER
from seod.terminal.text import number, with_sd
from sim.effects import EFFECTS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.diagnose.fitting.held_out import HeldOut
    from seod.diagnose.fitting.least_squares import Fitted
    from seod.diagnose.record.series import Series
    from seod.diagnose.result import Array, FoundEffect, Parameter
    from seod.diagnose.verdict.effects import Chosen

RARE: Final = (
    "what is left shows in windows that were fitted and in none that was held out: no cause of it can be "
    "tried out. A longer recording, in which it happens again, tells more"
)
UNFITTED: Final = (
    "what is left shows in windows that were held out and in none that was fitted: no cause of it can be "
    "fitted. A longer recording, in which it happens again, tells more"
)
LARGER: Final = (
    "windows that were held out are off by more than noise makes of those that were fitted: something acts "
    "there that no fit has seen. A longer recording, in which it happens again, tells more"
)
EXCHANGED: Final = (
    "something acts in every second window and not in the others: causes were searched in those, and "
    "errors held out are of the others"
)
SWEPT: Final = (
    "{name}: the command sweeps, its frequency or size goes one way with time. What depends on frequency or "
    "amplitude cannot be told from a drift then: a command that does not sweep tells"
)
DRIFTS: Final = (
    "the constant load grows by {rate} unit/s^3 from the start of a recording, as of a drive that warms up: "
    "one run leaves {with_it} % of thirds that no fit has seen, {without} % without the drift. Errors held "
    "out are without it. Whether another recording drifts alike, --holdout tells"
)
OTHER_ZERO: Final = (
    "held-out recording {k}: one run is off by {whole} % of y's deviation, mostly a constant of {offset} %: "
    "there the zero of sensor or loop is another one. But for that {rest} % is left"
)
STAYS_BEHIND: Final = (
    "{name} does not carry over: of the --holdout recordings {without} % is left without it and {with_it} % "
    "with it. It is of the recordings that were fitted, not of the rig"
)
OTHER_SIZE: Final = (
    "held-out recording {k}: {place} fitted to it is {there}, and was {here}: its size does not repeat"
)
OTHER_PLANT: Final = (
    "held-out recording {k}: fitted to it alone {numbers}. That is another rig, or another state of it "
    "(supply pressure, oil, load): what it errs by is no noise"
)
IN_LOOP: Final = (
    "commands answer to what disturbs the load, so that the model whose simulation errs least is not the "
    "plant: numbers are by prediction errors, which come to it. No simulation foretells gusts"
)
UNITS: Final = {"K_L": "unit/s/V", "omega_n": "rad/s", "zeta": ""}


def remarks(
    chosen: Chosen,
    effects: Sequence[FoundEffect],
    plain: HeldOut,
    every: Sequence[Series],
    whole: Sequence[Array],
    seen: int,
) -> list[str]:
    """What a reader should know of a set of effects.

    Args:
        chosen: The set.
        effects: Of it, as they are told.
        plain: The baseline's simulation of the windows held out.
        every: The recordings; fits have seen the first `seen`.
        whole: One run of each with the set.
        seen: How many.
    """
    return [
        *_limited(chosen.reported),
        *([IN_LOOP] if chosen.in_loop else []),
        *_drifts(chosen),
        *other_zeros(every, whole, seen),
        *(left_behind(effects, plain) if len(every) > seen else ()),
        *other_plants(chosen),
        *other_sizes(effects),
        *(SWEPT.format(name=each.name) for each in effects if _swept(each, chosen.held)),
    ]


def left_behind(effects: Sequence[FoundEffect], plain: HeldOut) -> tuple[str, ...]:
    """What is said of effects that save nothing of recordings that no fit has seen.

    Args:
        effects: What was found.
        plain: The baseline where no fit has seen.
    """
    least = PRUNE.least_share * above_noise(plain)
    said = []
    for each in effects:
        without, with_it = each.gain.nrmse_without, each.gain.nrmse_with
        if without**2 - with_it**2 < least:
            left, rest = number(100.0 * without), number(100.0 * with_it)
            said.append(STAYS_BEHIND.format(name=each.name, without=left, with_it=rest))
    return tuple(said)


def other_sizes(effects: Sequence[FoundEffect]) -> list[str]:
    """Of numbers whose interval, fitted to a held-out recording, does not meet the one that is told."""
    said = []
    for effect in effects:
        for k, again in enumerate(effect.holdout, 1):
            for name in effect.parameters.keys() & again.keys():
                here, there = effect.parameters[name], again[name]
                if here.ci95[1] < there.ci95[0] or there.ci95[1] < here.ci95[0]:
                    place = f"{effect.name}.{name}"
                    said.append(OTHER_SIZE.format(k=k, place=place, there=_size(there), here=_size(here)))
    return said


def other_plants(chosen: Chosen) -> list[str]:
    """Of held-out recordings whose own plant is another one."""
    own, said = chosen.reported, []
    values, sds = own.model.values(own.x), base_sd(own, covariance(own))
    for k, one in enumerate(chosen.per_holdout, 1):
        if one is None:
            continue
        there, there_sds = one.model.values(one.x), base_sd(one, covariance(one))
        unknown = {*at_limits(own), *at_limits(one)}
        numbers = [
            f"{name} is {with_sd(there[name], 2.0 * there_sds[name])}, and was "
            f"{with_sd(values[name], 2.0 * sds[name])} {UNITS[name]}".strip()
            for name in UNITS
            if name not in unknown
            and abs(there[name] - values[name]) > ANSWER.other_plant * abs(values[name])
            and abs(there[name] - values[name])
            > ANSWER.other_plant_sds * math.hypot(sds[name], there_sds[name])
        ]
        if numbers:
            said.append(OTHER_PLANT.format(k=k, numbers=", ".join(numbers)))
    return said


def _size(parameter: Parameter) -> str:
    low, high = parameter.ci95
    return f"{with_sd(parameter.value, 0.5 * (high - low))} {parameter.unit}".strip()


def _limited(fitted: Fitted) -> list[str]:
    """Numbers that the search would not let go further."""
    values = fitted.model.values(fitted.x)
    return [
        f"{place} is at its limit ({number(values[place])}): the recording does not tell how far it goes"
        for place in at_limits(fitted)
        if place in values
    ]


def _drifts(chosen: Chosen) -> list[str]:
    if chosen.drift is None:
        return []
    rate = chosen.reported.model.values(chosen.reported.x)[OFFSET_DRIFT_PLACE]
    without, with_it = (number(100.0 * each) for each in (chosen.drift.without, chosen.drift.with_it))
    return [DRIFTS.format(rate=number(rate), without=without, with_it=with_it)]


def other_zeros(series: Sequence[Series], simulated: Sequence[Array], seen: int) -> list[str]:
    """What is said of recordings that no fit has seen, where one run of a speed is off by a constant.

    Args:
        series: The recordings; fits have seen the first `seen`.
        simulated: One run of each.
        seen: How many.
    """
    out = []
    for k, (one, y) in enumerate(zip(series[seen:], simulated[seen:], strict=True), start=1):
        error = (one.y - y)[one.good] / np.std(one.y[one.good])
        offset, rest, whole = float(np.mean(error)), float(np.std(error)), float(np.sqrt(np.mean(error**2)))
        if one.sees_speed and np.isfinite(whole) and offset**2 > ANSWER.mostly_constant * whole**2:
            percents = {"whole": whole, "offset": abs(offset), "rest": rest}
            numbers = {name: f"{100.0 * each:.2g}" for name, each in percents.items()}
            out.append(OTHER_ZERO.format(k=k, **numbers))
    return out


def _swept(effect: FoundEffect, held: HeldOut) -> bool:
    of_plant = EFFECTS[effect.name].enters == "plant"
    return of_plant and any(sweeps(recording.t, recording.u) for recording in held.cut.series)
