"""The hidden numbers as a recording can tell them: in its units, at its pressure.

A recording does not say at which pressure its numbers are meant: a diagnosis takes the median of its column.
Nor does a sensor with a curve show which unit its positions are in: a diagnosis takes the one in which the
straight part of the curve has slope 1.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from hidden_cases import supply_of
from hidden_plant import encoder
from hidden_records import make_record
from hidden_rig import GIVEN, Drive, simulate
from hidden_rough import dimension
from numpy.polynomial import Legendre

from seod.diagnose.causes.sensor import CURVE_MARGIN
from seod.diagnose.tuning.starts import SIZES
from sim.effects import EFFECTS, SENSOR_CURVE

if TYPE_CHECKING:
    from hidden_cases import Case
    from hidden_rough import Rough

CURVE = "sensor_nonlinearity"
DEFECT_NAMES = {"jitter": "deviation", "part": "rate"}
BY_PRESSURE = {("pressure_dependent_stiffness", "air"): -2, ("square_root_flow", "supply"): 1}
"""Powers of the pressure at which a number is told, over that at which it is hidden."""


def told_by_file(case: Case) -> dict[str, dict[str, float]]:
    """Values by effect and parameter; of a speed neither the position nor the phase of its ripple."""
    values = {name: dict(group) for name, group in case.rig.effects.items()}
    if case.rig.sees_speed:
        values.get("position_ripple", {}).pop("phase", None)
        values.get("load_spring", {}).pop("centre", None)
    supply = supply_of(case)
    pressure = 1.0 if supply is None else float(np.median(supply))
    length = unit_of_position(case)
    for name, group in values.items():
        for of in group:
            lengths, _ = dimension(_unit(name, of), sees_speed=case.rig.sees_speed)
            group[of] *= pressure ** BY_PRESSURE.get((name, of), 0) * length**lengths
    return values | ({case.causes[0]: _defect(case)} if case.defects else {})


def told_by_rough_file(case: Case, how: Rough) -> dict[str, dict[str, float]]:
    """The same in the units that the rough record has.

    Without a delay where the command came through a sampler, whose own it changes.
    """
    return {
        name: {
            of: how.converted(f"{name}.{of}", value, sees_speed=case.rig.sees_speed)
            for of, value in group.items()
        }
        for name, group in told_by_file(case).items()
        if how.sampler == "none" or name != "transport_delay"
    }


def unit_of_position(case: Case) -> float:
    """Units of the file in one of the plant: over the readings' range the straight part has slope 1 there."""
    if CURVE not in case.rig.effects:
        return 1.0
    record = make_record(case)
    ends = SIZES.outliers_of_travel, 1.0 - SIZES.outliers_of_travel
    lowest, highest = np.nanquantile(record.y, ends)
    rest = {name: group for name, group in case.rig.effects.items() if name != CURVE}
    straight, drive = replace(case.rig, effects=rest), Drive(GIVEN, record.u)
    places, _ = simulate(straight, case.t, drive, None, supply_of(case), latency=case.latency)
    within, p = np.linspace(np.min(places), np.max(places), 2001), case.rig.physical()[0]
    seen = np.array([encoder(p, x) for x in within])
    middle, half = 0.5 * (highest + lowest), 0.5 * CURVE_MARGIN * (highest - lowest)
    at, wide = 0.5 * (within[0] + within[-1]), 0.5 * CURVE_MARGIN * np.ptp(within)
    for _ in range(50):  # until the curve over `at` +- `wide` begins with `middle` + `half` z
        level, slope, *_ = Legendre.fit(within, seen, max(SENSOR_CURVE), domain=(at - wide, at + wide)).coef
        at, wide = at + (middle - level) * wide / slope, wide * half / slope
    return float(half / wide)


def _unit(name: str, of: str) -> str:
    every = EFFECTS[name].parameters if name in EFFECTS else ()
    return next((each.unit for each in every if each.name == of), "1")


def _defect(case: Case) -> dict[str, float]:
    return {DEFECT_NAMES.get(name, name): value for name, value in case.defects.items()}
