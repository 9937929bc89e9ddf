"""The answer at two amplitudes of the relay: what depends on it is told, what does not is left alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fake_loop import peer, rig_config, running
from relay_truth import K_L, PLANTS, TICK, amplitude_of

from seod.estimate import make_estimator
from seod.estimate.base import Dependence, Estimate
from seod.estimate.levels import FRESH_S, Levels, advise, dependence
from seod.observe.estimation import Axis
from seod.processes.ring import FLAG_EXCITING, FLAG_FRESH, AxisState
from sim.parameters import parameters
from sim.runs import RELAY, sampled_relay
from sim.state import new_state

ZETA, OMEGA_N = PLANTS[1]
ANSWER = Estimate(
    10.0, "wave", "ok", zeta=0.45, zeta_sd=0.001, omega_n=145.0, omega_n_sd=0.1, K_L=K_L, K_L_sd=0.0
)


def relay_rows(axis: Axis, effects: dict, e_a: float, start: float, noise: float) -> list[tuple]:
    """Half a second of the axis' rows: a sampled relay of amplitude `e_a` on the simulated plant."""
    record = parameters(K_L, OMEGA_N, ZETA, effects)
    scale, t = amplitude_of(ZETA, OMEGA_N) * e_a / 0.5, TICK * np.arange(1000)
    relay = np.zeros(1, RELAY)
    relay["e_a"], relay["hysteresis"], relay["latency"] = e_a, 0.05 * scale, TICK
    y, u, t_u, none = np.zeros(1000), np.zeros(1000), np.zeros(1000), np.zeros(0)
    disturbed = noise * scale * np.random.default_rng(round(1000 * e_a)).standard_normal(1000)
    sampled_relay(record[0], new_state(record)[0], relay[0], t, disturbed, none, none, none, y, u, t_u)
    flags = FLAG_EXCITING | FLAG_FRESH
    nan, state = float("nan"), int(AxisState.EXCITING)
    return [
        (start + a, b, 0.0, c, start + d, e_a, 0.0, -b, nan, nan, K_L, state, flags)
        for a, b, c, d in zip(t.tolist(), y.tolist(), u.tolist(), t_u.tolist(), strict=True)
    ]


def at_levels(effects: dict, *e_a: float, noise: float = 0.003) -> list[list[Estimate]]:
    """Answers of the gateway's axis, level by level."""
    axis = Axis("motor", rig_config().axes["motor"], TICK, make_estimator)
    answers = []
    for k, level in enumerate(e_a):
        axis.change({"e_a": level, "hysteresis": 0.05 * amplitude_of(ZETA, OMEGA_N) * level / 0.5})
        answers.append(axis.feed(relay_rows(axis, effects, level, 100.0 + k, noise)))
    return answers


def test_a_linear_plant_is_the_same_at_all_amplitudes():
    first, *rest = at_levels({}, 0.5, 0.25, 0.1)
    assert all(a.e_a_dependence is None for a in first)
    for answers, other in zip(rest, (0.5, 0.25), strict=True):
        assert {a.quality for a in answers if a.zeta} <= {"ok", "settling"}
        last = answers[-1].e_a_dependence
        assert last.other_e_a == other
        assert abs(last.zeta) < 0.02
        assert abs(last.omega_n) < 0.01
        assert last.K_L is None
        assert not last.matters


@pytest.mark.parametrize(
    ("effects", "sign"),
    [
        ({"valve_deadband": {"half_width": 0.03}}, 1.0),
        ({"square_root_flow": {"supply": 2.0 * K_L * 0.5 * OMEGA_N}}, -1.0),
        ({"valve_hysteresis": {"half_width": 0.03}}, 1.0),
    ],
    ids=str,
)
def test_what_one_amplitude_hides_two_show(effects, sign):
    first, second = at_levels(effects, 0.5, 0.3)
    assert first[-1].quality == "ok"  # and wrong: this is why there are two
    assert abs(first[-1].zeta / ZETA - 1.0) > 0.05
    last = second[-1]
    assert last.quality == "nonlinear"
    assert last.e_a_dependence.other_e_a == 0.5
    assert sign * last.e_a_dependence.zeta > 0.03
    assert last.e_a_dependence.sds > 5.0
    assert "seod ramp" in last.advice
    assert last.zeta == pytest.approx(first[-1].zeta * (1.0 + last.e_a_dependence.zeta), rel=0.02)


def test_where_it_does_not_depend_any_more_it_is_believed_again():
    answers = at_levels({"square_root_flow": {"supply": 2.0 * K_L * 0.5 * OMEGA_N}}, 0.5, 0.03, 0.02)
    assert answers[1][-1].quality == "nonlinear"
    assert answers[2][-1].quality == "ok"
    assert answers[2][-1].e_a_dependence.other_e_a == 0.03


def found(e_a: float, other: float, zeta: float, omega_n: float = 0.0) -> Dependence:
    return Dependence(other, zeta=zeta, omega_n=omega_n, K_L=None, sds=9.0, matters=True)


