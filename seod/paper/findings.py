"""Two questions that the paper leaves: why omega_n grows with supply pressure, and how large e_a may be."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from seod.paper.answers import answer
from seod.paper.bench import Bench
from seod.paper.figures import SEAT, SERVO, TAIL, exponent

if TYPE_CHECKING:
    from collections.abc import Callable

    from seod.paper.answers import Answer

Numbers = dict[str, Any]

PRESSURES: Final = (5e6, 6e6, 7e6, 8e6, 9e6, 10e6)
"""Of the exponents [Pa]: the paper's range."""
SPEED: Final = 32.5
"""Of Fig. 11 [rad/s]."""
LARGE: Final = 1.5
"""The paper's e_a [V]."""
SMALL: Final = 0.1
"""One at which little is nonlinear [V]."""
RUN_S: Final = 2.0
SETTLES: Final = 120.0
"""Length of a run in (1 + zeta) / omega_n: the limit cycle settles, and some windows follow."""
CLOSE: Final = 0.02
"""Within which zeta and omega_n count as the small-signal ones."""

FAST: Final = 5000.0
"""Of a spool whose lag does not matter here [rad/s]."""
IDEAL: Final = {
    "supply": {"ripple": 0.0, "droop": 0.0},
    "valve": {"leakage": 0.0, "omega": FAST},
    "oil": {"air": 0.0},
    "leakage": {"cross": 2e-12},
    "load": {"coulomb": 0.0},
}
"""Parts of a servo motor of constant bulk modulus, without friction, with a fast spool and little leakage."""
MECHANISMS: Final[tuple[tuple[str, dict[str, dict[str, float]]], ...]] = (
    ("none: oil without air", {}),
    ("air 0.5 %", {"oil": {"air": 0.005}}),
    ("air 2 %", {"oil": {"air": 0.02}}),
    ("air 5 %, isothermal", {"oil": {"air": 0.05, "polytropic": 1.0}}),
    ("air 20 %, isothermal (not plausible)", {"oil": {"air": 0.2, "polytropic": 1.0}}),
    ("friction 5 % of torque at 8 MPa", {"load": {"coulomb": 0.7}}),
    ("leakage 1.4 L/min at 8 MPa more", {"leakage": {"cross": 5e-12}}),
    ("clearances 1.2 L/min", {"valve": {"leakage": 2e-5}}),
    ("supply droop 0.4 MPa", {"supply": {"droop": 5e8}}),
    ("spool of 700 rad/s", {"valve": {"omega": 700.0}}),
    ("load pressure saturates: about standstill", {}),
    ("load pressure saturates and air 2 %: about standstill", {"oil": {"air": 0.02}}),
    (
        "all plausible ones (air 2 %)",
        {
            "oil": {"air": 0.02},
            "load": {"coulomb": 0.7},
            "leakage": {"cross": 5e-12},
            "valve": {"leakage": 2e-5, "omega": 700.0},
            "supply": {"droop": 5e8},
        },
    ),
)
"""Name and the parts that are other than `IDEAL`."""


def merged(*several: dict[str, dict[str, float]]) -> dict[str, dict[str, float]]:
    """Parts of a plant, later ones over earlier ones."""
    found: dict[str, dict[str, float]] = {}
    for parts in several:
        for group, values in parts.items():
            found[group] = {**found.get(group, {}), **values}
    return found


def exponents(progress: Callable[[float], None] = lambda _part: None) -> Numbers:
    """Exponent of omega_n over 5 to 10 MPa, by mechanism, for small signals and limit cycles."""
    rows = []
    for number, (name, parts) in enumerate(MECHANISMS):
        bench = Bench(SERVO, "motor", parts=merged(IDEAL, parts), noise=0.0)
        speed = 0.0 if name.endswith("standstill") else SPEED
        small = [bench.true(ps, speed) for ps in PRESSURES]
        row: Numbers = {
            "mechanism": name,
            "small_signal": exponent(list(PRESSURES), [each["omega_n"] for each in small]),
            "omega_n_8MPa": small[3]["omega_n"],
            "zeta_8MPa": small[3]["zeta"],
        }
        for key, e_a in (("exact", LARGE), ("exact_small", SMALL)):
            told = [
                answer(
                    bench,
                    bench.relay(RUN_S, e_a, ps=ps, speed=speed, hysteresis=0.002 * e_a),
                    "exact",
                    0.002 * e_a,
                )
                for ps in PRESSURES
            ]
            values = [each["omega_n"] for each in told]
            good = [(ps, value) for ps, value in zip(PRESSURES, values, strict=True) if value]
            row[key] = exponent(*map(list, zip(*good, strict=True))) if len(good) == len(PRESSURES) else None
            row[f"{key}_omega_n"] = values
        rows.append(row)
        progress((number + 1) / len(MECHANISMS))
    return {"pressures": PRESSURES, "speed": SPEED, "large": LARGE, "small": SMALL, "rows": rows}


