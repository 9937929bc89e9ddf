"""What every driver must do (drivers/base.py). A new driver joins by one line in `BENCHES`."""

from __future__ import annotations

import functools
import itertools
import json
import math
import time
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Protocol

import can
import pytest

from drivers import TABLE, driver_class
from drivers.base import NO_SAMPLE, Driver, DriverError, DriverStateError
from drivers.can_codec import CanCodec
from drivers.can_config import CanOptions
from drivers.neutral import open_neutral
from tests.unit.record_rows import rows, write_recording
from tests.unit.serial_bench import SerialBench

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

CONFIGS = Path(__file__).parents[2] / "configs"
CHANNELS = itertools.count()


class Bench(Protocol):
    """A driver with the other end of its line in the test's hand; samples come only when the test says so."""

    driver: Driver
    inputs: Sequence[str]
    outputs: Sequence[str]
    simulated: bool
    """The rig's true values are known."""
    silent: bool
    """Nothing arrives before the first `sample`."""

    def sample(self, value: float) -> None:
        """A new sample of the first input is on its way."""

    def commands(self) -> list[list[float]]:
        """Values of the outputs that arrived since the last call."""

    def cut(self) -> bool:
        """Break the line; False where there is none."""

    def close(self) -> None:
        """Close the other end."""


class CanBench:
    """The `can` driver on python-can's virtual bus; the peer holds the rig's end of the same DBC."""

    inputs = ("Encoder.angle", "Encoder.run_enable")
    outputs = ("Valve.voltage",)
    simulated = False
    silent = True

    def __init__(self, clock: Callable[[], float]) -> None:
        channel = f"contract{next(CHANNELS)}"
        section = {"kind": "can", "interface": "virtual", "channel": channel, "dbc": "motor.dbc"}
        options = CanOptions.model_validate(section, context={"directory": CONFIGS})
        self.codec = CanCodec(options)
        self.peer = can.Bus(interface="virtual", channel=channel, ignore_config=True)
        self.driver: Driver = driver_class("can")(options, clock)
        self.counter = 0

    def sample(self, value: float) -> None:
        data = self.codec.encode("Encoder", {"angle": value, "run_enable": 1}, self.counter)
        self.counter += 1
        self.peer.send(can.Message(arbitration_id=257, is_extended_id=False, data=data))

    def commands(self) -> list[list[float]]:
        values = []
        while (message := self.peer.recv(0)) is not None:
            decoded = self.codec.decode(message.arbitration_id, message.is_extended_id, message.data)
            values.append([decoded.values["voltage"]])
        return values

    def cut(self) -> bool:
        self.driver._link._bus.shutdown()  # type: ignore[attr-defined]
        return True

    def close(self) -> None:
        self.peer.shutdown()


class VirtualBench:
    """The `virtual` driver in real time: its plant is always there, and shows its commands by moving."""

    inputs = ("angle", "estop")
    outputs = ("valve",)
    simulated = True
    silent = False

    def __init__(self, clock: Callable[[], float]) -> None:
        plant = {"input": "valve", "output": "angle", "K_L": 17.0, "omega_n": 100.0, "zeta": 0.3}
        simulation = {"plants": {"motor": plant}, "constants": {"estop": 1.0}}
        kind = driver_class("virtual")
        self.driver: Driver = kind(
            kind.Options.model_validate({"kind": "virtual", "simulation": simulation}), clock
        )
        self.seen: list[list[float]] = []
        self._watch()

    def _watch(self) -> None:
        write = self.driver.write

        def spy(t: float, values: Sequence[float]) -> float:
            left = write(t, values)
            self.seen.append(list(values))
            return left

        self.driver.write = spy  # type: ignore[method-assign]  # neutral goes through write

    def sample(self, value: float) -> None:
        time.sleep(0.001)

    def commands(self) -> list[list[float]]:
        seen, self.seen = self.seen, []
        return seen

    def cut(self) -> bool:
        return False

    def close(self) -> None:
        pass


@functools.cache
def ten_seconds() -> bytes:
    with TemporaryDirectory() as folder:
        path = Path(folder) / "a.mcap"
        write_recording(path, rows(20_000))
        return path.read_bytes()


