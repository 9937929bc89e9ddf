"""What shakes the load."""

from __future__ import annotations

from typing import Final

from seod.diagnose.causes.cause import Cause, Wave, signed
from sim.effects import FAR

SIZE: Final = 0.05
"""Acceleration over the load pressure, in whose steps it is searched; chosen."""
NARROW: Final = 0.03
"""Radians over the longest recording by which a step of the frequency turns its end; chosen."""
SLOWEST: Final = 1e-2
"""Frequency, at least [rad/s]: ten minutes a wave; chosen."""
FASTEST_TICKS: Final = 3.0
"""Frequency times the sampling interval, at most: just below half the sampling rate, pi."""

LEAST_FORCE: Final = 1e-12
"""Of a channel's deviation [its unit]: one that stands still shows none."""
GAINS: Final = (0.1, -0.1)
"""Its movement as acceleration over the load pressure, to begin from; chosen."""

OVER_TIME: Final = Wave("omega", "time", fewest=1.0)
PERIODIC_DISTURBANCE: Final = Cause(
    name="periodic_disturbance",
    says="Something shakes the load in time: a pump's ripple, an unbalanced rotor.",
    coordinates=lambda s: OVER_TIME.coordinates(
        "periodic_disturbance", SIZE * s.pressure, NARROW / s.span_s, SLOWEST, FASTEST_TICKS / s.tick_s
    ),
    wave=OVER_TIME,
    tells_lags_apart=False,
)
MEASURED_DISTURBANCE: Final = Cause(
    name="measured_disturbance",
    says="What the recording's channel f shows acts on the load: a force, the pressure of another circuit.",
    coordinates=lambda s: (
        signed("gain", s.pressure / max(s.force, LEAST_FORCE), FAR),
        signed("zero", max(s.force, LEAST_FORCE), FAR),
    ),
    starts=lambda s: tuple((x * s.pressure / max(s.force, LEAST_FORCE), 0.0) for x in GAINS),
    searched=lambda s: s.force > 0.0,
    follows="gain",
)
DISTURBANCE: Final = (PERIODIC_DISTURBANCE, MEASURED_DISTURBANCE)