def _relay(bench: Bench, ps: float, speed: float, e_a: float) -> Answer:
    """What `exact` finds; hysteresis in proportion to the amplitude."""
    hysteresis = 0.002 * e_a
    return answer(
        bench, bench.relay(RUN_S, e_a, ps=ps, speed=speed, hysteresis=hysteresis), "exact", hysteresis
    )


PLAIN: Final = {
    "valve": {"omega": FAST},
    "supply": {"ripple": 0.0, "droop": 0.0},
    "load": {"coulomb": 0.0},
}
"""What is taken out of the rigs for the map of amplitudes."""
AXES: Final = (
    (SERVO, "motor", SPEED, np.geomspace(0.05, 3.0, 8)),
    (SEAT, "roll", 0.0, np.geomspace(0.01, 1.5, 8)),
    (TAIL, "rudder", 0.0, np.geomspace(0.01, 1.5, 8)),
)
"""Rigs whose map is shown, and the amplitudes [V]."""
RUDDER_PA: Final = 7e6
"""At which two gains of the rudder are told [Pa]."""


def amplitude(progress: Callable[[float], None] = lambda _part: None) -> Numbers:
    """By pressure and e_a, how far zeta and omega_n of the limit cycle are from those of small signals.

    Friction, ripple and droop are taken out, the spool's lag is told and K_L is that of such movements: these
    are other matters, and friction would forbid small amplitudes. What remains is what orifices and load
    pressure do.
    """
    maps = []
    for number, (name, axis, speed, sizes) in enumerate(AXES):
        bench = Bench(name, axis, parts=PLAIN, noise=0.0, clean=True)
        worst = [[_error(bench, ps, speed, e_a) for e_a in sizes.tolist()] for ps in PRESSURES]
        progress((number + 1) / len(AXES))
        maps.append(
            {
                "axis": f"{name.removesuffix('-hydraulic')}: {axis}",
                "ps": PRESSURES,
                "e_a": sizes,
                "worst": worst,
                "largest_e_a": [_largest(sizes.tolist(), row) for row in worst],
                "rig_e_a": bench.view.axis.relay.e_a,
            }
        )
    rudder = Bench(TAIL, "rudder", parts=PLAIN, noise=0.0, clean=True)
    gains = {"steady": rudder.true(RUDDER_PA)["K_L"], "quick": rudder.quick_gain(RUDDER_PA, 0.0)}
    return {"within": CLOSE, "maps": maps, "rudder_gains": gains}


def _error(bench: Bench, ps: float, speed: float, e_a: float) -> float | None:
    """Largest relative difference of zeta and omega_n that `exact` finds from those of small signals."""
    true = bench.true(ps, speed)
    hysteresis = 0.006 * e_a * true["K_L"] / (true["zeta"] * true["omega_n"])
    run = bench.relay(
        SETTLES * (1.0 + true["zeta"]) / true["omega_n"], e_a, ps=ps, speed=speed, hysteresis=hysteresis
    )
    told = answer(bench, run, "exact", hysteresis)
    if told["zeta"] is None or told["omega_n"] is None:
        return None
    return max(float(abs(told[name] / true[name] - 1.0)) for name in ("zeta", "omega_n"))


def _largest(sizes: list[float], row: list[float | None]) -> float | None:
    """Largest e_a below which all errors are at most `CLOSE`; between two, by their logarithms."""
    found = None
    for k, error in enumerate(row):
        if error is None or error > CLOSE:
            break
        found = sizes[k]
        after = row[k + 1] if k + 1 < len(row) else None
        if after is not None and after > CLOSE and error > 0.0:
            part = math.log(CLOSE / error) / math.log(after / error)
            found = sizes[k] * (sizes[k + 1] / sizes[k]) ** part
    return found
