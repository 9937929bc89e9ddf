"""What the paper says to each figure, what ours shows, and where they differ: text with the numbers put in."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

Numbers = dict[str, Any]

TITLES = {
    "4": "Fig. 4: amplitude and frequency correction factors",
    "10": "Fig. 10: waves of the self-excited oscillation",
    "11": "Fig. 11: servo motor over supply pressure, 32.5 rad/s, e_a = 1.5 V",
    "12": "Fig. 12: servo motor over speed, 8 MPa, e_a = 1.5 V",
    "13": "Fig. 13: Bode plots of the servo motor, 8 MPa, 0, 70 and 133 rad/s",
    "14": "Fig. 14 and Table 2: motion seat, 7 MPa, e_a = 0.5 V",
    "15": "Fig. 15: rudder over supply pressure, e_a = 0.1 V",
    "exponent": "The open finding: how omega_n grows with supply pressure",
    "amplitude": "The amplitude question: how large e_a may be",
}
"""Of each figure, in the order of the page."""

SAYS = {
    "4": "Eq. 8 gives both factors as cubics of zeta. They come from simulation and do not depend on K_L, omega_n and "
    "e_a. The paper prints no points.",
    "10": "Noise on the speed is completely attenuated by the integrator in front of the relay; the relay puts out "
    "+-e_a with the period of the oscillation.",
    "11": "Both parameters are notably affected by the supply pressure; omega_n increases almost in proportion to it. "
    "No values are printed.",
    "12": "Parameters are found continuously from 0 to 120 rad/s; the largest speed is 140 rad/s. No values are "
    "printed.",
    "13": "Acceptable agreement between limit cycle and frequency response. No values are printed.",
    "14": "Table 2 prints pitch: zeta 0.45 (frequency response 0.41), omega_n 145 (151) rad/s; roll: 0.21 (0.24), "
    "117 (120) rad/s. The methods agree acceptably.",
    "15": "The two methods match in a reasonable manner; both parameters depend on the supply pressure. Neither values "
    "nor the range of pressures are printed: 4 to 10 MPa are taken here.",
    "exponent": "omega_n increases almost in proportion to the supply pressure (section 4): an exponent near 1. No "
    "explanation is given.",
    "amplitude": "The voltage should be large enough that friction does not stop the oscillation; 1.5, 0.5 and 0.1 V "
    "are used. An upper bound is not discussed.",
}
"""The paper's own statements, in other words."""


def shows(figure: str, n: Numbers) -> list[str]:
    """Sentences on what our rig shows, and why it differs."""
    return _SHOWS[figure](n)


def _percent(part: float) -> str:
    return f"{100.0 * part:.3g} %"


def _figure_4(n: Numbers) -> list[str]:
    off = max(
        abs(a / float(np.interp(z, n["zeta"], n["xi_exact"])) - 1.0)
        for z, a in zip(n["zeta_simulated"], n["xi_simulated"], strict=True)
    )
    return [
        f"Eq. 8 is off the exact limit cycle by up to {_percent(n['worst_xi'])} in xi and "
        f"{_percent(n['worst_Gamma'])} in Gamma, between zeta 0.1 and 5.",
        f"Simulation with a relay that sees every instant lies on the exact curves within {_percent(off)}, which is "
        "the interpolation between the curve's points.",
        "The cause is the form of Eq. 8: a cubic through a few simulated values.",
    ]


def _figure_10(n: Numbers) -> list[str]:
    return [
        f"The relay switches {n['switches']} times within 0.5 s: a cycle of {1e3 * n['cycle_s']:.3g} ms and no switch "
        f"by the speed's noise of {n['speed_noise']:g} rad/s.",
    ]


def _pressure(n: Numbers) -> list[str]:
    e = n["exponents"]
    told = ", ".join(f"{name.replace('_', ' ')} {value:.2f}" for name, value in e.items())
    return [
        f"Exponents of omega_n over supply pressure: {told}.",
        "They are far below 1: the physical rig does not show the proportion that the paper reports; see the open "
        "finding below.",
        _words_of_quality(n),
    ]


def _words_of_quality(n: Numbers) -> str:
    words = n["wave"]["quality"]
    ok = sum(word == "ok" for word in words) / max(len(words), 1)
    return f"`wave` calls {_percent(ok)} of its answers ok, the others {', '.join(sorted(set(words) - {'ok'})) or '-'}."


def _figure_12(n: Numbers) -> list[str]:
    small = n["small_signal"]
    return [
        f"By physics zeta grows from {small['zeta'][0]:.2f} at rest to {small['zeta'][-1]:.2f} at "
        f"{small['speed'][-1]:g} rad/s, while omega_n stays at {small['omega_n'][0]:.0f} rad/s: an open valve lets "
        "flow by as its pressure drop changes, and that damps.",
        "The limit cycle at 1.5 V shows less of omega_n: the relay asks for more load pressure than the supply has, "
        "and beyond zeta 1 the relay sees mostly the slower of two real poles. The spool's lag is taken for the plant's.",
        _words_of_quality(n),
    ]


