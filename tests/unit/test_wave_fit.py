"""The fit of `wave` against positions from scipy's integrator and matrix exponentials: bound and coverage."""

from __future__ import annotations

import math

import numpy as np
import pytest
from relay_truth import E_A, K_L, PLANTS, Loop, rows
from scipy.integrate import solve_ivp
from scipy.signal import lfilter

from seod.estimate.known import Known
from seod.estimate.noise import WHITE, Noise, memory, outliers, seen_in
from seod.estimate.plant.free_motion import Dynamics
from seod.estimate.plant.response import StepwiseVoltage
from seod.estimate.wave.fit import fit
from seod.estimate.wave.misfit import NOTHING, misfit
from seod.estimate.wave.window import Window


def integrated(plant: Dynamics, t_u, u, t):
    """Position behind delay and sensor lag by an ODE solver, from rest at the first voltage."""
    w, z, lag = plant.omega_n, plant.zeta, plant.lag or 1e-9
    state, out, now = np.zeros(4), np.empty_like(t), t_u[0] + plant.delay
    for k in range(len(t_u)):
        end = t_u[k + 1] + plant.delay if k + 1 < len(t_u) else t[-1] + 1e-9
        inside = (t >= now) & (t < end)

        def slope(_t, s, drive=u[k]):
            sensor = (s[0] - s[3]) / lag if plant.lag else 0.0
            return [s[1], s[2], w * w * (drive - s[1]) - 2.0 * z * w * s[2], sensor]

        options = {"rtol": 1e-10, "atol": 1e-14, "method": "DOP853"}
        run = solve_ivp(slope, (now, end), state, t_eval=np.append(t[inside], end), **options)
        out[inside] = run.y[3 if plant.lag else 0, :-1]
        state, now = run.y[:, -1], end
    return out


def stepwise(seconds: float = 0.25):
    rng = np.random.default_rng(3)
    t_u = np.concatenate([[0.0], np.sort(rng.uniform(0.005, seconds, 11))])
    t = 0.002 + np.cumsum(rng.uniform(2e-4, 8e-4, int(seconds / 5e-4)))
    return t_u, rng.normal(size=12), t


@pytest.mark.parametrize("zeta", [0.05, 0.45, 1.0, 3.0])
@pytest.mark.parametrize(("delay", "lag"), [(0.0, 0.0), (0.0013, 0.0), (0.0007, 0.002)])
def test_the_closed_form_is_the_integrators_but_for_what_is_free(zeta, delay, lag):
    plant = Dynamics(110.0, zeta, delay, lag)
    t_u, u, t = stepwise()
    difference = integrated(plant, t_u, u, t) - StepwiseVoltage(t_u, u, t).output(plant)
    since = t - t[0]
    decay, wave = np.exp(-zeta * 110.0 * since), np.emath.sqrt(1.0 - zeta**2) * 110.0 * since
    free = [np.real(decay * np.cos(wave)), np.real(decay * np.sinc(wave / math.pi) * since)]
    columns = [np.ones_like(t), since, *free, *([np.exp(-since / lag)] if lag else [])]
    left = difference - np.column_stack(columns) @ np.linalg.lstsq(np.column_stack(columns), difference)[0]
    assert np.max(np.abs(left)) < 1e-8 * np.ptp(difference + left + 1.0 + u.max() * t)


@pytest.mark.parametrize("lag", [0.0, 0.002])
def test_the_speed_is_the_positions_derivative(lag):
    t_u, u, t = stepwise()
    t = t[np.min(np.abs(t[:, None] - t_u), axis=1) > 1e-5]
    plant, h = Dynamics(110.0, 0.45, 0.0, lag), 1e-6
    later, before = (StepwiseVoltage(t_u, u, t + s * h).output(plant) for s in (1, -1))
    speed = StepwiseVoltage(t_u, u, t, speed=True)
    assert speed.output(plant) == pytest.approx((later - before) / (2.0 * h), abs=1e-6)
    assert speed.response(plant).output == pytest.approx(speed.output(plant), abs=1e-12)


@pytest.mark.parametrize("zeta", [0.05, 0.8, 0.9999, 1.0, 1.0003, 6.0])
@pytest.mark.parametrize("lag", [0.0, 1e-3])
@pytest.mark.parametrize("speed", [False, True])
def test_derivatives_are_those_of_what_is_measured(zeta, lag, speed):
    t_u, u, t = stepwise()
    voltage, plant = StepwiseVoltage(t_u, u, t, speed), Dynamics(117.0, zeta, 7e-4, lag)
    response = voltage.response(plant)

    def change(forth: Dynamics, back: Dynamics, step: float):
        return (voltage.output(forth) - voltage.output(back)) / (2.0 * step)

    h = 1e-5
    by_omega_n = change(*(plant._replace(omega_n=117.0 * math.exp(s * h)) for s in (1, -1)), h)
    by_zeta = change(*(plant._replace(zeta=zeta * math.exp(s * h)) for s in (1, -1)), h)
    by_delay = change(*(plant._replace(delay=7e-4 + s * 1e-7) for s in (1, -1)), 1e-7)
    # a sample that a change of the voltage passes by has no derivative by the delay
    far = np.min(np.abs(t[:, None] - 7e-4 - t_u), axis=1) > 1e-6
    for mine, seen in zip(response[1:], (by_omega_n, by_zeta, by_delay), strict=True):
        assert np.max(np.abs(mine - seen)[far]) < 1e-7 * np.max(np.abs(seen))


