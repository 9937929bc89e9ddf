"""The whole way from a rig on a bus to zeta and omega_n over TCP, on a good and on a bad bus."""

from __future__ import annotations

from statistics import median
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from conftest import Bench

TOLERANCE = 0.02
WANTED = 20
"""Estimates of which the median is taken."""


def check_estimates(bench: Bench) -> None:
    """The next good estimates agree with the rig's true values."""
    truth = bench.rig.call("truth")["motor"]
    number = bench.daemon.call("subscribe", topics=["estimate"])["subscription"]
    good = []
    while len(good) < WANTED:
        message = bench.daemon.wait_for("an ok estimate", lambda m: m.get("method") == "estimate")["params"]
        if message["quality"] == "ok":
            good.append(message)
    bench.daemon.call("unsubscribe", subscription=number)
    for name in ("omega_n", "zeta"):
        value = median(message[name] for message in good)
        print(f"{name}: {value:.5g}, truth {truth[name]:.5g}: {100 * (value / truth[name] - 1):+.2f} %")
        assert abs(value / truth[name] - 1.0) < TOLERANCE


def test_estimates_are_true(bench: Bench) -> None:
    bench.excite()
    check_estimates(bench)


def test_info_tells_the_truth_of_a_simulated_rig(bench: Bench) -> None:
    info = bench.daemon.call("info")
    assert info["simulated"] is True
    assert info["truth"]["motor"] == bench.rig.call("truth")["motor"]


def test_estimates_follow_a_changed_rig(bench: Bench) -> None:
    before = bench.rig.call("truth")["motor"]
    bench.excite()
    bench.rig.call("set", plant="motor", zeta=0.4, omega_n=24.0)
    try:
        check_estimates(bench)
    finally:
        bench.rig.call("set", plant="motor", zeta=before["zeta"], omega_n=before["omega_n"])


def test_estimates_are_true_with_a_tenth_of_the_frames_lost(bench: Bench) -> None:
    bench.excite()
    before = bench.counters()["lost"]
    bench.rig.call("drop", probability=0.1)
    check_estimates(bench)
    assert bench.counters()["lost"] > before


def test_garbage_and_damaged_frames_are_counted_and_let_go(bench: Bench) -> None:
    bench.excite()
    before = bench.counters()
    bench.rig.call("garbage", rate_hz=200.0)
    bench.rig.call("corrupt", probability=0.05)
    bench.rig.call("reorder", probability=0.05)
    check_estimates(bench)
    after = bench.counters()
    for name in ("wrong_length", "checksum_errors", "reordered"):
        assert after[name] > before[name], name
    assert bench.state() == "exciting"
