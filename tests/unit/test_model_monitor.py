"""The model beside the rig: small errors while it holds, an event when the plant changes."""

from __future__ import annotations

import asyncio
import math
import threading
from itertools import pairwise

import numpy as np
import pytest
from fake_loop import eventually, peer, rig_config, running
from linear_plant import LinearPlant
from plant_truth import Plant
from truth_runs import sampled_relay

from seod.model_monitor.judge import IN_A_ROW, ModelError, Verdict, judge
from seod.model_monitor.kernel import KernelModel
from seod.model_monitor.linear import LinearModel
from seod.model_monitor.models import model_of, needs_kernel, plant_of
from seod.model_monitor.remote import RemoteModel
from seod.model_monitor.window import Segment
from seod.observe.segments import Segments, segment_of
from seod.processes.ring import FLAG_EXCITING, FLAG_FRESH
from seod.terminal import text

RATE = 2000.0
NONE = np.empty(0)


def relay_rows(plant_numbers, n, noise=1e-3, change=None, seed=1):
    """t, y, u of a relay on a plant of Eq. 1 that may become another one on the way."""
    plant, random = LinearPlant(*plant_numbers), np.random.default_rng(seed)
    out, u = np.empty((3, n)), 0.0
    for k in range(n):
        if change is not None and k == change[0]:
            plant.change(*change[1], 0.0)
        plant.advance(1.0 / RATE if k else 0.0, u)
        y = plant.position + random.normal(0.0, noise)
        u = -0.5 if y > 0.004 else 0.5 if y < -0.004 else u or 0.5
        out[:, k] = k / RATE, y, u
    return out


def segment(t, y, u, first=400, last=1400):
    return Segment(t[first:last], y[first:last], t[:last], u[:last], NONE)


# ---- the models


def test_a_rig_that_keeps_to_its_model_is_not_accused():
    """The statistic of noise alone: mean about 0, deviation about 1 as theory has it, no news in 30 s."""
    t, y, u = relay_rows((17.0, 117.0, 0.21), 60_000)
    rows = [row(*each) for each in zip(t, y, u, strict=True)]
    at_once = [(*each[:4], each[0], *each[5:]) for each in rows]  # commands leave when they are computed
    made = list(Segments(117.0, None).add(at_once))[2:]
    model, verdict = LinearModel(17.0, 117.0, 0.21), Verdict()
    errors = [judge(each, model.residual(each), 0.0, "linear") for each in made]
    statistic = np.array([each.statistic for each in errors])
    assert len(statistic) > 85
    assert abs(statistic.mean()) < 0.6
    assert 0.8 < statistic.std() < 2.0
    assert not any(verdict.add(each) for each in errors)


def test_the_right_linear_model_leaves_noise():
    s = segment(*relay_rows((17.0, 117.0, 0.21), 1500))
    error = judge(s, LinearModel(17.0, 117.0, 0.21).residual(s), 0.0, "linear")
    assert error.rms == pytest.approx(1e-3, rel=0.1)
    assert abs(error.statistic) < 4.0
    assert not error.beyond


@pytest.mark.parametrize("wrong", [(17.0, 117.0, 0.4), (17.0, 100.0, 0.21), (14.0, 117.0, 0.21)])
def test_a_wrong_one_is_seen(wrong):
    s = segment(*relay_rows((17.0, 117.0, 0.21), 1500))
    error = judge(s, LinearModel(*wrong).residual(s), 0.0, "linear")
    assert error.statistic > 50.0
    assert error.nrmse > 0.05
    assert error.beyond


def test_a_delay_belongs_to_the_model():
    t, y, u = relay_rows((17.0, 117.0, 0.21), 1500)
    late = Segment(t[400:1400] + 2e-3, y[400:1400], t[:1400], u[:1400], NONE)
    assert judge(late, LinearModel(17.0, 117.0, 0.21, delay=2e-3).residual(late), 0.0, "x").statistic < 4.0
    assert judge(late, LinearModel(17.0, 117.0, 0.21).residual(late), 0.0, "x").beyond


