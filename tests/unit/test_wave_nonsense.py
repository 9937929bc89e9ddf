"""Whatever the rows hold: no exception, a word of the contract, and only finite numbers."""

from __future__ import annotations

import math
from dataclasses import asdict

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import settings as tries
from hypothesis import strategies as st
from relay_truth import E_A, K_L, PLANTS, TICK, Loop, rows, settings

from seod.estimate import TABLE, make_estimator
from seod.estimate.base import QUALITIES, Estimate, Row

pytestmark = pytest.mark.slow

NUMBERS = st.one_of(
    st.floats(-1.0, 1.0), st.sampled_from([0.0, math.nan, math.inf, -math.inf, 1e300, 1e9, 1e-300, E_A, -E_A])
)
FIELDS = ("t", "y", "u", "t_u", "reference", "e_a", "bias", "K_L", "speed")
SWITCHES = ("exciting", "fresh", "saturated", "second")
GOOD = rows(Loop(*PLANTS[1], delay=1.0, noise=0.01, start=0.2), 0.3)


Change = tuple[int, int, str, float | bool]


@st.composite
def changes(draw) -> Change:
    """The first row, how many, a field, and the anything that it is put to."""
    name = draw(st.sampled_from(FIELDS + SWITCHES))
    value = draw(st.booleans() if name in SWITCHES else NUMBERS)
    return draw(st.integers(0, len(GOOD) - 1)), draw(st.sampled_from([1, 2, 30, 600])), name, value


def spoiled(changed: list[Change]) -> list[Row]:
    """The limit cycle with fields of some rows, or of all from one on, changed."""
    feed = list(GOOD)
    for first, count, name, value in changed:
        feed[first : first + count] = [row._replace(**{name: value}) for row in feed[first : first + count]]
    return feed


def assert_sound(answer: Estimate) -> None:
    assert answer.quality in QUALITIES
    values = {key: value for key, value in asdict(answer).items() if isinstance(value, float)}
    assert all(math.isfinite(value) for value in values.values()), values
    if answer.quality == "ok":
        assert answer.zeta > 0.0
        assert answer.omega_n > 0.0
        assert None not in (answer.zeta, answer.omega_n, answer.frequency, answer.amplitude)
    else:
        assert answer.advice


@pytest.mark.parametrize(
    "known",
    [
        {},
        {"K_L_sd": math.inf, "delay_sd": math.inf},
        {"integrated": True, "lag_s": 1e-3},
        {"K_L_sd": 0.5, "resolution": 1e-4},
    ],
    ids=str,
)
@tries(max_examples=12, deadline=None)
@example(changed=[(0, 600, "y", 0.0), (65, 1, "y", 1e-300)])
@example(changed=[(48, 600, "fresh", False), (0, 30, "second", True)])
@given(changed=st.lists(changes(), max_size=6))
def test_spoiled_rows_bring_words_and_finite_numbers(known, changed):
    estimator = make_estimator(settings("wave", **known))
    for row in spoiled(changed):
        answer = estimator.update(row if known.get("integrated") is None else row._replace(speed=row.y))
        if answer:
            assert_sound(answer)


@pytest.mark.parametrize("method", TABLE)
@pytest.mark.parametrize(
    "y", [0.0, 0.3, math.nan, math.inf, 1e12], ids=["zero", "constant", "nan", "inf", "huge"]
)
def test_a_sensor_that_tells_nothing_is_never_ok(method, y):
    estimator = make_estimator(settings(method))
    answers = [estimator.update(row._replace(y=y)) for row in [*GOOD, *later(GOOD, 3)]]
    told = [answer for answer in answers if answer]
    assert told
    for answer in told:
        assert_sound(answer)
        assert answer.quality != "ok"


def later(feed: list[Row], times: int) -> list[Row]:
    """The same again and again, for the words that take time."""
    span = feed[-1].t - feed[0].t + TICK
    return [r._replace(t=r.t + k * span, t_u=r.t_u + k * span) for k in range(1, times + 1) for r in feed]


@pytest.mark.parametrize("method", TABLE)
def test_noise_alone_is_never_ok(method):
    rng, estimator = np.random.default_rng(4), make_estimator(settings(method))
    for k, y in enumerate(0.01 * rng.standard_normal(1500)):
        row = Row(k * TICK, y, -math.copysign(E_A, y), (k + 1) * TICK, 0.0, E_A, 0.0, exciting=True)
        answer = estimator.update(row)
        if answer:
            assert_sound(answer)
            assert answer.quality != "ok"


def test_a_plant_of_another_gain_or_none_at_all_is_never_sure():
    estimator = make_estimator(settings("wave", K_L=1e-6 * K_L))
    for row in GOOD:
        answer = estimator.update(row)
        assert answer is None or answer.quality != "ok"