def window(loop: Loop, seconds: float, K_L_sd: float = 0.0, delay_sd: float = 0.0, skip: int = 100) -> Window:
    feed = [r for r in rows(loop, seconds) if r.fresh]
    t, y, u, t_u = (np.array([getattr(r, name) for r in feed]) for name in ("t", "y", "u", "t_u"))
    voltage = StepwiseVoltage(t_u, u, t[skip:])
    return Window(t[skip:], y[skip:], voltage, Known(K_L, K_L_sd), Known(0.0, delay_sd))


@pytest.mark.parametrize(("zeta", "omega_n"), [*PLANTS, (0.05, 117.0), (1.0, 80.0), (1.5, 100.0)])
@pytest.mark.parametrize("changes", [{}, {"jitter": 0.5, "loss": 0.1, "load": 0.1}])
def test_without_noise_the_plant_is_found_exactly(zeta, omega_n, changes):
    found = fit(window(Loop(zeta, omega_n, 1.0, start=0.3, **changes), 0.4), 0.8 * omega_n, 1.3 * zeta)
    assert found.converged
    assert found.omega_n == pytest.approx(omega_n, rel=1e-6)
    assert found.zeta == pytest.approx(zeta, rel=1e-6)


def test_two_phases_of_voltage_tell_gain_and_delay_as_well():
    t_u, u, t = stepwise(0.6)
    y = 17.0 * integrated(Dynamics(117.0, 0.3, 0.0012), t_u, u, t)
    y += 1e-4 * np.random.default_rng(1).standard_normal(len(t))
    known = Known(15.0, math.inf), Known(0.0, math.inf)
    found = fit(Window(t[60:], y[60:], StepwiseVoltage(t_u, u, t[60:]), *known), 100.0, 0.5)
    for name, truth in (("K_L", 17.0), ("omega_n", 117.0), ("zeta", 0.3), ("delay", 0.0012)):
        assert abs(getattr(found, name) - truth) < 4.0 * found.sd(name)
    assert found.sd("K_L") < 0.01 * 17.0
    sd = np.sqrt(found.covariance().diagonal())
    assert np.max(np.abs(found.covariance() / np.outer(sd, sd))) <= 1.0 + 1e-12


def errors(base: Window, noise, count: int, plant) -> np.ndarray:
    """Errors of omega_n and zeta in standard deviations, of fits that differ in their noise alone."""
    out = []
    for k in range(count):
        y = base.y + noise(np.random.default_rng(k), len(base.y))
        found = fit(Window(base.t, y, base.voltage, base.K_L, base.delay), plant[1], plant[0])
        out.append(
            [(found.omega_n - plant[1]) / found.sd("omega_n"), (found.zeta - plant[0]) / found.sd("zeta")]
        )
    return np.array(out)


def assert_true(z: np.ndarray) -> None:
    """Mean 0, deviation 1, and 95 % within 1.96, as far as so many fits can tell (about 4 sigma)."""
    n = len(z)
    assert np.all(np.abs(z.mean(axis=0)) < 4.0 / math.sqrt(n))
    assert np.all(np.abs(z.std(axis=0) - 1.0) < 4.0 / math.sqrt(2 * n))
    assert np.all(np.mean(np.abs(z) < 1.96, axis=0) > 0.95 - 4.0 * math.sqrt(0.05 * 0.95 / n))


@pytest.mark.parametrize(("zeta", "omega_n"), PLANTS)
def test_intervals_cover_under_white_noise(zeta, omega_n):
    base = window(Loop(zeta, omega_n, 1.0), 16.0 / omega_n + 0.2)
    sigma = 0.01 * 0.5 * np.ptp(base.y)
    assert_true(errors(base, lambda rng, n: sigma * rng.standard_normal(n), 150, (zeta, omega_n)))


@pytest.mark.slow
def test_intervals_cover_under_coloured_noise_and_outliers():
    base = window(Loop(*PLANTS[1], 1.0), 0.4)
    sigma = 0.01 * 0.5 * np.ptp(base.y)

    def noise(rng, n):
        far = np.where(rng.random(n) < 0.01, 50.0 * sigma, 0.0)
        return np.asarray(lfilter([sigma], [1.0, -0.8], rng.standard_normal(n))) + far

    assert_true(errors(base, noise, 150, PLANTS[1]))