def test_a_speed_needs_no_position():
    t, y, u = relay_rows((17.0, 60.0, 0.4), 1500, noise=0.0)
    s = Segment(t[400:1400], np.gradient(y, t)[400:1400], t[:1400], u[:1400], NONE)
    left = LinearModel(17.0, 60.0, 0.4, speed=True).residual(s)
    assert np.std(left) < 0.01 * np.std(s.y)


@pytest.mark.slow
def test_friction_needs_the_kernel():
    """Truth by other equations; the closed form sees it as another plant, the kernel does not."""
    config = rig_config()
    effects = {"coulomb_friction": {"level": 800.0}}
    plant = config.simulation.plants["motor"].model_copy(update={"effects": effects})
    t = np.arange(1400) / RATE
    y, u = sampled_relay(Plant(17.0, 117.0, 0.21, effects), 0.5, t, hysteresis=0.004)
    y = y + np.random.default_rng(1).normal(0.0, 3e-4, len(y))
    s = segment(t, y, u, 400, 1400)
    assert needs_kernel(plant)
    assert judge(s, LinearModel(17.0, 117.0, 0.21).residual(s), 0.0, "linear").beyond
    error = judge(s, KernelModel(plant).residual(s), 0.0, "kernel")
    assert error.rms == pytest.approx(3e-4, rel=0.15)
    assert not error.beyond


@pytest.mark.slow
def test_the_kernel_answers_from_a_process_of_its_own():
    config = rig_config()
    simulation = config.simulation
    plant = simulation.plants["motor"].model_copy(
        update={"effects": {"valve_deadband": {"half_width": 0.05}}}
    )
    simulation = simulation.model_copy(update={"plants": {"motor": plant}})
    model = model_of(config.model_copy(update={"simulation": simulation}), "motor")
    assert (type(model), model.name) == (RemoteModel, "kernel")
    s = segment(*relay_rows((17.0, 117.0, 0.21), 1500))
    try:
        for _ in range(2):
            np.testing.assert_allclose(model.residual(s), KernelModel(plant).residual(s), atol=1e-9)
        with pytest.raises(ValueError, match="LinAlgError"):
            model.residual(s._replace(y=np.nan * s.y))
        model._process.terminate()
        with pytest.raises(OSError, match="has died"):
            model.residual(s)
    finally:
        model.close()
    assert model._process.returncode is not None


def test_the_kernel_and_the_closed_form_agree_on_a_linear_plant():
    config = rig_config()
    s = segment(*relay_rows((17.0, 117.0, 0.21), 1500))
    kernel = KernelModel(config.simulation.plants["motor"]).residual(s)
    closed = LinearModel(17.0, 117.0, 0.21).residual(s)
    assert np.std(kernel - closed) < 0.1 * np.std(closed)  # the closed form has an offset and a ramp more


def test_a_rig_without_a_model_has_none():
    config = rig_config().model_copy(update={"simulation": None})
    assert plant_of(config, "motor") is None
    assert model_of(config, "motor") is None


# ---- the verdict


def error(beyond):
    return ModelError(0.0, 1.0, 1.0, 1.0, 1.0, beyond, "linear")


def test_one_bad_segment_is_no_news_several_are_and_so_is_the_way_back():
    verdict = Verdict()
    course = [True, False] + [True] * IN_A_ROW + [True, False, True] + [False] * IN_A_ROW
    news = [k for k, beyond in enumerate(course) if verdict.add(error(beyond))]
    assert news == [1 + IN_A_ROW, len(course) - 1]
    assert not verdict.left


def test_what_does_not_move_tells_nothing():
    t = np.arange(500) / RATE
    still = Segment(t, np.random.default_rng(1).normal(0, 1e-3, 500), t, np.zeros(500), NONE)
    assert judge(still, still.y, 0.0, "linear") is None


# ---- in the gateway


def row(t, y, u, flags=FLAG_EXCITING | FLAG_FRESH, ps=math.nan):
    return (t, y, 0.0, u, t + 1e-4, 0.5, 0.0, -y, ps, math.nan, 17.0, 2, flags)