class TestAdvice:
    """Values made by a straight line over e_a, or over 1 / e_a, and what follows from them by hand."""

    def test_the_largest_amplitude_that_would_do(self):
        zeta = {e_a: 0.2 * (1.0 + 0.5 * e_a) for e_a in (0.4, 1.0)}
        said = advise(1.0, found(1.0, 0.4, zeta[1.0] / zeta[0.4] - 1.0))
        assert said.endswith("up to e_a = 0.04 V")  # 2 % / 0.5
        assert advise(0.4, found(0.4, 1.0, zeta[0.4] / zeta[1.0] - 1.0)).endswith("up to e_a = 0.04 V")

    def test_the_parameter_that_depends_more_decides(self):
        omega_n = {e_a: 100.0 * (1.0 - 0.8 * e_a) for e_a in (0.1, 0.5)}
        said = advise(0.5, found(0.5, 0.1, 0.01, omega_n[0.5] / omega_n[0.1] - 1.0))
        assert said.endswith("up to e_a = 0.025 V")

    def test_friction_asks_for_a_large_one(self):
        zeta = {e_a: 0.2 * (1.0 + 0.05 / e_a) for e_a in (0.2, 1.0)}
        said = advise(1.0, found(1.0, 0.2, zeta[1.0] / zeta[0.2] - 1.0))
        assert said.endswith("from e_a = 2.5 V on")

    def test_a_line_that_falls_below_nothing_tells_no_bound(self):
        said = advise(1.0, found(1.0, 0.9, 5.0))
        assert "state e_a with it" in said
        assert "up to" not in said


class TestLevels:
    def test_the_nearest_level_counts_and_the_own_one_does_not(self):
        levels = Levels()
        assert levels.compare(1.0, replace(ANSWER, zeta=0.9)) is None
        assert levels.compare(0.5, ANSWER).matters
        assert not levels.compare(0.4, ANSWER).matters
        assert levels.compare(0.42, replace(ANSWER, zeta=0.9)).other_e_a == 0.5

    def test_a_finding_outlasts_the_other_answer_but_not_the_amplitude(self):
        levels = Levels()
        levels.compare(1.0, replace(ANSWER, zeta=0.6))
        assert levels.compare(0.5, ANSWER).matters
        later = replace(ANSWER, t=ANSWER.t + FRESH_S + 1.0)
        assert levels.compare(0.5, later).matters
        assert levels.compare(0.3, replace(later, zeta=0.3)).other_e_a == 0.5
        assert Levels().compare(0.5, later) is None

    @pytest.mark.parametrize("other", [{"t": -30.0}, {"method": "exact"}, {"ps": 6.0e6}])
    def test_what_is_of_another_time_method_or_pressure_is_not_compared(self, other):
        levels = Levels()
        levels.compare(1.0, replace(ANSWER, **({"zeta": 0.9, "ps": 7e6} | other)))
        assert levels.compare(0.5, replace(ANSWER, ps=7e6)) is None

    @pytest.mark.parametrize(
        ("here", "matters"),
        [
            ({"zeta": 0.45 * 1.04}, True),
            ({"zeta": 0.45 * 1.02}, False),  # small
            ({"zeta": 0.45 * 1.10, "zeta_sd": 0.02}, False),  # noise
            ({"omega_n": 145.0 * 0.98}, True),
            ({"K_L": K_L * 1.02, "K_L_sd": 0.01}, True),
        ],
    )
    def test_a_difference_matters_that_is_large_and_certain(self, here, matters):
        assert dependence(1.0, ANSWER, 0.5, replace(ANSWER, **here)).matters is matters

    def test_close_amplitudes_must_agree_closely(self):
        here = replace(ANSWER, zeta=0.45 * 1.02)
        assert not dependence(0.5, ANSWER, 0.25, here).matters
        assert dependence(0.5, ANSWER, 0.4, here).matters

    def test_without_deviations_nothing_is_said(self):
        assert dependence(1.0, ANSWER, 0.5, replace(ANSWER, zeta_sd=None)) is None
        assert dependence(1.0, replace(ANSWER, omega_n=None), 0.5, ANSWER) is None


@pytest.mark.slow
async def test_it_is_told_once_and_each_estimate_has_it():
    async with running() as run, peer(run) as client:
        axis = run.rig.axes["motor"]
        await client.call("subscribe", topics=["estimate", "event"])
        axis._levels.compare(1.5, replace(ANSWER, t=run.loop.t, zeta=9.0))
        run.loop.rows(1500)
        warning = await client.until("event", code="depends_on_e_a")
        assert "1.5 V" in warning["why"]
        assert warning["axis"] == "motor"
        found = None
        while found is None:
            found = (await client.until("estimate", quality="nonlinear"))["e_a_dependence"]
        assert found["other_e_a"] == 1.5
        assert found["matters"]
