"""Tests of control software against a simulated rig; `pip install seod` is all that they need."""

import pytest

from seod.client import RequestError
from seod.client.waiting import start_and_wait


def test_the_rig_is_identified(seod_daemon):
    with seod_daemon.client() as rig:
        estimate = start_and_wait(rig, "motor", timeout=30)["motor"]
        truth = rig.info()["truth"]["motor"]
    assert estimate["omega_n"] == pytest.approx(truth["omega_n"], rel=0.02)


@pytest.mark.seod_rig("virtual", **{"axes.motor.relay.e_a": "0.3 V"})
def test_what_is_beyond_the_limits_is_refused(seod_daemon):
    with seod_daemon.client() as rig:
        assert rig.get()["settings"]["e_a"] == 0.3
        with pytest.raises(RequestError, match="output"):
            rig.set(e_a=5.0)  # more than limits.output
