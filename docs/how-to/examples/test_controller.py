"""Tests of control software against a simulated rig; `pip install seod` is all that they need."""

import pytest


def test_the_rig_is_identified(seod_daemon):
    with seod_daemon.client() as rig:
        for _ in range(100):  # the first samples may be under way
            try:
                rig.start()
                break
            except Exception:  # noqa: S110
                pass
        estimate = next(e for e in rig.estimates(timeout=30) if e["quality"] == "ok")
        truth = rig.info()["truth"]["motor"]
    assert estimate["omega_n"] == pytest.approx(truth["omega_n"], rel=0.02)


@pytest.mark.seod_rig("virtual", **{"axes.motor.relay.e_a": "0.3 V"})
def test_a_setting_is_kept_within_the_limits(seod_daemon):
    with seod_daemon.client() as rig:
        assert rig.get()["settings"]["e_a"] == 0.3
        with pytest.raises(Exception, match="output"):
            rig.set(e_a=5.0)  # more than limits.output
