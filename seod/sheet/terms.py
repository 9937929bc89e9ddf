"""The quantities of ISO 10770-1 from what was measured; what was not says so, and which command does it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Literal, NamedTuple

from seod.calibrate.value import Value
from seod.sheet import second_order

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from seod.sheet.response import Measured
    from seod.sheet.rig import Calibration
    from seod.sheet.segments import Segment
    from seod.sheet.trend import Trend

How = Literal["measured", "calculated", "not measured"]


@dataclass(frozen=True, slots=True)
class Term:
    """One quantity of the standard.

    Attributes:
        term: The standard's, and which case of it.
        value: None where it was not measured.
        unit: Of it.
        interval: 95 %; None where there is none.
        how: Whether it was measured, or calculated from what was.
        source: File, date, method; of what was not measured, what measures it.
        at_most: The value is a bound that the quantity does not exceed.
    """

    term: str
    value: float | None
    unit: str
    interval: tuple[float, float] | None
    how: How
    source: str
    at_most: bool = False


class Known(NamedTuple):
    """All that there is of one axis.

    Attributes:
        gain_unit, command_unit: Of K_L and of commands, SI.
        rig_source: Where the calibration stands.
        calibration: None where there is none.
        responses: Frequency responses.
        trends: Of zeta, omega_n and K_L.
        diagnosed: Segments that were diagnosed, oldest first.
    """

    gain_unit: str
    command_unit: str
    rig_source: str
    calibration: Calibration | None
    responses: Sequence[Measured]
    trends: dict[str, Trend]
    diagnosed: Sequence[Segment]


HYSTERESIS, OVERLAP = "valve_hysteresis", "valve_deadband"
"""Causes whose parameter `half_width` is half a quantity of the standard."""
SHOWS: Final = (
    "seod diagnose finds it in a recording with many levels of command; a relay's two levels hide it"
)
CALIBRATE: Final = "seod calibrate RIG.yaml measures it"
RESPOND: Final = "seod response --config RIG.yaml --json > FILE measures it; give that as --response FILE"
EXCITE: Final = "it is calculated from zeta and omega_n: seod run RIG.yaml --start --record FILE.mcap"


def terms(known: Known) -> list[Term]:
    """The standard's quantities in its order: static, then dynamic."""
    return [
        *_flow_gain(known),
        *_width(known, HYSTERESIS, "hysteresis"),
        *_threshold(known),
        _null_bias(known),
        *_width(known, OVERLAP, "overlap at null (dead band)", asked=False),
        *_frequency(known, "-3 dB"),
        *_frequency(known, "-90 deg"),
        *_step(known),
    ]


def _flow_gain(known: Known) -> Iterator[Term]:
    told = "flow gain, as no-load speed per command"
    calibration, empty = known.calibration, True
    words = {"K_L": "", "K_L_up": ", towards larger readings", "K_L_down": ", towards smaller readings"}
    for name, which in words.items() if calibration else ():
        if calibration is not None and name in calibration.values:
            source = f"{_calibrated(known)}: K_L, by steady speeds at several commands"
            yield _of(f"{told}{which}", calibration.values[name], known.gain_unit, "measured", source)
            empty = False
    for each in known.responses:
        source = f"{_response(each)}: gain of the lowest octave, from {each.band[0]:.3g} Hz"
        yield _of(told, each.gain, known.gain_unit, "measured", source)
        empty = False
    if days := known.trends["K_L"].days:
        source = f"K_L of {days[-1].day}, mean of {days[-1].estimates} estimates by two phases"
        yield _of(told, days[-1].mean, known.gain_unit, "measured", source)
        empty = False
    if empty:
        yield _none(told, known.gain_unit, CALIBRATE)


def _width(known: Known, cause: str, term: str, *, asked: bool = True) -> Iterator[Term]:
    """Twice the half width of the newest diagnosis with this cause; `asked`: tell where there is none."""
    for segment in reversed(known.diagnosed):
        for each in segment.causes:
            if each.name != cause:
                continue
            found = each.parameters["half_width"]
            wide = None if found.interval is None else (2.0 * found.interval[0], 2.0 * found.interval[1])
            source = f"seod diagnose of {segment.file} ({segment.begin.date()}): twice {cause}.half_width"
            yield Term(term, 2.0 * found.value, known.command_unit, wide, "measured", source)
            return
    if not asked:
        return
    diagnosed = [each.file for each in known.diagnosed]
    none = f"no diagnosis names it, the newest of {diagnosed[-1]}; " if diagnosed else ""
    yield _none(term, known.command_unit, none + SHOWS)


