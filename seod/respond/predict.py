"""What limit cycle and response ought to show: both, simulated on the plant of the rig file with its effects.

A relay of large amplitude and small tones see two different linear plants where flow, pressure or friction
are not linear. The kernel knows these laws; the same estimators read its recordings.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from seod.respond.record import RespondError, Segment
from seod.respond.relay import recorded
from seod.respond.response import respond
from seod.simulate.options import Options
from seod.simulate.procedure import Simulation

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.config.model import RigConfig
    from seod.respond.design import Excitation
    from seod.respond.fit import Plant
    from seod.respond.record import Array

_RELAY_S: Final = 3.0
_SETTLED_S: Final = 1.0
_PERIODS: Final = 3
"""Simulated without noise: no more are needed."""


@dataclass(frozen=True)
class Prediction:
    """Plants that the relay and the response would tell."""

    limit_cycle: Plant
    response: Plant


def predict(config: RigConfig, axis: str, drives: Sequence[Excitation], e_a: float, K_L: float) -> Prediction:
    """Simulate both.

    Args:
        config: A rig file with a `simulation:` section.
        axis: Which one.
        drives: As they are put out on the rig.
        e_a: Amplitude of the relay [V].
        K_L: Gain that the estimate assumes [unit/s/V].

    Raises:
        RespondError: The simulation does not allow it; says why.
    """
    try:
        return Prediction(
            _limit_cycle(config, axis, e_a, K_L), respond([_tones(config, axis, d) for d in drives]).fit.plant
        )
    except ValueError as error:
        raise RespondError(f"no prediction: {error}") from error


def _limit_cycle(config: RigConfig, axis: str, e_a: float, K_L: float) -> Plant:
    run = Simulation(config, axis, Options("relay", amplitude=e_a, duration=_RELAY_S, noise=0.0)).run()
    late = run["t"] >= _SETTLED_S
    t, u, y, t_u = (run[name][late] for name in ("t", "u", "y", "t_u"))
    speed = config.axes[axis].mode == "velocity"
    return recorded("relay", t, u, y, t_u, "velocity" if speed else "position", K_L, 0.0).plant


def _tones(config: RigConfig, axis: str, drive: Excitation) -> Segment:
    duration = drive.settling + (_PERIODS + 1) * drive.period
    simulation = Simulation(config, axis, Options("sine", amplitude=0.0, duration=duration, noise=0.0))
    simulation.signal = simulation.offset + _volts(drive, simulation.t)
    run = simulation.run()
    output = "velocity" if config.axes[axis].mode == "velocity" else "position"
    whole = Segment.of(axis, run["t"], run["u"], run["y"], run["t_u"], output=output, period=drive.period)
    return whole.after(drive.settling)


def _volts(drive: Excitation, t: Array) -> Array:
    hertz, amplitude, phase = np.array(drive.tones).T
    return np.asarray(np.sin(2.0 * np.pi * np.outer(t, hertz) + phase) @ amplitude)