def test_stale_and_repeated_samples_are_left_out_but_their_commands_count():
    rows = [row(k / RATE, math.sin(k / 20), 1.0 + k) for k in range(800)]
    rows[500] = row(500 / RATE, 0.0, 501.0, FLAG_EXCITING)
    rows[501] = row(rows[502][0], 9.9, 502.0)
    rows[502] = row(rows[502][0], 9.9, 503.0)
    made = segment_of(rows, None)
    assert len(made.t) == 800 - 300 - 2
    assert len(made.u) == 800
    assert np.all(np.diff(made.t) > 0.0)
    assert len(made.supply) == 0
    assert segment_of(rows[:310], None) is None


def test_segments_follow_each_other_and_begin_anew_after_a_stop():
    """Six periods of 117 rad/s each, 0.15 s of commands before it; none across rows without excitation."""
    cut, rows = Segments(117.0, None), [row(k / RATE, math.sin(k / 20), 1.0) for k in range(3000)]
    made = list(cut.add(rows))
    assert [round(each.t[-1] - each.t[0], 2) for each in made] == [0.32] * 4
    for one, following in pairwise(made):
        assert 0.0 < following.t[0] - one.t[-1] <= 1.01 / RATE
    assert all(each.t[0] - each.t_u[0] == pytest.approx(0.15, abs=2e-3) for each in made)
    assert list(cut.add([row(2.0, 0.0, 0.0, FLAG_FRESH)])) == []
    assert len(list(cut.add([row(3.0 + k / RATE, math.sin(k / 20), 1.0) for k in range(930)]))) == 0


def test_the_supply_is_that_of_the_rows():
    rows = [row(k / RATE, math.sin(k / 20), 1.0, ps=6e6) for k in range(800)]
    assert set(segment_of(rows, 8e6).supply.tolist()) == {0.75}


async def play(run, t, y, u):
    """Rows of a relay, as fast as they are taken."""
    loop = run.loop
    words, ring = loop.shared.words, loop.shared.row_ring
    for k, (now, place, volts) in enumerate(zip(t, y, u, strict=True)):
        loop.t = 100.0 + now
        one = (loop.t, place, 0.0, volts, loop.t, 0.5, 0.0, -place, math.nan, math.nan, 17.0, 2, 3)
        loop.shared.row_struct.pack_into(ring.data, ring.next_offset(), words[0], loop.t, *one)
        ring.commit()
        words[0] += 1
        if k % 500 == 499:
            await eventually(lambda: words[3] >= words[0] - 10)
            await asyncio.sleep(0.02)  # segments that come while one is computed are left out


@pytest.mark.slow
async def test_the_gateway_streams_the_error_and_says_when_the_rig_leaves_its_model():
    t, y, u = relay_rows((17.0, 117.0, 0.21), 9000, change=(3000, (17.0, 90.0, 0.5)))
    async with running() as run, peer(run) as client:
        await client.call("subscribe", topics=["model_error", "event"])
        await play(run, t, y, u)
        first = await client.until("model_error")
        event = await client.until("event", event="warning", code="model")
        answer = await client.call("get", axis="motor")
    assert (first["axis"], first["model"], first["left"]) == ("motor", "linear", False)
    assert first["rms"] == pytest.approx(1e-3, rel=0.2)
    assert abs(first["statistic"]) < 5.0
    assert "left its model" in event["why"]
    assert event["t"] > 100.0 + 3000 / RATE
    assert answer["model_error"]["left"]
    assert "the rig has left its model: error" in text.axis(answer)


async def test_nothing_is_told_and_no_thread_made_while_it_stands_still():
    async with running() as run, peer(run) as client:
        await client.call("subscribe", topics=["model_error"])
        for _ in range(2000):
            run.loop.row(flags=FLAG_FRESH)
        await eventually(lambda: run.loop.shared.words[3] >= 2000)
        answer = await client.call("get", axis="motor")
        assert [thread for thread in threading.enumerate() if "model of" in thread.name] == []
    assert answer["model_error"] is None