def _threshold(known: Known) -> Iterator[Term]:
    """The staircase of a calibration bounds it: the command that moves one way, less that of the other."""
    edges = known.calibration.edges if known.calibration else {}
    if "deadband_up" not in edges or "deadband_down" not in edges:
        yield _none("threshold", known.command_unit, f"a bound of it: {CALIBRATE}")
        return
    up, down = edges["deadband_up"], edges["deadband_down"]
    most = up[1] - down[0]
    method = "from moving one way to moving the other about null, overlap and stiction included"
    source = f"{_calibrated(known)}: {method}"
    wide = (max(0.0, up[0] - down[1]), most)
    yield Term("threshold, at null", most, known.command_unit, wide, "measured", source, at_most=True)


def _null_bias(known: Known) -> Term:
    if known.calibration is None:
        return _none("null bias", known.command_unit, CALIBRATE)
    source = f"{_calibrated(known)}: the command at which it stands still"
    return _of("null bias", known.calibration.values["null"], known.command_unit, "measured", source)


class _Plant(NamedTuple):
    zeta: Value
    omega_n: Value
    source: str


def _plants(known: Known) -> Iterator[_Plant]:
    """Of the limit cycle, newest day; else of fits to frequency responses."""
    zeta = {each.day: each for each in known.trends["zeta"].days}
    both = [each for each in known.trends["omega_n"].days if each.day in zeta]
    if both:
        last = both[-1]
        source = f"zeta and omega_n of {last.day}, means of {last.estimates} estimates in limit cycles"
        yield _Plant(zeta[last.day].mean, last.mean, source)
        return
    for each in known.responses:
        if {"zeta", "omega_n"} <= each.fit.keys():
            yield _Plant(
                each.fit["zeta"], each.fit["omega_n"], f"zeta and omega_n fitted to {_response(each)}"
            )


def _frequency(known: Known, at: Literal["-3 dB", "-90 deg"]) -> Iterator[Term]:
    term = f"frequency response, {at}"
    measured = False
    for each in known.responses:
        value = each.minus_3_db() if at == "-3 dB" else each.minus_90_deg()
        if value is None:
            low, high = each.band
            what = f"{_response(each)}: not reached between {low:.3g} and {high:.3g} Hz; give a wider --band"
            yield _none(term, "Hz", what)
            continue
        measured = True
        yield _of(term, value, "Hz", "measured", f"{_response(each)}: points, from voltage to speed")
    of = second_order.bandwidth if at == "-3 dB" else second_order.phase_90
    for plant in _plants(known):
        value = second_order.propagated(of, plant.zeta, _hertz(plant.omega_n), 1)
        yield _of(term, value, "Hz", "calculated", f"from {plant.source}")
        measured = True
    if not measured:
        yield _none(term, "Hz", RESPOND)


_STEP: Final[tuple[tuple[str, str, Callable[[float], float], int], ...]] = (
    ("rise time, 10 to 90 %", "s", second_order.rise_time, -1),
    ("overshoot", "%", lambda zeta: 100.0 * second_order.overshoot(zeta), 0),
    ("settling time, to 5 %", "s", second_order.settling_time, -1),
)


def _step(known: Known) -> Iterator[Term]:
    plants = list(_plants(known))
    for name, unit, of, power in _STEP:
        term = f"step response, {name}"
        for plant in plants:
            value = second_order.propagated(of, plant.zeta, plant.omega_n, power)
            yield _of(term, value, unit, "calculated", f"from {plant.source}")
        if not plants:
            yield _none(term, unit, EXCITE)


def _hertz(omega: Value) -> Value:
    low, high = omega.interval
    return Value(omega.value / math.tau, omega.sd / math.tau, (low / math.tau, high / math.tau))


def _of(term: str, value: Value, unit: str, how: How, source: str) -> Term:
    return Term(term, value.value, unit, value.interval, how, source)


def _none(term: str, unit: str, source: str) -> Term:
    return Term(term, None, unit, None, "not measured", source)


def _calibrated(known: Known) -> str:
    assert known.calibration is not None  # noqa: S101 - asked where there is one
    return f"seod calibrate of {known.calibration.day}, in {known.rig_source}"


def _response(each: Measured) -> str:
    doubt = "" if each.quality == "ok" else f", quality {each.quality}"
    return f"{each.path.name} (seod response, {each.day}{doubt})"