class ReplayBench:
    """The `replay` driver in real time on ten seconds of a recording; its commands go nowhere."""

    inputs = ("angle", "pressure")
    outputs = ("valve",)
    simulated = False
    silent = False

    def __init__(self, clock: Callable[[], float]) -> None:
        self.folder = TemporaryDirectory()
        path = Path(self.folder.name) / "a.mcap"
        path.write_bytes(ten_seconds())
        kind = driver_class("replay")
        self.driver: Driver = kind(kind.Options.model_validate({"kind": "replay", "file": str(path)}), clock)
        self.seen: list[list[float]] = []
        self._watch()

    _watch = VirtualBench._watch
    commands = VirtualBench.commands
    sample = VirtualBench.sample
    cut = VirtualBench.cut

    def close(self) -> None:
        self.folder.cleanup()


BENCHES = {"can": CanBench, "replay": ReplayBench, "serial": SerialBench, "virtual": VirtualBench}


def test_every_built_in_driver_is_under_contract() -> None:
    assert set(BENCHES) == set(TABLE)


@pytest.fixture(params=sorted(BENCHES))
def bench(request: pytest.FixtureRequest) -> Iterator[Bench]:
    bench = BENCHES[request.param](time.monotonic)
    yield bench
    bench.driver.close()
    bench.close()


@pytest.fixture
def running(bench: Bench) -> Bench:
    bench.driver.open(bench.inputs, bench.outputs)
    bench.driver.start()
    return bench


def test_calls_before_opening_say_what_to_call_first(bench: Bench) -> None:
    driver = bench.driver
    calls: list[Callable[[], object]] = [
        driver.start,
        lambda: driver.read(0.0),
        lambda: driver.write(0.0, [0.0]),
        lambda: driver.neutral(0.0),
        lambda: driver.wait(0.0),
    ]
    for call in calls:
        with pytest.raises(DriverStateError, match=r"call (open|start)"):
            call()


def test_opening_twice_is_refused(running: Bench) -> None:
    with pytest.raises(DriverStateError, match="close"):
        running.driver.open(running.inputs, running.outputs)


def test_after_closing_the_calls_are_refused_again(running: Bench) -> None:
    running.driver.close()
    with pytest.raises(DriverStateError, match="call open"):
        running.driver.read(0.0)
    with pytest.raises(DriverStateError, match="call open"):
        running.driver.write(0.0, [0.0])


def test_closing_twice_and_in_any_state_is_fine(bench: Bench) -> None:
    bench.driver.close()
    bench.driver.open(bench.inputs, bench.outputs)
    bench.driver.close()
    bench.driver.close()


def test_a_closed_driver_can_be_opened_again(running: Bench) -> None:
    running.driver.close()
    running.driver.open(running.inputs, running.outputs)
    running.driver.start()
    running.driver.write(time.monotonic(), [1.0])
    assert running.commands() == [[1.0]]


def test_unknown_channels_are_refused_with_those_there_are(bench: Bench) -> None:
    with pytest.raises(DriverError, match=bench.inputs[0]):
        bench.driver.open(["no.such"], bench.outputs)
    with pytest.raises(DriverError, match=bench.outputs[0]):
        bench.driver.open(bench.inputs, ["no.such"])
    bench.driver.open(bench.inputs, bench.outputs)


def test_channels_are_unique_and_hold_what_can_be_opened(bench: Bench) -> None:
    channels = type(bench.driver).channels(bench.driver.options)
    names = [channel.name for channel in channels]
    assert len(set(names)) == len(names)
    direction = {channel.name: channel.direction for channel in channels}
    assert {direction[name] for name in bench.inputs} == {"input"}
    assert {direction[name] for name in bench.outputs} == {"output"}
    assert all(channel.minimum < channel.maximum for channel in channels)


def test_before_the_first_sample_there_is_none(running: Bench) -> None:
    samples = running.driver.read(time.monotonic())
    assert len(samples) == len(running.inputs)
    if running.silent:
        assert list(samples) == [NO_SAMPLE] * len(running.inputs)


def test_samples_keep_the_order_of_the_inputs(bench: Bench) -> None:
    driver, names = bench.driver, bench.inputs[::-1]
    driver.open(names, bench.outputs)
    driver.start()
    bench.sample(0.25)
    enable, angle = driver.read(time.monotonic())
    assert enable.value == 1.0
    assert angle.value != 1.0


def test_a_new_sample_has_a_new_time_and_is_not_in_the_future(running: Bench) -> None:
    last = -math.inf
    for value in range(5):
        before = time.monotonic()
        running.sample(float(value))
        sample = running.driver.read(time.monotonic())[0]
        assert sample.t > last
        assert before - 0.001 <= sample.t <= time.monotonic()
        last = sample.t


