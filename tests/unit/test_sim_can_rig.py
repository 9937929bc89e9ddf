"""The rig's end of the bus, on python-can's `virtual` interface, stepped by the test."""

from __future__ import annotations

import itertools
import math
import os
import signal
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import can
import pytest

from drivers.base import DriverError
from drivers.can_codec import CanCodec
from drivers.can_config import CanOptions
from sim.back_door import BackDoor
from sim.can_rig import CanRig, run
from sim.config import SimulationConfig
from sim.process import POLL_S, RigProcess

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

DBC = Path(__file__).parents[2] / "configs" / "motor.dbc"
TURNS = 3000

_channels = itertools.count()


def make_options(**changes: object) -> CanOptions:
    values: dict[str, object] = {
        "kind": "can",
        "interface": "virtual",
        "channel": f"rig-test-{next(_channels)}",
        "dbc": str(DBC),
        "messages": {"Supply": {"rate_hz": 250.0}},
    }
    return CanOptions.model_validate({**values, **changes})


def make_simulation(**changes: object) -> SimulationConfig:
    plant = {
        "input": "Valve.voltage",
        "output": "Encoder.angle",
        "K_L": 17.0,
        "omega_n": 100.0,
        "zeta": 0.3,
    }
    values: dict[str, object] = {
        "plants": {"motor": plant},
        "constants": {"Encoder.run_enable": 1.0, "Supply.pressure": 7e6},
        "sensor_rate_hz": 1000.0,
        "watchdog_s": 10.0,
    }
    return SimulationConfig.model_validate({**values, **changes})


class Peer:
    """The daemon's end of the bus, and a rig that it steps while it waits."""

    def __init__(self, options: CanOptions, simulation: SimulationConfig) -> None:
        self.stopped_clock: float | None = None
        self.rig = CanRig(options, simulation, self.now)
        self.rig.open()
        names = [message.name for message in self.rig.messages]
        self.door = BackDoor(self.rig.rig, self.rig.faults, names, self.rig.state, time.monotonic)
        self.bus = can.Bus(interface="virtual", channel=options.channel, ignore_config=True)
        self.codec = CanCodec(options)
        self.sent = 0

    def close(self) -> None:
        self.bus.shutdown()
        self.rig.close()

    def now(self) -> float:
        return self.stopped_clock or time.monotonic()

    def step(self, longest: float) -> None:
        self.rig.step(self.now(), longest)

    def command(self, volts: float, counter: int | None = None, damage: int = 0) -> None:
        data = bytearray(
            self.codec.encode("Valve", {"voltage": volts}, self.sent if counter is None else counter)
        )
        data[0] ^= damage
        self.send(0x201, bytes(data))
        self.sent += 1

    def send(self, number: int, data: bytes) -> None:
        self.bus.send(can.Message(arbitration_id=number, data=data, is_extended_id=False))

    def step_until(self, condition: Callable[[], bool]) -> None:
        for _ in range(TURNS):
            if condition():
                return
            self.step(0.005)
        raise AssertionError(f"never came; the rig says {self.rig.state()}")

    def frames(self, count: int) -> list[can.Message]:
        found: list[can.Message] = []

        def enough() -> bool:
            found.extend(iter(lambda: self.bus.recv(0), None))
            return len(found) >= count

        self.step_until(enough)
        return found

    def encoder(self, count: int) -> list[Any]:
        """So many sensor frames, decoded."""
        found: list[Any] = []
        while len(found) < count:
            decoded = [self.codec.decode(m.arbitration_id, False, bytes(m.data)) for m in self.frames(1)]
            found += [d for d in decoded if d.message == "Encoder"]
        return found

    def nothing_comes(self) -> bool:
        for _ in range(10):
            self.step(0.002)
        return self.bus.recv(0) is None

    def state(self) -> Any:
        return self.door.state({})


@pytest.fixture
def connect() -> Iterator[Callable[..., Peer]]:
    peers: list[Peer] = []

    def make(options: CanOptions | None = None, simulation: SimulationConfig | None = None) -> Peer:
        peers.append(Peer(options or make_options(), simulation or make_simulation()))
        return peers[-1]

    yield make
    for peer in peers:
        peer.close()


