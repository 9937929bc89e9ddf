"""Recordings of a simulated plant: against its closed form, with its sensor, seeds and defects."""

import math

import numpy as np
import pytest
from linear_plant import LinearPlant

from sim.config import PlantConfig
from sim.experiment import Experiment, Relay, count_size, plant_record, sensor_range
from sim.sensors import make_sensor

TICK = 5e-4
BASE = {"input": "valve", "output": "angle", "K_L": 17.0, "omega_n": 117.0, "zeta": 0.21}


def plant(**values):
    return PlantConfig.model_validate({**BASE, **values})


def ticks(n):
    return np.arange(n) * TICK


def test_given_commands_move_the_plant_as_its_closed_form_says():
    t = ticks(600)
    u = np.sign(np.sin(40.0 * t)) * 0.5
    found = Experiment(plant(position=0.3), t).run_given(u)
    truth, y = LinearPlant(17.0, 117.0, 0.21, position=0.3), []
    for volts in u:
        y.append(truth.position)
        truth.advance(TICK, volts)
    np.testing.assert_allclose(found.y, y, atol=1e-6 * np.ptp(y))
    np.testing.assert_array_equal(found.t_u, t)


def test_latency_makes_commands_leave_and_act_later():
    t, u = ticks(100), np.r_[np.zeros(10), np.ones(90)]
    at_once = Experiment(plant(), t).run_given(u)
    later = Experiment(plant(), t, latency=4 * TICK).run_given(u)
    np.testing.assert_allclose(later.y[4:], at_once.y[:-4], atol=1e-12)
    np.testing.assert_allclose(later.t_u - t, 4 * TICK, atol=1e-15)


def test_the_relay_is_that_of_the_loop():
    """Replays what was recorded: each command follows from the reading of its row."""
    relay = Relay(e_a=0.5, hysteresis=0.01, bias=0.1, entry=0.05)
    found = Experiment(plant(noise=1e-3, position=0.2), ticks(2000), noise=1e-3).run_relay(relay)
    sign = 1.0
    for t, y, u in zip(found.t, found.y - 0.2, found.u, strict=True):
        sign = -1.0 if y > 0.01 else 1.0 if y < -0.01 else sign
        assert u == pytest.approx(0.1 + sign * 0.5 * min(1.0, t / 0.05), abs=1e-12)
    assert np.count_nonzero(np.diff(np.sign(found.u[200:] - 0.1))) > 20


def test_two_phases_have_two_frequencies():
    relay = Relay(e_a=0.5, cycles=3, shift=0.25)
    found = Experiment(plant(), ticks(6000)).run_relay(relay)
    ups = found.t[np.flatnonzero(np.diff(found.u) > 0.0) + 1]
    periods = np.diff(ups)[4:]
    assert periods.max() > 1.3 * periods.min()
    slow = periods > 0.5 * (periods.max() + periods.min())
    runs = np.diff(np.flatnonzero(np.diff(np.r_[False, slow, False].astype(int))))
    assert set(runs[1:-1].tolist()) <= {2, 3, 4}


def test_velocity_mode_starts_at_its_speed():
    speed = plant(measures="velocity", omega_n=60.0, zeta=0.8)
    relay = Relay(e_a=1.0, bias=2.0, reference=34.0, velocity=True)
    found = Experiment(speed, ticks(4000), approach=2.0).run_relay(relay)
    assert found.y[0] == pytest.approx(34.0, rel=1e-6)
    assert found.y[1000:].mean() == pytest.approx(34.0, rel=0.01)
    assert np.abs(np.cumsum(found.y - 34.0) * TICK).max() < 1.0
    assert np.count_nonzero(np.diff(found.u)) > 20


@pytest.mark.slow
def test_pressure_and_temperature_act_row_by_row():
    t, n = ticks(8000), 8000
    effects = {"square_root_flow": {"supply": 1e9}, "parameter_drift": {"K_L_thermal": 0.01}}
    supply, warmth = np.where(t < 2.0, 1.0, 0.25), np.where(t < 3.0, 0.0, 20.0)
    hot = plant(measures="velocity", effects=effects)
    found = Experiment(hot, t, supply=supply, warmth=warmth, approach=1.0).run_given(np.ones(n))
    speeds = found.y[[0, 3999, 5999, 7999]]
    assert speeds == pytest.approx([17.0, 17.0, 8.5, 8.5 * 1.2], rel=1e-4)
    # copies: for columns that run backwards the kernel is compiled once more, 10 s
    supply, warmth = supply[::-1].copy(), warmth[::-1].copy()
    back = Experiment(hot, t, supply=supply, warmth=warmth, approach=1.0).run_given(np.ones(n))
    assert back.y[0] == pytest.approx(8.5 * 1.2, rel=1e-4)


