"""The response to any voltage: truth by matrix exponentials, one interval after the other."""

import numpy as np
import pytest
from scipy.linalg import expm

from seod.estimate.plant.free_motion import Dynamics, free_motion
from seod.identify.drive import Drive

OMEGA_N = 80.0


def integrated(zeta, delay, t_u, u, t, hold):
    """Velocity and position at `t`, from rest; states: position, speed, acceleration, u, u'."""
    w = OMEGA_N
    a = np.zeros((5, 5))
    a[0, 1] = a[1, 2] = a[3, 4] = 1.0
    a[2, 1:4] = -w * w, -2.0 * zeta * w, w * w
    at = t_u + delay
    slopes = np.append(np.diff(u) / np.diff(t_u), 0.0) if hold == "first" else np.zeros(len(u))
    state, now, out = np.array([0.0, 0.0, 0.0, u[0], slopes[0]]), at[0], []
    events = sorted([(when, 0, k) for k, when in enumerate(at)] + [(when, 1, k) for k, when in enumerate(t)])
    for when, kind, k in events:
        if when > now:
            state, now = expm(a * (when - now)) @ state, when
        if kind == 0:
            state[3:] = u[k], slopes[k]
        else:
            out.append(state[:2].copy())
    return np.array(out)


@pytest.mark.parametrize("hold", ["zero", "first"])
@pytest.mark.parametrize("zeta", [0.05, 0.6, 1.0, 1.0 + 1e-9, 4.0, 25.0])
def test_it_is_the_plant_s_but_for_a_start_that_the_fit_takes_up(zeta, hold):
    rng = np.random.default_rng(3)
    t_u = np.cumsum(rng.uniform(0.0005, 0.006, 60))
    u = np.repeat(rng.uniform(-1.0, 1.0, 30), 2)
    t = np.sort(rng.uniform(t_u[0] + 0.003, t_u[-1], 80))
    plant = Dynamics(OMEGA_N, zeta, 0.0023)
    position, velocity = integrated(zeta, 0.0023, t_u, u, t, hold).T
    drive = Drive(t_u, u, t, hold)
    cosine, sine = free_motion(plant, t - t[0])
    start = [cosine, OMEGA_N * sine]
    for truth, response, columns in (
        (velocity, drive.velocity(plant), start),
        (position, drive.position(plant), [*start, np.ones_like(t), t]),
    ):
        basis = np.linalg.qr(np.stack(columns, axis=1))[0]
        left = truth - response
        left -= basis @ (basis.T @ left)
        assert np.abs(left).max() < 1e-7 * np.std(truth)


def test_other_sample_times_see_the_same_voltage():
    t = np.arange(200) * 0.001
    u = np.sign(np.sin(60.0 * t)) + 0.1
    plant = Dynamics(OMEGA_N, 0.4)
    drive = Drive(t, u, t)
    assert drive.seen_at(t[::7]).position(plant) == pytest.approx(drive.position(plant)[::7])