def test_sensor_frames_come_whole_counted_and_at_their_own_rates(connect: Callable[..., Peer]) -> None:
    peer = connect()
    decoded = [peer.codec.decode(m.arbitration_id, False, bytes(m.data)) for m in peer.frames(50)]
    encoder = [d for d in decoded if d.message == "Encoder"]
    supply = [d for d in decoded if d.message == "Supply"]
    assert all(d.checksum_ok for d in decoded)
    assert [d.counter for d in encoder] == list(range(len(encoder)))
    assert len(supply) == math.ceil(len(encoder) / 4)
    assert encoder[0].values["run_enable"] == 1
    assert supply[0].values["pressure"] == 7e6


def test_a_command_moves_the_plant_and_is_remembered(connect: Callable[..., Peer]) -> None:
    peer = connect()
    before = time.monotonic()
    peer.command(0.5)
    peer.step_until(lambda: peer.rig.counts["commands"] == 1)
    ((t, volts),) = peer.door.history({"plant": "motor"})
    assert volts == 0.5
    assert before - 1e-3 <= t <= time.monotonic()
    peer.step_until(lambda: peer.state()["plants"]["motor"]["position"] > 0.05)
    assert peer.encoder(1)[-1].values["angle"] > 0.04


def test_the_amplifier_goes_neutral_when_commands_stop(connect: Callable[..., Peer]) -> None:
    peer = connect(simulation=make_simulation(watchdog_s=0.01))
    peer.command(0.5)
    peer.step_until(lambda: peer.state()["plants"]["motor"]["watchdog_trips"] == 1)
    motor = peer.state()["plants"]["motor"]
    ((t, _),) = peer.door.history({})
    assert motor["voltage"] == 0.0
    assert motor["neutral_since"] == pytest.approx(t + 0.01, abs=1e-9)


def test_damaged_lost_and_repeated_commands_are_told_apart(connect: Callable[..., Peer]) -> None:
    peer = connect()
    for counter, damage in [(0, 0), (1, 0), (1, 0), (4, 0), (5, 1)]:
        peer.command(0.1, counter, damage)
    peer.send(0x201, b"\x00")
    peer.step_until(lambda: peer.rig.counts["unknown_frames"] == 1)
    counts = peer.rig.counts
    assert (counts["commands"], counts["repeated_commands"]) == (4, 1)
    assert (counts["lost_commands"], counts["bad_commands"]) == (2, 1)


def test_nothing_is_sent_before_every_start_frame(connect: Callable[..., Peer]) -> None:
    peer = connect(make_options(start_frames=[{"id": 0, "data": "01 00"}, {"id": 0, "data": "01 05"}]))
    peer.send(0, b"\x01\x00")
    assert peer.nothing_comes()
    assert peer.state()["started"] is False
    peer.send(0, b"\x01\x05")
    assert peer.encoder(2)
    assert peer.state()["started"] is True


def test_with_tick_frames_each_tick_is_answered_once(connect: Callable[..., Peer]) -> None:
    peer = connect(make_options(tick_frames=[{"id": 0x80}]))
    assert peer.nothing_comes()
    for expected in range(3):
        peer.send(0x80, b"")
        assert peer.encoder(1)[0].counter == expected
    assert peer.nothing_comes()


def test_faults_strike_what_is_sent(connect: Callable[..., Peer]) -> None:
    peer = connect()
    peer.door.methods["corrupt"]({"probability": 1.0, "message": "Encoder"})
    assert not any(d.checksum_ok for d in peer.encoder(5)[1:])
    peer.door.clear({})
    peer.door.fault({"kind": "stop"})
    peer.frames(0)
    assert peer.nothing_comes()
    assert peer.state()["faults"] == {"stop": {"kind": "stop"}}
    assert peer.state()["struck"]["stop"] > 0


def test_a_frozen_sensor_counts_on_but_does_not_move(connect: Callable[..., Peer]) -> None:
    peer = connect(simulation=make_simulation(seed=2))
    peer.door.set({"plant": "motor", "noise": 1.0})
    free = {d.values["angle"] for d in peer.encoder(5)}
    assert len(free) >= 5
    peer.door.fault({"kind": "freeze"})
    peer.frames(1)  # what was on its way
    frozen = peer.encoder(10)
    assert len({d.values["angle"] for d in frozen}) == 1
    assert len({d.counter for d in frozen}) == len(frozen)


def test_the_e_stop_line_opens_on_command(connect: Callable[..., Peer]) -> None:
    peer = connect()
    peer.encoder(1)
    peer.door.constant({"channel": "Encoder.run_enable", "value": 0})
    peer.frames(1)
    assert peer.encoder(1)[-1].values["run_enable"] == 0


