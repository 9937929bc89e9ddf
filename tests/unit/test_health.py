"""The rate that `health` tells."""

from types import SimpleNamespace

import pytest
from loop_bench import Bench
from whole_rig import WholeRig

from seod.observe.health import Health
from seod.observe.rig import HEALTH_S
from seod.processes.ring import Word


def test_there_is_no_rate_of_a_loop_that_had_not_begun():
    words = {Word.TICKS: 0}
    health = Health(SimpleNamespace(words=words))
    rates = []
    for t, ticks in enumerate((0, 1500, 3500, 3500, 5500)):
        words[Word.TICKS] = ticks
        health.measure(100.0 + t)
        rates.append(health._rate)
    assert rates == [None, None, 2000.0, 0.0, 2000.0]


def test_the_rate_is_the_loops_own_where_rows_take_long(monkeypatch):
    rig = WholeRig(Bench())
    rate = rig.bench.config.loop.rate_hz
    busy = iter((0.0, 0.7, 0.0, 0.0))
    monkeypatch.setattr(rig.gateway, "_on_rows", lambda _rows: rig.bench.run(next(busy, 0.0)))
    try:
        for _ in range(4):
            rig.bench.run(1.1 * HEALTH_S)
            rig.gateway.poll()
    finally:
        rig.close()
    rates = [each["rate_hz"] for each in rig.hub.messages["health"] if each["rate_hz"] is not None]
    assert rates == pytest.approx([rate] * len(rates), rel=0.01)
    assert len(rates) >= 3
