"""What `bench/accuracy.py` varies: the plant over the tick's time, and one thing after the other about it."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

TICK = 5e-4
ZETAS = (0.1, 0.21, 0.45, 0.8, 1.0, 1.5)
TURNS = (0.02, 0.05, 0.1, 0.2)
"""omega_n Ts."""
PLANTS = ((0.21, 117.0 * TICK), (0.45, 145.0 * TICK), (0.8, 60.0 * TICK))
"""The design's: zeta and omega_n Ts."""


@dataclass(frozen=True)
class Case:
    """One line of the tables.

    Attributes:
        zeta: Damping ratio.
        turn: omega_n Ts.
        noise: White, standard deviation as a part of the limit cycle's amplitude (of speed in velocity mode).
        steps: Of the sensor, for each amplitude; 0: fine.
        jitter: Of the sampling, standard deviation in ticks.
        told: The samples' timestamps tell the jitter.
        delay: Ticks from a sample to its command's leaving.
        hysteresis: Half-width of the relay's, as a part of the amplitude without it.
        friction: Dry, as a part of K_L e_a omega_n, the scale of the load's acceleration.
        speed: Velocity mode: the sensor measures speed, the relay sees the integral of its error.
        free: What is not known beforehand besides omega_n and zeta: "K_L" or "delay".
        load: Constant, as the part of e_a that holds it.
        unequal: K_L (1 + unequal) for positive voltages, K_L (1 - unequal) for negative ones.
        bias: Behind the relay, as a part of e_a: its two levels are unequal.
        two_phase: The relay alternates between its two phases; K_L and the delay are not known.
        before: Cycles of a record before the last window, in which the start dies away.
    """

    zeta: float
    turn: float
    noise: float = 0.01
    steps: int = 0
    jitter: float = 0.0
    told: bool = True
    delay: int = 1
    hysteresis: float = 0.0
    friction: float = 0.0
    speed: bool = False
    free: str = ""
    load: float = 0.0
    unequal: float = 0.0
    bias: float = 0.0
    two_phase: bool = False
    before: int = 3

    @property
    def name(self) -> str:
        """All that differs from the plain case, as `zeta=0.45 turn=0.0725 steps=50`."""
        values = ((f.name, getattr(self, f.name), f.default) for f in fields(self))
        return " ".join(
            f"{name}={value:.6g}" if not isinstance(value, str) else f"{name}={value}"
            for name, value, default in values
            if value != default
        )


GRID = [Case(zeta, turn) for turn in TURNS for zeta in ZETAS]
"""1 % noise, one tick of delay, a fine sensor, an ideal relay."""

VARIED: dict[str, list[dict[str, object]]] = {
    "nothing": [{}],
    "noise": [{"noise": x} for x in (0.0, 0.002, 0.02, 0.05)],
    "delay": [{"delay": x} for x in (0, 2, 3)],
    "quantisation": [{"steps": 50}, {"steps": 10}, {"steps": 50, "noise": 0.0}, {"steps": 10, "noise": 0.0}],
    "jitter": [{"jitter": 0.1}, {"jitter": 0.1, "told": False}],
    "hysteresis": [{"hysteresis": x} for x in (0.1, 0.3)],
    "friction": [{"friction": x} for x in (0.005, 0.02)],
    "velocity mode": [{"speed": True}],
    "delay known to 0.3 ticks": [{"free": "delay"}],
    "K_L known to 3 %": [{"free": "K_L"}],
}
"""About each of `PLANTS`."""


def about_the_plants() -> list[tuple[str, Case]]:
    """All of `VARIED` with the name of what is varied."""
    plain = [Case(*plant) for plant in PLANTS]
    return [
        (factor, replace(case, **c)) for factor, changes in VARIED.items() for c in changes for case in plain
    ]