def _points(n: Numbers, methods: tuple[str, ...]) -> str:
    told = []
    for method in methods:
        each = n.get(method)
        if each and each["zeta"] is not None:
            told.append(f"{method.replace('_', ' ')} {each['zeta']:.3f} / {each['omega_n']:.1f}")
    return ", ".join(told)


LAGS = (
    "Curves are Eq. 1 of each method's zeta, omega_n and K_L. The lags of spool and sensor are in the response's phase "
    "and in no curve."
)
METHODS = ("small_signal", "peaks", "exact", "wave", "two-phase")


def _figure_13(n: Numbers) -> list[str]:
    return [
        f"{speed} rad/s, zeta / omega_n: {_points(each, (*METHODS, 'response_0.3', 'response_1.5'))}."
        for speed, each in n.items()
    ] + [
        "At rest and 1.5 V the limit cycle is not the small-signal plant: load pressure is spent. At 70 and 133 rad/s "
        "zeta is so large that only the slow pole, omega_n / (2 zeta), is well told; the curves then agree in the "
        "Bode plot although zeta and omega_n differ.",
        LAGS,
    ]


def _figure_14(n: Numbers) -> list[str]:
    said = []
    for axis in ("pitch", "roll"):
        printed = n["printed"][axis]
        said.append(
            f"{axis}, zeta / omega_n: printed {printed['zeta']['SEO']} / {printed['omega_n']['SEO']:g} (response "
            f"{printed['zeta']['FR']} / {printed['omega_n']['FR']:g}); ours "
            f"{_points(n[axis], (*METHODS, 'response_0.1', 'response_0.5'))}."
        )
    return [
        *said,
        "Inertia and leakage (roll) or viscous friction (pitch) of the rig file were chosen so that `exact` finds the "
        "printed values: they prove nothing. What the response and the other methods say is a result.",
        "`exact` takes the spool's lag for the plant's and finds omega_n too low; `wave` and two phases fit a delay "
        "and come nearer to the small signals. At 0.1 V dry friction is a large part of the force.",
        LAGS,
    ]


def _exponent(n: Numbers) -> list[str]:
    rows = {row["mechanism"]: row for row in n["rows"]}
    plausible = [
        row["exact"] for name, row in rows.items() if "not plausible" not in name and row["exact"] is not None
    ]
    return [
        f"No plausible mechanism, alone or with the others, gives more than {max(plausible):.2f} in the limit cycle at "
        f"{n['large']:g} V.",
        "Air gives the largest part: its stiffness rises with pressure. Even 20 % of air at atmosphere, compressed "
        f"isothermally, gives only {rows['air 20 %, isothermal (not plausible)']['small_signal']:.2f}, since the oil "
        "itself stays as stiff as it is.",
        "Saturated load pressure adds to it: the acceleration that the relay can ask for is in proportion to the "
        "supply pressure.",
        "What is left cannot come from the physics that is modelled here. Hoses that stiffen, a pressure-dependent K_L "
        "that was taken wrong, or a supply that was not what the gauge said would be candidates; the paper has no "
        "data to decide.",
    ]


def _largest(each: Numbers) -> str:
    if not any(each["largest_e_a"]):
        return f"none of the map, least error {_percent(min(e for row in each['worst'] for e in row if e))}"
    at = zip(each["ps"], each["largest_e_a"], strict=True)
    return ", ".join(f"{ps * 1e-6:g} MPa: {'none' if e_a is None else f'{e_a:.2g} V'}" for ps, e_a in at)


def _amplitude(n: Numbers) -> list[str]:
    return [
        *(
            f"{each['axis']}, largest e_a for {_percent(n['within'])}: {_largest(each)}. The paper's is "
            f"{each['rig_e_a']:g} V."
            for each in n["maps"]
        ),
        "Friction, ripple and the supply's droop are taken out, and the spool's lag and K_L of so quick a movement are "
        "known: what the map shows is amplitude alone. The red line is where the error is 2 %.",
        "Of a single rod behind a leaking valve K_L of quick movements is not that of steady ones, since the pressure "
        "that its chambers have in common follows slowly: zeta of a limit cycle, taken with the steady K_L, is off by "
        f"the ratio of both. For the rudder at 7 MPa that is {n['rudder_gains']['quick']:.4g} over "
        f"{n['rudder_gains']['steady']:.4g} rad/s/V.",
        "The error grows with e_a: a relay holds the valve open by e_a all the time, and an open orifice damps in "
        "proportion to its opening. While e_a is less than the opening by which a valve leaks, 0.25 V of the rudder's, "
        "both edges stay open, and the error hardly grows. So two amplitudes suffice to extrapolate, which the daemon does: its "
        "`nonlinear` answers tell the largest e_a that would do.",
    ]


_SHOWS: dict[str, Callable[[Numbers], list[str]]] = {
    "4": _figure_4,
    "10": _figure_10,
    "11": _pressure,
    "12": _figure_12,
    "13": _figure_13,
    "14": _figure_14,
    "15": _pressure,
    "exponent": _exponent,
    "amplitude": _amplitude,
}