def test_how_far_stamps_may_be_off_is_a_deviation_or_unknown(running: Bench) -> None:
    for value in range(5):
        running.sample(float(value))
        running.driver.read(time.monotonic())
        assert all(math.isnan(sd) or 0.0 <= sd < math.inf for sd in running.driver.stamp_error())


def test_some_delay_is_left_open(running: Bench) -> None:
    """Whatever the stamps tell, a device at either end may let a reading or a command wait."""
    assert 1.0 <= running.driver.untold_delay(0.5) < math.inf


def test_waiting_ends_with_a_sample(running: Bench) -> None:
    if not running.driver.push:
        with pytest.raises(DriverStateError, match="timer"):
            running.driver.wait(time.monotonic())
        return
    running.sample(1.0)
    assert running.driver.wait(time.monotonic() + 5.0)


def test_waiting_ends_at_the_deadline(running: Bench) -> None:
    if not running.driver.push:
        return
    running.sample(1.0)
    running.driver.read(time.monotonic())
    deadline = time.monotonic() + 1e-5
    assert running.driver.wait(deadline) or time.monotonic() >= deadline


def test_commands_arrive_in_order_and_tell_when_they_left(running: Bench) -> None:
    for volts in (1.0, -2.0):
        before = time.monotonic()
        left = running.driver.write(before, [volts])
        assert before <= left <= time.monotonic()
        running.driver.read(time.monotonic())
    assert running.commands() == [[1.0], [-2.0]]


def test_neutral_is_zero_unless_told_otherwise(running: Bench) -> None:
    running.driver.write(time.monotonic(), [3.0])
    assert math.isfinite(running.driver.neutral(time.monotonic()))
    assert running.commands()[-1] == [0.0]


def test_neutral_is_what_opening_said(bench: Bench) -> None:
    bench.driver.open(bench.inputs, bench.outputs, [2.5])
    bench.driver.start()
    bench.driver.neutral(time.monotonic())
    assert bench.commands()[-1] == [2.5]


def test_the_time_of_leaving_is_true_or_unknown(running: Bench) -> None:
    before = time.monotonic()
    running.driver.write(before, [1.0])
    running.driver.read(time.monotonic())
    left = running.driver.left()
    assert len(left) in (0, len(running.outputs))
    assert all(math.isnan(t) or before <= t <= time.monotonic() for t in left)


def test_counters_have_the_length_of_their_names_and_count(running: Bench) -> None:
    driver = running.driver
    assert len(driver.counters) == len(driver.counter_names) == len(set(driver.counter_names))
    before = list(driver.counters)
    running.sample(1.0)
    driver.read(time.monotonic())
    driver.write(time.monotonic(), [1.0])
    assert sum(driver.counters) > sum(before)
    assert all(new >= old >= 0 for new, old in zip(driver.counters, before, strict=True))


def test_a_rig_in_order_is_no_trouble(running: Bench) -> None:
    running.sample(1.0)
    running.driver.read(time.monotonic())
    running.driver.write(time.monotonic(), [1.0])
    assert running.driver.trouble == ""


def test_a_line_that_breaks_is_told_and_never_raises(running: Bench) -> None:
    if not running.cut():
        pytest.skip("no line to break")
    driver = running.driver
    for _ in range(3):
        driver.read(time.monotonic())
        assert math.isnan(driver.write(time.monotonic(), [1.0]))
        assert math.isnan(driver.neutral(time.monotonic()))
        assert driver.trouble != ""


def test_the_neutral_recipe_goes_through_json_and_opens(running: Bench) -> None:
    recipe = running.driver.neutral_recipe()
    writer = open_neutral(json.loads(json.dumps(recipe)))
    assert recipe["kind"] != "none" or writer.write(0) == recipe["why"]
    writer.close()


def test_truth_is_that_of_simulated_rigs_only(running: Bench) -> None:
    for plant in running.driver.truth().values():
        assert set(plant) == {"K_L", "omega_n", "zeta"}
    assert bool(running.driver.truth()) == running.simulated


def test_options_go_through_json(bench: Bench) -> None:
    options = bench.driver.options
    assert type(options).model_validate(json.loads(options.model_dump_json())) == options


@pytest.mark.parametrize("kind", TABLE)
def test_a_class_says_what_its_commands_reach_and_who_plays_the_other_end(kind: str) -> None:
    driver = driver_class(kind)
    assert (driver.acts_on == "rig") == bool(driver.peer)
    if driver.peer:
        assert callable(import_module(driver.peer).run)
