"""Effects of a wanted strength: parameters by cause as a number grows, in proportion to what the rig does."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from hidden_plant import OFF_LIST

LISTED = (
    "transport_delay",
    "valve_lag", "valve_deadband", "valve_hysteresis", "valve_saturation", "asymmetric_gain",
    "square_root_flow", "coulomb_friction", "stribeck_friction", "load_spring", "load_bias", "backlash",
    "sensor_lag", "sensor_quantization", "periodic_disturbance", "position_ripple", "parameter_drift",
    "pressure_dependent_stiffness", "load_resonance", "valve_rate_limit", "sensor_nonlinearity",
    "static_valve_map",
)  # fmt: skip
RECTIFIED, HELD, MEASURED = "rectified_sensor", "held_readings", "measured_disturbance"
ALONE = (RECTIFIED, HELD, MEASURED)
"""Never hidden beside another one: they leave nearly all of the movement, show in the samples, or have a
channel that a refit of the others lacks."""
ELSEWHERE = ("null_shift",)
"""Hidden in records of its own (`test_null_behind_orifices`): it needs a bent valve."""
DEFECTS = ("outliers", "missing_samples", "timing_jitter")
BRISTLES = "lugre_friction"
"""Truth behind a Coulomb friction: bristles that give way."""
SPOOL = "spool_inertia"
"""Truth behind a valve's lag: a spool of second order."""
NAMED = {BRISTLES: "coulomb_friction", SPOOL: "valve_lag"}
"""What a diagnosis names in their place."""
UNLISTED = OFF_LIST


@dataclass(frozen=True)
class Sizes:
    """Of a run without the effect: rms speed, acceleration and position about its mean, its range, the volts,
    and the rms slope of what is read."""

    speed: float
    acceleration: float
    place: float
    span: float
    volts: float
    peak: float
    slope: float


def sizes(y, u, tick, *, sees_speed) -> Sizes:
    place = np.cumsum(y) * tick if sees_speed else y
    speed = y if sees_speed else np.gradient(y, tick)
    return Sizes(
        float(np.std(speed)) or 1.0,
        float(np.std(np.gradient(speed, tick))) or 1.0,
        float(np.std(place)) or 1.0,
        float(np.ptp(place)) or 1.0,
        float(np.std(u)) or 1.0,
        float(np.max(np.abs(u))) or 1.0,
        float(np.std(np.gradient(y, tick))) or 1.0,
    )


def drawn(cause: str, random) -> dict[str, float]:
    """What of a cause does not grow with its strength."""
    return {
        "sign": float(random.choice([-1.0, 1.0])),
        "which": float(random.integers(3)),
        "phase": float(random.uniform(-3.0, 3.0)),
        "ratio": float(np.exp(random.uniform(0.0, 1.0))),
        "tone": float(np.exp(random.uniform(np.log(0.3), np.log(3.0)))),
        "waves": float(random.uniform(1.5, 8.0)),
    }


def effects_of(cause: str, s: float, d: dict[str, float], z: Sizes, omega_n: float, duration: float):
    """Values by cause and parameter for the strength `s`, 0 to about 1."""
    f = z.acceleration * s
    waves = 0.17 + 0.115 * (d["waves"] - 1.5)
    curves = (
        {"amplitude": 0.1 * s * z.span, "wavenumber": 2.0 * math.pi * waves / z.span, "phase": d["phase"]},
        {"lever": 2.0 * math.sqrt(s) / z.span, "lever_at": 0.1 * d["phase"] * z.span},
        {"parabola": 0.4 * s * d["sign"] / z.span},
    )
    gains = np.exp(s * np.random.default_rng(round(1e6 * d["waves"])).uniform(-1.2, 1.2, 6))
    knots = {"at_1": (0.25 + 0.06 * d["ratio"]) * z.peak, "at_2": (0.6 + 0.05 * d["phase"]) * z.peak}
    ways = (f"{way}_{k}" for way in ("up", "down") for k in (1, 2, 3))
    maps = (dict(zip(ways, map(float, gains), strict=True)) | knots, {"progress": 3.0 * s / z.peak})
    simple = {
        "transport_delay": {"time": min(s / omega_n, 0.05)},
        "valve_lag": {"time": s / omega_n},
        "valve_rate_limit": {"rate": z.peak * omega_n / (3.0 * s)},
        "valve_deadband": {"half_width": 0.6 * s * z.volts},
        "static_valve_map": maps[int(d["which"] == 2.0)],
        "valve_hysteresis": {"half_width": 0.6 * s * z.volts},
        "valve_saturation": {"limit": z.peak * (1.0 - 0.7 * s)},
        "asymmetric_gain": {"ratio": 0.6 * s * d["sign"]},
        "square_root_flow": {"supply": 2.0 * z.acceleration / s},
        "coulomb_friction": {"level": f},
        "stribeck_friction": {"level": f, "speed": 0.3 * d["ratio"] * z.speed},
        "load_spring": {"stiffness": s * omega_n**2, "centre": 0.0},
        "load_bias": {"acceleration": f * d["sign"]},
        "backlash": {"gap": 2.0 * s * z.speed / omega_n},
        "sensor_lag": {"time": s / omega_n},
        "sensor_quantization": {"step": s * z.place},
        "periodic_disturbance": {
            "amplitude": 2.0 * f, "omega": d["tone"] * omega_n, "phase": d["phase"],
        },
        "position_ripple": {
            "amplitude": 0.3 * s * z.span / d["waves"], "wavenumber": 2.0 * math.pi * d["waves"] / z.span,
            "phase": d["phase"],
        },
        "sensor_nonlinearity": curves[int(d["which"])],
        "parameter_drift": {("K_L", "omega_n", "zeta")[int(d["which"])]: 0.6 * s * d["sign"] / duration},
        "pressure_dependent_stiffness": {"air": 3.0 * s},
        "load_resonance": {"inertia": s, "omega": 1.5 * d["ratio"] * omega_n, "zeta": 0.05},
        "drag": {"strength": 2.0 * f / z.speed**2},
        "hardening": {"strength": 5.0 * s * omega_n**2 / z.span**2},
        "relief": {"strength": 2.0 * z.acceleration * (1.0 - 0.9 * s)},
        "progressive": {"strength": 3.0 * s / z.peak},
        "volume": {"strength": 6.0 * s / z.span},
        "curved": {"strength": 2.0 * s / z.span},
        "gusts": {"strength": 3.0 * f},
        RECTIFIED: {"part": 1.0},
        HELD: {"time": s / omega_n},
        MEASURED: {"gain": 3.0 * f * d["sign"]},
    }  # fmt: skip
    if cause == BRISTLES:
        stiff = f / (0.005 * z.speed / omega_n)
        bristles = {"stiffness": stiff, "damping": 0.5 * math.sqrt(stiff)}
        return {"coulomb_friction": {"level": f}, "lugre_friction": bristles}
    if cause == SPOOL:
        time = simple["valve_lag"]["time"]
        return {"valve_lag": {"time": time}, "spool_inertia": {"omega": 1.6 / time}}
    return {cause: simple[cause]}
