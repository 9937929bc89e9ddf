"""What `seod calibrate` hears of a drive: samples in full, or it drives once more."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

from seod.calibrate.procedure import CalibrationError
from seod.calibrate.session import MAX_TRIES, REST_S, RemoteRig

if TYPE_CHECKING:
    from collections.abc import Iterator

TICK = 1e-2


class FakeClient:
    """A daemon whose axis follows each drive; of some drives `lost` messages take the place of samples."""

    def __init__(self, *losses: set[str]) -> None:
        self.losses = list(losses)
        """For each drive, the states whose samples are lost."""
        self.t = 0.0
        self.coming: list[dict[str, Any]] = []
        self.drives = 0
        self.subscribed: list[int] = []
        self.forgotten = self.kept_alive = 0
        self.tones: Any = None

    def subscribe(self, topics: list[str], axes: list[str]) -> int:
        self.subscribed.append(len(self.subscribed) + 1)
        self.extend("idle", 0.0, 30)
        return self.subscribed[-1]

    def unsubscribe(self, subscription: int) -> None:
        self.subscribed.remove(subscription)

    def forget(self) -> None:
        self.forgotten += 1
        self.coming.clear()

    def get(self, axis: str) -> dict[str, Any]:
        return {"state": "idle", "fault": None}

    def extend(self, state: str, volts: float, count: int, lost: bool = False) -> None:
        for _ in range(count):
            self.t += TICK
            known = {"t": self.t, "y": 0.0, "t_u": self.t, "ps": None, "K_L": 17.0, "fresh": True}
            if not lost:
                self.coming.append({"method": "sample", "params": {**known, "state": state, "u": volts}})
        if lost:
            numbers = {"subscription": 1, "topic": "sample", "lost": count, "total": count}
            self.coming.append({"method": "lost", "params": numbers})

    def keepalive(self) -> None:
        self.kept_alive += 1

    def drive(self, axis: str, volts: float, duration: float, stay: bool, tones: Any = None) -> None:
        self.tones = tones
        lost = self.losses.pop(0) if self.losses else set()
        self.drives += 1
        for state, voltage, count in (("armed", 0.0, 2), ("exciting", volts, 20), ("holding", 0.0, 5)):
            self.extend(state, voltage, count, state in lost)
        self.extend("idle", 0.0, round(REST_S / TICK) + 10)

    def notifications(self, timeout: float) -> Iterator[dict[str, Any]]:
        while self.coming:
            yield self.coming.pop(0)


def remote(*losses: set[str]) -> tuple[FakeClient, RemoteRig]:
    client = FakeClient(*losses)
    return client, RemoteRig(client, "motor")  # type: ignore[arg-type] # as much of one as is needed


def test_a_drive_is_recorded_from_the_rest_before_it() -> None:
    client, rig = remote()
    drive = rig.drive(1.0, 0.2)
    assert (drive.volts, drive.step, client.drives) == (1.0, 1.0, 1)
    assert sum(drive.t >= drive.step_t) == 20
    assert sum(drive.t < drive.step_t) >= 25


@pytest.mark.parametrize("lost", [{"exciting"}, {"holding"}, {"armed", "exciting", "holding"}])
def test_a_drive_with_samples_lost_is_done_once_more(lost: set[str]) -> None:
    client, rig = remote(lost)
    assert sum(rig.drive(1.0, 0.2).volts for _ in range(2)) == 2.0
    assert client.drives == 3


def test_losses_again_and_again_are_told() -> None:
    client, rig = remote(*[{"exciting"}] * MAX_TRIES)
    with pytest.raises(CalibrationError, match="20 samples were lost"):
        rig.drive(1.0, 0.2)
    assert client.drives == MAX_TRIES


def test_nothing_old_is_left_for_whoever_comes_next() -> None:
    client, rig = remote()
    rig.close()
    assert client.subscribed == client.coming == []
    assert client.forgotten == 1


def test_tones_are_recorded_while_they_are_on_and_the_rig_hears_of_us() -> None:
    client, rig = remote({"exciting"})
    samples = rig.excite(0.5, 0.2, [[5.0, 0.5, 0.0]])
    assert (client.tones, client.drives) == ([[5.0, 0.5, 0.0]], 2)
    assert [sample["state"] for sample in samples] == ["exciting"] * 20
    assert client.kept_alive >= 2