def test_the_truth_follows_a_set(connect: Callable[..., Peer]) -> None:
    peer = connect()
    assert peer.door.truth({}) == {"motor": {"K_L": 17.0, "omega_n": 100.0, "zeta": 0.3}}
    peer.door.set({"plant": "motor", "omega_n": 80.0})
    assert peer.door.truth({})["motor"]["omega_n"] == 80.0  # type: ignore[index]  # methods give any JSON


@pytest.mark.parametrize(
    ("method", "params", "why"),
    [
        ("fault", {"kind": "drop", "probability": 0.5, "message": "Nobody"}, "sends Encoder, Supply"),
        ("drop", {}, "drop needs probability"),
        ("set", {"plant": "wing"}, "there are motor"),
        ("set", {"plant": ["motor"]}, "there are motor"),
        ("constant", {"channel": "Valve.voltage", "value": 1.0}, "there are Encoder.run_enable"),
        ("constant", {"channel": "Supply.pressure", "value": "much"}, "valid number"),
    ],
)
def test_the_back_door_says_what_is_wrong(
    connect: Callable[..., Peer], method: str, params: dict[str, Any], why: str
) -> None:
    with pytest.raises(ValueError, match=why):
        connect().door.methods[method](params)


def test_turns_that_were_missed_are_not_made_up(connect: Callable[..., Peer]) -> None:
    peer = connect()
    peer.encoder(1)
    list(iter(lambda: peer.bus.recv(0), None))
    late_before = peer.rig.counts["late_sensors"]
    peer.stopped_clock = time.monotonic() + 0.05  # fifty turns later, all at once
    for _ in range(10):
        peer.step(0.0)
    sent = list(iter(lambda: peer.bus.recv(0), None))
    assert [m.arbitration_id for m in sent].count(0x101) == 1
    assert peer.rig.counts["late_sensors"] == late_before + 1


class BusOfErrors:
    """A bus whose interface is down: python-can's errors, until it is mended."""

    def __init__(self, bus: can.BusABC) -> None:
        self.bus = bus
        self.errors = 0

    def recv(self, _timeout: float) -> None:
        self._fail()

    def send(self, _message: can.Message) -> None:
        self._fail()

    def _fail(self) -> None:
        self.errors += 1
        raise can.CanOperationError("Network is down", 100)

    def shutdown(self) -> None:
        self.bus.shutdown()


def test_a_bus_that_fails_is_tried_again_until_it_works(
    connect: Callable[..., Peer], monkeypatch: pytest.MonkeyPatch
) -> None:
    peer = connect()
    peer.encoder(1)
    link: Any = peer.rig._link
    healthy = link._bus
    broken = BusOfErrors(healthy)
    monkeypatch.setattr(link, "_bus", broken)
    peer.step_until(lambda: broken.errors >= 10)
    assert "down" in str(peer.state()["trouble"])
    monkeypatch.setattr(link, "_bus", healthy)
    assert peer.encoder(2)
    assert peer.state()["trouble"] == ""


@pytest.mark.parametrize(
    "changes",
    [
        {"constants": {"Encoder.missing": 1.0}},
        {"constants": {"Valve.voltage": 1.0}},
        {"constants": {"nowhere": 1.0}},
    ],
)
def test_a_simulation_that_the_dbc_does_not_carry_is_refused(changes: dict[str, object]) -> None:
    with pytest.raises(DriverError, match=r"no input channel .* there are Encoder.angle"):
        CanRig(make_options(), make_simulation(**changes))


def test_a_second_process_cannot_reach_a_virtual_interface() -> None:
    with pytest.raises(DriverError, match="only within one process"):
        run(make_options(), make_simulation(), control_port=0)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_ends_the_process_after_the_step(number: signal.Signals) -> None:
    before = signal.getsignal(number)
    steps = []
    with RigProcess(None) as process:

        def step(now: float, longest: float) -> float:
            steps.append(longest)
            if len(steps) == 3:
                os.kill(os.getpid(), number)
            return now

        process.repeat(step, lambda: None)
    assert len(steps) == 3
    assert signal.getsignal(number) == before


def test_a_duration_ends_the_process() -> None:
    polls = []
    with RigProcess(60.0) as process:
        process.repeat(lambda now, longest: now + longest, lambda: polls.append(1))
    assert len(polls) == pytest.approx(60.0 / POLL_S, rel=0.05)
