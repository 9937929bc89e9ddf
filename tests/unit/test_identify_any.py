"""Whatever a recording holds: a quality word or a clear error, never a traceback or a number that is none."""

import json

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from seod.estimate.base import QUALITIES
from seod.identify import IdentifyError, Record, identify

N = 40
NUMBERS = st.one_of(
    st.floats(-10.0, 10.0), st.sampled_from([0.0, 1e-300, 1e11, 1e300, np.inf, -np.inf, np.nan])
)
COLUMNS = arrays(np.float64, N, elements=NUMBERS, fill=st.sampled_from([0.0, 1.0, np.nan]))
STEPS = arrays(np.float64, N, elements=st.floats(1e-6, 10.0), fill=st.just(0.001))


def outcome(*args, **kwargs):
    """The answer; None where the recording was refused with its name."""
    try:
        return identify([Record("x", *args, **kwargs)])
    except IdentifyError as error:
        return None if str(error).startswith("x: ") else error


@pytest.mark.slow
@settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(STEPS, COLUMNS, COLUMNS, st.sampled_from(["position", "velocity"]), st.sampled_from(["zero", "first"]))
def test_any_numbers_get_a_word(steps, u, y, output, hold):
    found = outcome(np.cumsum(steps), u, y, output=output, hold=hold)
    if found is None:
        return
    assert found.quality in QUALITIES
    json.dumps(found.as_json(), allow_nan=False)
    assert (found.quality == "ok") == (found.message is None)
    assert found.quality == "ok" or found.advice is None


@settings(max_examples=15, deadline=None)
@given(arrays(np.float64, N, elements=NUMBERS))
def test_any_times_are_refused_or_used(t):
    found = outcome(t, np.arange(N) % 7.0, np.sin(np.arange(N)))
    assert found is None or found.quality in QUALITIES
