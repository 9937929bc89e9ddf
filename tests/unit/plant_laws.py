"""The laws of the simulated plant as docs/model.md writes them, apart from `sim`; for `plant_truth`."""

from __future__ import annotations

import math
from functools import cache
from itertools import pairwise

import numpy as np
from scipy import special

from sim.effects import EFFECTS

SPOOL, ACCELERATION, SPEED, PLACE, SPEED2, PLACE2, BRISTLE, LAGGED, SPOOL_SPEED = range(9)
SOFT = 0.01  # epsilon of the orifice


def signed_root(drop: float) -> float:
    return drop * ((1.0 + SOFT**2) / (drop**2 + SOFT**2)) ** 0.25


@cache
def legendre(n):
    """The polynomial and its slope."""
    polynomial = special.legendre(n)
    return polynomial, polynomial.deriv()


class Effects:
    """Values by effect and parameter; what is not given is null."""

    def __init__(self, given):
        self._values = {
            (name, each.name): given.get(name, {}).get(each.name, each.null)
            for name, effect in EFFECTS.items()
            for each in effect.parameters
        }

    def __call__(self, name: str, parameter: str) -> float:
        return self._values[name, parameter]


class Laws:
    """Of a plant with these effects; `w` is a state, in the order of the numbers above."""

    def __init__(self, K_L, omega_n, zeta, effects, start):
        self.K_L, self.omega_n, self.zeta, self.start = K_L, omega_n, zeta, start
        self.of = Effects(effects or {})
        self.inertia = self.of("load_resonance", "inertia")
        self.drifts = "parameter_drift" in (effects or {})
        self.supply, self.warmth, self.force = 1.0, 0.0, 0.0

    def spring(self, y):
        centre = self.of("load_spring", "centre")
        return self.of("load_bias", "acceleration") + self.of("load_spring", "stiffness") * (y - centre)

    def load(self, t, y):
        of = self.of
        angle = of("periodic_disturbance", "omega") * (t - self.start) + of("periodic_disturbance", "phase")
        pushed = of("measured_disturbance", "gain") * (self.force - of("measured_disturbance", "zero"))
        grown = of("load_bias", "drift") * (t - self.start)
        return self.spring(y) + grown - of("periodic_disturbance", "amplitude") * math.sin(angle) - pushed

    def drifted(self, t):
        def factor(name):
            slow = self.of("parameter_drift", name) * (t - self.start)
            return max(0.05, 1.0 + slow + self.of("parameter_drift", name + "_thermal") * self.warmth)

        if not self.drifts:
            return self.K_L, self.omega_n, self.zeta
        return self.K_L * factor("K_L"), self.omega_n * factor("omega_n"), self.zeta * factor("zeta")

    def worth(self, volts):
        """Of a command, where the valve's map is one of commands."""
        return volts if self.of("static_valve_map", "at_ports") else self.mapped(volts)

    def mapped(self, volts):
        """By the valve's map: its slope is made of steps, each drawn out over its corner."""
        name, full = "static_valve_map", self.of("static_valve_map", "range")
        if math.isinf(full):
            return volts
        places = np.array([0.0, self.of(name, "knot_1"), self.of(name, "knot_2"), 1.0])
        bends = [0.0, self.of(name, "bend_1"), self.of(name, "bend_2"), 0.0]
        tilts = [0.0, *(self.of(name, f"tilt_{k}") for k in (1, 2, 3))]
        part = min(abs(volts) / full, 1.0)
        bend, tilt = (self.drawn_out(places, each, part) for each in (bends, tilts))
        return volts + tilt + (bend if volts > 0.0 else -bend)

    def drawn_out(self, places, knots, part):
        """Integral of the slope from 0 to `part`: half of a corner's change lies before it, half behind."""
        slopes, total = np.diff(knots) / np.diff(places), 0.0
        widths = self.of("static_valve_map", "rounding") * np.minimum(places, 1.0 - places)[1:3]
        breaks = np.unique(np.clip([0.0, part, *(places[1:3] - widths), *(places[1:3] + widths)], 0.0, part))
        for low, high in pairwise(breaks):
            middle = 0.5 * (low + high)
            shares = [
                float(middle > at)
                if wide == 0.0
                else float(np.clip(0.5 + 0.5 * (middle - at) / wide, 0.0, 1.0))
                for at, wide in zip(places[1:3], widths, strict=True)
            ]
            total += (high - low) * (slopes[0] + np.dot(np.diff(slopes), shares))
        return total

    def opening(self, spool, side):
        """Of the branch `side` of the overlap: -1, 0, 1."""
        e = spool - self.of("null_shift", "voltage")
        beyond = (e - side * self.of("valve_deadband", "half_width")) * abs(side)
        if self.of("static_valve_map", "at_ports"):
            beyond = self.mapped(beyond)
        return beyond * (1.0 + side * self.of("asymmetric_gain", "ratio"))

    def flow(self, gain, opened, side, acceleration):
        full = self.of("square_root_flow", "supply")
        if math.isinf(full):
            return gain * opened
        drop = 1.0 - side * acceleration / (full * self.supply)
        return gain * opened * math.sqrt(self.supply) * signed_root(drop)

    def friction(self, v, direction):
        bump = self.of("stribeck_friction", "level")
        bump *= math.exp(-((v / self.of("stribeck_friction", "speed")) ** 2))
        return direction * (self.of("coulomb_friction", "level") + bump)

    def bristle_rate(self, v, z):
        return v - self.of("lugre_friction", "stiffness") * abs(v) * z / self.friction(v, 1.0)

    def coupling(self, w):
        """Acceleration of the second inertia."""
        if not self.inertia:
            return 0.0
        omega, zeta = self.of("load_resonance", "omega"), self.of("load_resonance", "zeta")
        spring = omega**2 * (w[PLACE] - w[PLACE2])
        return spring + 2.0 * zeta * omega * (w[SPEED] - w[SPEED2])

    def drive(self, t, w):
        """What the first inertia would be accelerated by without friction, over 1 + inertia."""
        drawn = self.inertia / (1.0 + self.inertia) * self.coupling(w)
        return w[ACCELERATION] - self.load(t, w[PLACE]) - drawn

    def encoder(self, y):
        of = self.of
        angle = of("position_ripple", "wavenumber") * y + of("position_ripple", "phase")
        return y + of("position_ripple", "amplitude") * math.sin(angle) + self.curve(y)[0]

    def encoder_slope(self, y):
        of = self.of
        k = of("position_ripple", "wavenumber")
        wave = of("position_ripple", "amplitude") * k * math.cos(k * y + of("position_ripple", "phase"))
        return 1.0 + wave + self.curve(y)[1]

    def curve(self, y):
        """The sensor's curve and its slope: scipy's Legendre polynomials, straight beyond the travel."""
        name = "sensor_nonlinearity"
        along = (y - self.of(name, "centre")) / self.of(name, "half")
        z, value, rises = min(max(along, -1.0), 1.0), 0.0, 0.0
        for n in range(2, 7):
            size = self.of(name, f"order_{n}")
            if size:
                polynomial, slope = legendre(n)
                value += size * polynomial(z)
                rises += size * slope(z)
        return value + rises * (along - z), rises / self.of(name, "half")
