"""Figures and findings in words, the same on the page, on the terminal and in the PDF."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from seod.diagnose.causes.table import CAUSES, sentence
from seod.diagnose.report.units import Units
from seod.sheet.limits import DRIFT
from seod.terminal.text import number
from sim.effects import EFFECTS

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from seod.calibrate.value import Value
    from seod.sheet.segments import Cause, Number
    from seod.sheet.sheet import AxisSheet, Diagnosed, Sheet
    from seod.sheet.terms import Term
    from seod.sheet.trend import Trend

SCOPE = (
    "Terms are those of ISO 10770-1, which tests a valve by itself on a bench. Here the valve moves its "
    "actuator and load: each figure is of them together, under the rig's own pressure and temperature. "
    "Frequency and step response are from voltage to speed (to a position they end in an integrator, which "
    "has no -3 dB). What is calculated is of the second-order G_L(s) of zeta and omega_n, taken as "
    "independent, without the loop's delay."
)


def rounded(value: float, wide: float) -> str:
    """A number with the digits that its interval's half width leaves a meaning."""
    if not 0.0 < wide < math.inf:
        return number(value)
    decimals = min(12, max(0, 1 - math.floor(math.log10(wide))))
    return f"{value:.{decimals}f}"


def value_of(term: Term) -> str:
    """`≤ 0.0012`, `11.3`, or `not measured`."""
    if term.value is None:
        return "not measured"
    wide = 0.5 * (term.interval[1] - term.interval[0]) if term.interval else 0.0
    return ("≤ " if term.at_most else "") + rounded(term.value, wide)


def interval_of(interval: tuple[float, float] | None) -> str:
    """`11.2 to 11.4`; a dash where there is none."""
    if interval is None:
        return "-"
    wide = 0.5 * (interval[1] - interval[0])
    return f"{rounded(interval[0], wide)} to {rounded(interval[1], wide)}"


def with_interval(value: Value) -> str:
    """`11.3 (11.2 to 11.4)`."""
    low, high = value.interval
    return f"{rounded(value.value, 0.5 * (high - low))} ({interval_of(value.interval)})"


def drift_of(trend: Trend) -> str:
    """`-3.1 % (-4.0 to -2.2)` against the reference; a dash where there is none."""
    if trend.drift is None:
        return "-"
    low, high = (100.0 * each for each in trend.drift.interval)
    wide = 0.5 * (high - low)
    value = 100.0 * trend.drift.value
    sign = "+" if value > 0.0 else ""
    return f"{sign}{rounded(value, wide)} % ({rounded(low, wide)} to {rounded(high, wide)})"


def allowed(trend: Trend) -> str:
    """The limit that counts."""
    if trend.limit is None:
        return f"drift of {100.0 * DRIFT[trend.name]:g} %"
    low, high = trend.limit.low, trend.limit.high
    return f"{'' if math.isinf(low) else f'{low:g}'} to {'' if math.isinf(high) else f'{high:g}'}".strip()


def headline(sheet: Sheet) -> str:
    """The sheet in one sentence."""
    alarms = [f"{axis.name}: {alarm}" for axis in sheet.axes for alarm in axis.alarms]
    left = [axis.name for axis in sheet.axes if axis.left and axis.left[-1].back is None]
    faults = sum(len(axis.faults) for axis in sheet.axes)
    told = [f"{'; '.join(alarms)}"] if alarms else ["no drift beyond its limit"]
    told += [f"{', '.join(left)} {'has' if len(left) == 1 else 'have'} left the model"] if left else []
    told += [f"{faults} {'fault' if faults == 1 else 'faults'}"] if faults else ["no faults"]
    text = "; ".join(told)
    return f"{text[0].upper()}{text[1:]}." if not alarms else f"{text}."


def is_fine(sheet: Sheet) -> bool:
    """No alarm, no fault, no model that was left for good."""
    return not any(
        axis.alarms or axis.faults or (axis.left and axis.left[-1].back is None) for axis in sheet.axes
    )


def causes(found: Sequence[Cause], axis: AxisSheet, *, meanings: bool = True) -> Iterator[str]:
    """Each cause with its parameters and, unless that was said, its meaning in the diagnosis' own words."""
    units = Units.of(axis.unit, "velocity" if axis.unit.endswith("/s") else "position")
    effects = {each.name: {name: one.value for name, one in each.parameters.items()} for each in found}
    for each in found:
        numbers = ", ".join(f"{name} {_number(one, units)}" for name, one in each.parameters.items())
        name = f"{each.name} ({numbers})" if numbers else each.name
        yield f"{name}: {_meaning(each.name, effects)}" if meanings else name


def _meaning(name: str, effects: dict[str, dict[str, float]]) -> str:
    if name not in CAUSES:
        return EFFECTS[name].physics if name in EFFECTS else "not a cause that this version knows"
    try:
        return sentence(name, effects)
    except (KeyError, IndexError):  # of another version: its parameters are not ours
        return EFFECTS[name].physics


def _number(one: Number, units: Units) -> str:
    unit = units.named(one.unit)
    if one.interval is None:
        return f"{number(one.value)} {unit}".strip()
    wide = 0.5 * (one.interval[1] - one.interval[0])
    return f"{rounded(one.value, wide)} {unit} [{interval_of(one.interval)}]".replace("  ", " ")


def verdict(one: Diagnosed | None, file: str) -> str:
    """What a diagnosis said in all; or that there is none, and what makes one."""
    if one is None:
        return f"not diagnosed: seod diagnose {file} says why"
    words = {
        "clean": "clean: the model explains the recording",
        "effects": "causes are named",
        "unexplained": "a part is not explained by any known cause",
    }
    return f"{words.get(one.verdict, one.verdict)} ({one.file})"