def test_the_same_seed_makes_the_same_recording():
    def one(seed, **effects):
        spoilt = plant(effects={"outliers": {"rate": 0.1, "size": 1.0}, **effects})
        return Experiment(spoilt, ticks(500), seed=seed, noise=0.01).run_given(np.zeros(500)).y

    np.testing.assert_array_equal(one(5), one(5))
    assert not np.array_equal(one(5), one(6))
    off = one(5) - Experiment(plant(), ticks(500), seed=5, noise=0.01).run_given(np.zeros(500)).y
    assert 20 < np.count_nonzero(off) < 90
    assert np.std(off[off != 0.0]) == pytest.approx(1.0, rel=0.5)
    missing = one(5, missing_samples={"rate": 0.3, "length": 2.0})
    there = np.isfinite(missing)
    assert 50 < np.count_nonzero(~there) < 300
    np.testing.assert_array_equal(missing[there], one(5)[there])


def test_jitter_is_in_the_samples_and_not_in_their_stamps():
    moving = plant(measures="position", effects={"timing_jitter": {"deviation": 1e-4}})
    t, u = ticks(4000), np.ones(4000)
    found, ideal = (Experiment(each, t).run_given(u) for each in (moving, plant()))
    np.testing.assert_array_equal(found.t, ideal.t)
    late = (found.y - ideal.y)[1000:] / 17.0
    assert late.std() == pytest.approx(1e-4, rel=0.1)


def test_noise_and_defects_have_streams_of_their_own():
    t, u = ticks(4000), np.ones(4000)
    late = plant(effects={"timing_jitter": {"deviation": 1e-4}})
    clean = Experiment(plant(), t).run_given(u).y
    jitter = Experiment(late, t).run_given(u).y - clean
    noise = Experiment(plant(), t, noise=0.01).run_given(u).y - clean
    assert abs(np.corrcoef(jitter[1000:], noise[1000:])[0, 1]) < 0.1


def test_an_encoder_counts():
    sensor = {"kind": "incremental_encoder", "bits": 8, "counts_per_unit": -500.0}
    found = Experiment(plant(sensor=sensor), ticks(400)).run_given(np.full(400, 0.5))
    counts = found.y * 500.0
    np.testing.assert_allclose(counts, np.rint(counts), atol=1e-9)
    assert len(np.unique(counts)) > 200
    absolute = plant(sensor={"kind": "absolute_encoder", "counts_per_rev": 4096})
    assert count_size(absolute) == pytest.approx(2.0 * math.pi / 4096)
    assert count_size(plant()) == 0.0


def test_a_coarser_quantisation_than_the_encoder_s_counts():
    sensor = {"kind": "incremental_encoder", "bits": 16, "counts_per_unit": 500.0}
    coarse = plant(sensor=sensor, effects={"sensor_quantization": {"step": 0.1}})
    assert plant_record(coarse)["sensor_quantization_step"] == 0.1


def test_an_fv_converter_ripples_and_lags_as_the_live_one():
    sensor = {"kind": "fv_converter", "volts_per_unit": 0.05, "ripple": 0.02, "ripples_per_unit": 3.0}
    t = ticks(2000)
    found = Experiment(plant(sensor=sensor, zeta=0.8), t, approach=1.0).run_given(np.ones(2000))
    smooth = Experiment(plant(measures="velocity", zeta=0.8), t, approach=1.0).run_given(np.ones(2000))
    part = found.y / smooth.y - 1.0
    assert part.max() == pytest.approx(0.02, rel=0.01)
    ripples = np.count_nonzero(np.diff(np.sign(part)) > 0)
    assert ripples == pytest.approx(17.0 * 1.0 * 3.0, abs=2)
    live = make_sensor(plant(sensor=sensor).sensor)
    turned = (np.cumsum(smooth.y) - smooth.y[0]) * TICK
    start = np.arccos(np.clip(part[0] / 0.02, -1.0, 1.0)) / (6.0 * math.pi)
    shapes = [
        [live.sense(0.0, way + offset, 1.0) - 1.0 for way in turned[:200]] for offset in (start, -start)
    ]
    assert min(np.abs(shape - part[:200]).max() for shape in shapes) < 0.02 * 0.1
    lagging = plant(sensor={**sensor, "lag": 0.003})
    assert plant_record(lagging)["sensor_lag_time"] == 0.003


def test_an_fv_converter_s_end_is_told_to_a_relay():
    sensor = {"kind": "fv_converter", "volts_per_unit": 0.05, "clip": (-1.0, 1.0)}
    clipped = plant(sensor=sensor)
    assert sensor_range(clipped) == (-20.0, 20.0)
    relay = Relay(e_a=0.5, velocity=True, reference=15.0, bias=15.0 / 17.0)
    with pytest.raises(ValueError, match="clips at -20 and 20"):
        Experiment(clipped, ticks(2000), approach=15.0 / 17.0).run_relay(relay)


@pytest.mark.parametrize(
    ("sensor", "effect"),
    [
        ({"kind": "linear", "lag": 0.001}, {"sensor_lag": {"time": 0.002}}),
        (
            {"kind": "fv_converter", "volts_per_unit": 0.05, "ripple": 0.02, "ripples_per_unit": 3.0},
            {"position_ripple": {"amplitude": 0.01}},
        ),
    ],
)
def test_a_sensor_and_an_effect_that_say_two_things_are_refused(sensor, effect):
    with pytest.raises(ValueError, match=f"effect {next(iter(effect))}: the plant's sensor has it already"):
        Experiment(plant(sensor=sensor, effects=effect), ticks(10))