def test_what_is_known_beforehand_counts_as_much_as_it_is_known():
    loop, found = Loop(*PLANTS[1], 1.0, noise=0.01), {}
    for sd in (0.0, 0.17, math.inf):
        found[sd] = fit(window(loop, 0.5, K_L_sd=sd), 145.0, 0.45)
    assert found[0.0].sd("K_L") == 0.0
    assert 0.1 < found[0.17].sd("K_L") <= 0.17
    assert found[0.17].sd("zeta") > 2.0 * found[0.0].sd("zeta")
    assert found[math.inf].sd("K_L") > 2.0 * found[0.17].sd("K_L")


@pytest.mark.parametrize(
    "y", [np.zeros(300), np.full(300, math.nan), np.arange(300.0), np.full(300, 1e300), np.eye(300)[0]]
)
def test_nonsense_brings_no_exception(y):
    t = np.arange(300) * 5e-4
    voltage = StepwiseVoltage(t[::40], E_A * (-1.0) ** np.arange(8), t)
    found = fit(Window(t, y, voltage, Known(K_L)), 100.0, 0.5)
    assert found is None or math.isfinite(found.zeta)


def test_too_few_samples_bring_nothing():
    base = window(Loop(*PLANTS[0]), 0.2)
    assert fit(Window(base.t[:13], base.y[:13], base.voltage, base.K_L), 100.0, 0.5) is None


class TestNoise:
    def test_white_noise_has_no_memory(self):
        orders = [len(memory(np.random.default_rng(k).standard_normal(500))) for k in range(40)]
        assert sum(orders) < 8

    def test_an_autoregression_is_found(self):
        x = np.asarray(lfilter([1.0], [1.0, -1.2, 0.5], np.random.default_rng(1).standard_normal(4000)))
        assert memory(x)[:2] == pytest.approx((1.2, -0.5), abs=0.06)
        assert np.std(seen_in(x).whiten(x)) == pytest.approx(1.0, rel=0.05)

    def test_of_noise_that_hardly_forgets_few_samples_tell_how_it_does(self):
        """White noise of 1 is left; by Yule and Walker's equations it is 5."""
        left, t = [], np.arange(300.0)
        for seed in range(20):
            white = np.random.default_rng(seed).standard_normal(300)
            x = np.asarray(lfilter([1.0], np.poly([0.99, 0.95, 0.6]), white))
            x -= np.polyval(np.polyfit(t, x, 1), t)
            left.append(np.std(Noise(memory(x)).whiten(x)))
        assert np.median(left) == pytest.approx(1.0, abs=0.1)

    def test_samples_that_touch_an_outlier_do_not_count(self):
        x = np.asarray(lfilter([1.0], [1.0, -0.9], np.random.default_rng(2).standard_normal(1000)))
        x[500] += 100.0
        noise = seen_in(x)
        assert noise.rejected == 1
        assert np.max(np.abs(noise.whiten(x))) < 6.0
        assert len(noise.whiten(x)) == 1000 - len(noise.memory) - 1 - len(noise.memory)

    def test_many_outliers_are_none(self):
        assert not outliers(np.where(np.arange(100) % 5 == 0, 1e3, np.arange(100) * 1e-3)).any()

    def test_white_noise_stays_as_it_is(self):
        walk = np.cumsum(np.random.default_rng(3).standard_normal(800))
        assert WHITE.whiten(walk) is walk


class TestMisfit:
    t = np.arange(0.0, 0.22, 5e-4)

    def test_noise_of_any_colour_seldom_looks_as_if_it_repeated(self):
        chances = []
        for k in range(200):
            white = np.random.default_rng(k).standard_normal(len(self.t))
            noise = white if k % 2 else np.asarray(lfilter([1.0], [1.0, -0.9], white))
            wave = np.exp(2j * math.pi / 0.0535 * self.t)
            taken = np.column_stack([wave.real, wave.imag])  # as a fit takes two unknowns from its residual
            chances.append(misfit(self.t, noise - taken @ np.linalg.lstsq(taken, noise)[0], 0.0535).chance)
        assert sum(c < 0.05 for c in chances) < 25
        assert min(chances) > 1e-4

    def test_what_repeats_is_measured(self):
        noise = 0.1 * np.random.default_rng(1).standard_normal(len(self.t))
        third = math.sqrt(2.0) * np.sin(3.0 * 2.0 * math.pi / 0.0535 * self.t)
        seen = misfit(self.t, noise + third, 0.0535)
        assert seen.chance < 1e-9
        assert seen.size == pytest.approx(1.0, rel=0.1)

    def test_less_than_two_cycles_tell_nothing(self):
        assert misfit(self.t, np.sin(self.t), 0.2) == NOTHING
