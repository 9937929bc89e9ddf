"""What a simulated recording is and what truly was in it, for whoever has to find that out."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from sim.truth import numbers

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from seod.simulate.procedure import Simulation


def summary(simulation: Simulation, columns: dict[str, NDArray[np.float64]]) -> dict[str, Any]:
    """JSON-able; K_L in the axis' unit, parameters of effects in the plant's."""
    t, y = columns["t"], columns["y"]
    velocity = simulation.view.axis.mode == "velocity"
    return {
        "rig": simulation.config.rig,
        "axis": simulation.name,
        "output": "velocity" if velocity else "position",
        "rows": len(t),
        "missing": int(np.isnan(y).sum()),
        "duration": float(t[-1] - t[0]),
        "excitation": simulation.options.excitation,
        "seed": simulation.seed,
        "noise": simulation.experiment.noise * abs(simulation.view.slope),
        "truth": truth(simulation),
    }


def truth(simulation: Simulation) -> dict[str, Any]:
    """K_L [axis unit/s/V], omega_n [rad/s], zeta and effects of the plant; what it is to small signals."""
    plant, unit = simulation.view.plant, abs(simulation.view.slope * simulation.view.per_volt)
    effects = {name: values for name, values in plant.effects.items() if values}
    return {
        "K_L": plant.K_L * unit,
        "omega_n": plant.omega_n,
        "zeta": plant.zeta,
        "effects": effects,
        "small_signal": _small_signal(simulation, unit),
    }


def _small_signal(simulation: Simulation, unit: float) -> dict[str, float | str | None]:
    """At the beginning, about the axis' reference; null with a reason where there is nothing of the kind."""
    experiment, axis = simulation.experiment, simulation.view.axis
    at = {
        "speed": (axis.reference or 0.0) / simulation.view.slope,
        "position": simulation.view.plant.position,
        "supply": float(experiment.supply[0]) if len(experiment.supply) else 1.0,
        "warmth": float(experiment.warmth[0]) if len(experiment.warmth) else 0.0,
    }
    try:
        values = numbers(simulation.experiment.plant, **at)
    except ValueError as error:
        return {"K_L": None, "omega_n": None, "zeta": None, "why": str(error)}
    values |= {"K_L": values["K_L"] * unit, "delay": _delay(simulation)}
    return {name: value if math.isfinite(value) else None for name, value in values.items()}


def _delay(simulation: Simulation) -> float:
    """From the command to the valve [s]."""
    p = simulation.experiment.p
    names = p.dtype.names or ()
    return float(p["valve_delay" if "valve_delay" in names else "transport_delay_time"][0])
