"""The simulated plant written apart, from docs/model.md alone: an ODE with modes, integrated by scipy.

`Plant` knows in which branch of each law it is (sticking, at a stop, in contact, beside the overlap),
integrates until a branch ends (DOP853, dense output), and goes on in the next. Slow and strict: it is what
the compiled kernel is held against.
"""

from __future__ import annotations

import math

import numpy as np
from plant_laws import ACCELERATION, BRISTLE, LAGGED, PLACE, PLACE2, SPEED, SPEED2, SPOOL, SPOOL_SPEED, Laws
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import brentq

RTOL = 1e-10


class Plant(Laws):
    def __init__(
        self,
        K_L,
        omega_n,
        zeta,
        effects=None,
        *,
        stops=(-math.inf, math.inf),
        sees_speed=False,
        t=0.0,
        position=0.0,
    ):
        super().__init__(K_L, omega_n, zeta, effects, t)
        self.t, self.stops, self.sees_speed = t, stops, sees_speed
        self.played = 0.0  # the command behind saturation and hysteresis
        self.fastest = self.of("valve_rate_limit", "rate")
        lag, omega = self.of("valve_lag", "time"), self.of("spool_inertia", "omega")
        swings = lag > 0.0 and math.isinf(self.fastest) and math.isfinite(omega)
        self.spool_matrix = np.array([[0.0, 1.0], [-(omega**2), -lag * omega**2]]) if swings else None
        self.ramping = 0  # where to the spool goes as fast as it can
        self.behind = position  # behind the backlash, while its gap is open
        self.contact = self.at_stop = 0
        self.gap = self.of("backlash", "gap")
        level = self.of("coulomb_friction", "level") + self.of("stribeck_friction", "level")
        self.bristles = self.of("lugre_friction", "stiffness") > 0.0
        self.dry = level > 0.0 and not self.bristles
        self.breakaway = 0.0 if self.bristles else level
        self.slides = 0
        self.w = np.zeros(9)
        self.w[[PLACE, PLACE2]] = position
        self.w[ACCELERATION] = self.spring(position)
        self.w[LAGGED] = 0.0 if sees_speed else self.unsigned(self.encoder(position))
        self.segments = 0

    # modes

    @property
    def held(self):
        return bool(self.at_stop) or (self.dry and self.slides == 0)

    def after_play(self, y):
        if self.gap == 0.0:
            return y
        return y - self.contact * self.gap / 2.0 if self.contact else self.behind

    def seen(self, w):
        """What the sensor sees before its lag."""
        y3 = self.after_play(w[PLACE])
        if not self.sees_speed:
            return self.encoder(y3)
        touches = self.gap == 0.0 or self.contact != 0
        return w[SPEED] * self.encoder_slope(y3) if touches else 0.0

    def reading(self, w):
        return w[LAGGED] if self.of("sensor_lag", "time") else self.unsigned(self.seen(w))

    def unsigned(self, seen):
        """What a sensor without sign makes of what it sees."""
        at, power = self.of("rectified_sensor", "range"), self.of("rectified_sensor", "power")
        shown = at * abs(seen / at) ** power
        return shown if seen > 0.0 else (2.0 * self.of("rectified_sensor", "part") - 1.0) * shown

    def slope(self, side):
        lag, sensor_lag = self.of("valve_lag", "time"), self.of("sensor_lag", "time")
        air = self.of("pressure_dependent_stiffness", "air")
        stiffness = (1.0 + air) / (1.0 + air / self.supply**2)

        def f(t, w):
            d = np.zeros(9)
            gain, omega, zeta = self.drifted(t)
            v, a = w[SPEED], w[ACCELERATION]
            q = self.flow(gain, self.opening(w[SPOOL], side), side, a)
            d[SPOOL] = (self.played - w[SPOOL]) / lag if lag else 0.0
            if self.spool_matrix is not None:
                off = np.array([w[SPOOL] - self.played, w[SPOOL_SPEED]])
                d[[SPOOL, SPOOL_SPEED]] = self.spool_matrix @ off
            if self.ramping:
                d[SPOOL] = self.ramping * self.fastest
            rubbed = self.of("viscous_friction", "share")
            d[ACCELERATION] = stiffness * (omega**2 * (q - v) - (1.0 - rubbed) * 2.0 * zeta * omega * a)
            d[PLACE] = v
            d[SPEED2], d[PLACE2] = self.coupling(w), w[SPEED2]
            if not self.held:
                rubs = rubbed * 2.0 * zeta * omega * v
                d[SPEED] = (1.0 + self.inertia) * (self.drive(t, w) - rubs - self.resistance(w, d))
            d[LAGGED] = (self.unsigned(self.seen(w)) - w[LAGGED]) / sensor_lag if sensor_lag else 0.0
            return d

        return f

    def resistance(self, w, d):
        """Friction on the moving load; sets the bristles' rate in `d`."""
        if self.bristles:
            d[BRISTLE] = self.bristle_rate(w[SPEED], w[BRISTLE])
            stiff = self.of("lugre_friction", "stiffness") * w[BRISTLE]
            return stiff + self.of("lugre_friction", "damping") * d[BRISTLE]
        return self.friction(w[SPEED], self.slides) if self.dry else 0.0

    def endings(self, t_end):
        """(function of t and w, direction, what to do then) for each way out of the present branches."""
        ways = []
        low, high = self.stops
        if self.held:
            if self.at_stop <= 0:
                ways.append((lambda t, w: self.drive(t, w) - self.breakaway, 1, lambda: self.let_go(1)))
            if self.at_stop >= 0:
                ways.append((lambda t, w: self.drive(t, w) + self.breakaway, -1, lambda: self.let_go(-1)))
            return ways
        if self.dry:
            ways.append((lambda t, w: w[SPEED], -self.slides, self.arrest))
        if math.isfinite(low):
            ways.append((lambda t, w: w[PLACE] - low, -1, lambda: self.hit(-1)))
        if math.isfinite(high):
            ways.append((lambda t, w: w[PLACE] - high, 1, lambda: self.hit(1)))
        if self.gap and self.contact:
            ways.append((lambda t, w: w[SPEED], -self.contact, self.part))
        elif self.gap:
            ways += [(self.clearance(side), side, lambda side=side: self.touch(side)) for side in (-1, 1)]
        return ways

    def clearance(self, side):
        return lambda t, w: w[PLACE] - side * self.gap / 2.0 - self.behind

    def part(self):
        self.behind = self.after_play(self.w[PLACE])
        self.contact = 0

    def touch(self, side):
        self.contact = side

    def let_go(self, direction):
        self.at_stop = 0
        self.slides = direction if self.dry else 0

    def stand(self):
        self.w[[SPEED, BRISTLE]] = 0.0
        self.slides = 0
        self.part()

    def arrest(self):
        self.stand()
        drive = self.drive(self.t, self.w)
        if abs(drive) > self.breakaway:
            self.let_go(1 if drive > 0.0 else -1)

    def hit(self, side):
        self.w[PLACE] = self.stops[0 if side < 0 else 1]
        self.stand()
        self.at_stop = side
        if side * self.drive(self.t, self.w) < -self.breakaway:
            self.let_go(-side)

    # time

    def command(self, volts):
        limit, width = self.of("valve_saturation", "limit"), self.of("valve_hysteresis", "half_width")
        volts = self.worth(min(max(volts, -limit), limit))
        self.played = min(max(self.played, volts - width), volts + width)
        if not self.of("valve_lag", "time") and self.fastest == math.inf:
            self.w[SPOOL] = self.played

    def ramp_s(self):
        """How long the spool goes as fast as it can: until its lag alone asks for less."""
        if self.fastest == math.inf:
            return 0.0
        beyond = abs(self.played - self.w[SPOOL]) - self.fastest * self.of("valve_lag", "time")
        return beyond / self.fastest if beyond > 1e-12 else 0.0

    def spool_after(self, dt):
        if self.spool_matrix is not None:
            off = np.array([self.w[SPOOL] - self.played, self.w[SPOOL_SPEED]])
            return self.played + (expm(self.spool_matrix * dt) @ off)[0]
        lag, ramp, here = self.of("valve_lag", "time"), self.ramp_s(), self.w[SPOOL]
        way = np.sign(self.played - here)
        there = here + way * self.fastest * min(dt, ramp) if ramp else here
        if dt <= ramp:
            return there
        return self.played + (there - self.played) * math.exp((ramp - dt) / lag) if lag else self.played

    def passes(self, edge, within):
        return brentq(lambda dt: self.spool_after(dt) - edge, 0.0, within, xtol=1e-16)

    def edges(self, t_end):
        """Times until `t_end` at which the spool passes an edge of the overlap, or its ramp ends."""
        here, times = self.w[SPOOL], [self.t + self.ramp_s()]
        for side in (-1, 1):
            edge = self.of("null_shift", "voltage") + side * self.of("valve_deadband", "half_width")
            there = self.spool_after(t_end - self.t)
            if here != self.spool_after(0.5 * (t_end - self.t)) and (here - edge) * (there - edge) < 0.0:
                times.append(self.t + self.passes(edge, t_end - self.t))
        return sorted(t for t in times if self.t < t < t_end)

    def side_between(self, t_end):
        spool = self.spool_after(0.5 * (t_end - self.t))
        self.ramping = np.sign(self.played - self.w[SPOOL]) if self.ramp_s() > 0.5 * (t_end - self.t) else 0
        if not self.ramping and not self.of("valve_lag", "time"):
            self.w[SPOOL] = self.played
        e, d = spool - self.of("null_shift", "voltage"), self.of("valve_deadband", "half_width")
        return 1 if e > d else -1 if e < -d else 0

    def advance(self, t_end, times=(), watch=None):
        """Go on to `t_end`; readings at `times`. Stops early where `watch(t, reading)` rises through 0."""
        readings = np.full(len(times), np.nan)
        while self.t < t_end:
            for edge in [*self.edges(t_end), t_end]:
                side = self.side_between(edge)
                while self.t < edge:
                    if self.segment(edge, side, times, readings, watch):
                        return readings
        return readings

    def segment(self, t_end, side, times, readings, watch):
        """Integrate until a branch ends, at most to `t_end`; True where `watch` ended it."""
        self.segments += 1
        if self.segments > 20000:
            raise RuntimeError(f"no progress at t = {self.t}")
        ways = self.endings(t_end)
        if watch:
            ways.append((lambda t, w: watch(t, self.reading(w)), 1, None))
        events = [ending(way) for way, _, _ in ways]
        for event, (_, direction, _) in zip(events, ways, strict=True):
            event.terminal, event.direction = True, direction
        speed, place = self.K_L, self.K_L / self.omega_n
        scale = np.array([1.0, speed * self.omega_n, speed, place, speed, place, place, place, self.omega_n])
        run = solve_ivp(
            self.slope(side), (self.t, t_end), self.w, method="DOP853", rtol=RTOL, atol=1e-12 * scale,
            events=events, dense_output=len(times) > 0, max_step=0.2 / self.omega_n,
        )  # fmt: skip
        for k in np.flatnonzero((np.asarray(times) >= self.t) & (np.asarray(times) <= run.t[-1])):
            readings[k] = self.reading(run.sol(times[k]))
        self.t, self.w = run.t[-1], run.y[:, -1].copy()
        for way, found in zip(ways, run.t_events, strict=True):
            if len(found):
                if way[2] is None:
                    return True
                way[2]()
        return False


def ending(way):
    def event(t, w):
        return way(t, w)

    return event
