"""The e_a ramp: what its steps say together, and that e_a and state are restored whatever happens."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from seod.calibrate.procedure import CalibrationError
from seod.calibrate.ramp import as_text, depends, plot, ramp, report, smallest_clean, step_of

if TYPE_CHECKING:
    from pathlib import Path


def estimates(
    zeta: float, scatter: float = 0.002, quality: str = "ok", seed: int = 1
) -> list[dict[str, Any]]:
    values = np.random.default_rng(seed).normal(zeta, scatter, 20)
    return [
        {"t": 2.0 + k, "quality": quality, "zeta": z, "zeta_sd": 1e-3, "omega_n": 117.0, "omega_n_sd": 0.1}
        for k, z in enumerate(values)
    ]


def test_smallest_clean_amplitude_has_only_clean_ones_above() -> None:
    steps = [step_of(0.1, estimates(0.2)), step_of(0.2, estimates(0.2, 0.1))]
    steps += [step_of(0.3, estimates(0.2)), step_of(0.4, estimates(0.2))]
    assert [step.clean for step in steps] == [True, False, True, True]
    assert smallest_clean(steps) == 0.3
    assert smallest_clean(steps[:2]) is None


def test_steps_without_an_oscillation_say_nothing() -> None:
    step = step_of(0.1, estimates(0.2, quality="no_oscillation"))
    assert (step.zeta, step.clean, step.ok) == (None, False, 0.0)
    assert step_of(0.1, []).clean is False
    assert "no clean limit cycle" in as_text(report("motor", [step]))


def test_dependence_beyond_the_interval_is_said_and_scatter_is_not() -> None:
    same = [step_of(0.1 * k, estimates(0.2, seed=k)) for k in range(1, 5)]
    rising = [step_of(0.1 * k, estimates(0.2 + 0.01 * k, seed=k)) for k in range(1, 5)]
    assert not depends(same, "zeta")
    assert depends(rising, "zeta")
    assert not depends(rising, "omega_n")
    assert "zeta depend on e_a" in as_text(report("motor", rising))


@pytest.fixture(scope="module")
def fonts() -> None:
    """matplotlib opens its fonts once and keeps them."""
    figure = Figure()
    figure.text(0.5, 0.5, "1")
    figure.savefig(io.BytesIO())


def test_the_plot_is_a_png(tmp_path: Path, fonts: None) -> None:
    plot(report("motor", [step_of(0.1 * k, estimates(0.2)) for k in (1, 2)]), tmp_path / "ramp.png")
    assert (tmp_path / "ramp.png").read_bytes().startswith(b"\x89PNG")


class FakeClient:
    """Notes what it is told; its axis faults at an amplitude."""

    def __init__(self, state: str, fault_at: float = 9.0) -> None:
        self.state, self.e_a, self.fault_at = state, 0.5, fault_at
        self.calls: list[str] = []

    def get(self, axis: str) -> dict[str, Any]:
        return {"state": self.state, "settings": {"e_a": 0.5}, "fault": {"why": "too far"}}

    def set(self, axis: str, e_a: float) -> None:
        self.e_a = e_a

    def start(self, axis: str) -> None:
        self.calls.append("start")

    def stop(self, axis: str) -> None:
        self.calls.append("stop")

    def subscribe(self, topics: list[str], axes: list[str]) -> int:
        self.calls.append("subscribe")
        return 7

    def unsubscribe(self, subscription: int) -> None:
        assert subscription == 7
        self.calls.append("unsubscribe")

    def forget(self) -> None:
        """Nothing is waiting."""

    def notifications(self, timeout: float) -> list[dict[str, Any]]:
        """First an estimate of the rows before the change, which comes late; then the change's event."""
        quality = "fault" if self.e_a >= self.fault_at else "ok"
        told = [{**e, "quality": quality, "axis": "motor"} for e in estimates(0.2)]
        late = {**told[0], "t": told[0]["t"] - 5.0, "zeta": 9.0}
        changed = {"axis": "motor", "t": told[0]["t"], "values": {"e_a": self.e_a}}
        every = [("estimate", late), ("event", changed), *(("estimate", e) for e in told)]
        return [{"method": method, "params": params} for method, params in every]


@pytest.mark.parametrize(
    ("state", "calls"),
    [("idle", ["subscribe", "start", "unsubscribe", "stop"]), ("exciting", ["subscribe", "unsubscribe"])],
)
def test_amplitude_and_state_are_restored(state: str, calls: list[str]) -> None:
    client = FakeClient(state)
    steps = list(ramp(client, "motor", 0.1, 0.4, 4))
    assert [step.e_a for step in steps] == pytest.approx([0.1, 0.2, 0.3, 0.4])
    assert (client.e_a, client.calls) == (0.5, calls)


def test_a_fault_ends_the_ramp_and_restores_the_amplitude() -> None:
    client = FakeClient("idle", fault_at=0.3)
    with pytest.raises(CalibrationError, match="too far"):
        list(ramp(client, "motor", 0.1, 0.4, 4))
    assert (client.e_a, client.calls) == (0.5, ["subscribe", "start", "unsubscribe", "stop"])
