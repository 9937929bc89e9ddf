"""The daemon on a serial line whose other end is a process of its own: `seod rig`, or the firmware in C.

What both go on after, with the rig file as it is, stands in `test_serial_goes_on`, so that one pair serves.
"""

from __future__ import annotations

import shutil
import signal
import subprocess
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from seod.config.load import load_rig
from seod.config.truth import truth
from seod.files.shipped import configs_dir
from tests.peers import ROOM, Program, Rpc, find_process, free_port, kill, port_of, port_open, until

if TYPE_CHECKING:
    from collections.abc import Iterator

pytestmark = pytest.mark.processes

FIRMWARE = Path(__file__).parents[1] / "drivers" / "firmware"


def write_rig_file(folder: Path, name: str = "serial") -> Path:
    """A shipped serial rig with a port and a line of its own, and patience with a busy machine."""
    port = free_port()
    text = (configs_dir() / f"{name}.yaml").read_text()
    for old, new in (
        ("version: 1\nrig: ", f"version: 1\nrig: on-{port}-"),
        ("port: 7600", f"port: {port}\n  panel: false"),
        ("control_port: 7601", "control_port: 0"),
        ("port: /tmp/seod-", f"port: {folder}/"),
        ("hang_timeout: 200 ms", "hang_timeout: 1 s"),
        ("stale: 50 ms", "stale: 200 ms\n  overruns: {count: 1000, window: 1 s}"),
        ("rig_watchdog: 50 ms", "rig_watchdog: 500 ms"),
        ("kind: serial", "kind: serial\n  confirm_timeout_s: 1.0"),
        ("  watchdog_s: 0.05", "  watchdog_s: 0.5"),
        *(ROOM if name == "serial" else ()),
    ):
        assert old in text, old
        text = text.replace(old, new)
    path = folder / "rig.yaml"
    path.write_text(text)
    return path


@pytest.fixture
def rig_file(tmp_path: Path) -> Path:
    return write_rig_file(tmp_path)


class Daemon:
    """`seod run` and a client."""

    def __init__(self, rig_file: Path) -> None:
        self.program = Program(rig_file.with_suffix(".log"), "run", rig_file)
        self.port = port_of(rig_file)
        until("the port", lambda: port_open(self.port) or self.program.process.poll() is not None)
        assert self.program.process.poll() is None, self.program.said()
        self.connect()

    def connect(self) -> None:
        """Be a new client, once its loop ticks."""
        self.rpc = Rpc(self.port)
        self.rpc.call("subscribe", topics=["event", "estimate", "health"])
        until("the loop", lambda: self.rpc.call("status")["health"]["ticks"])

    def counter(self, name: str) -> int:
        found: int = self.rpc.call("status")["health"]["counters"][name]
        return found

    def estimates(self, count: int) -> list[dict[str, float]]:
        """So many more that are `ok`."""
        fits = lambda m: m.get("method") == "estimate" and m["params"]["quality"] == "ok"  # noqa: E731
        return [self.rpc.wait_for("an estimate", fits)["params"] for _ in range(count)]

    def close(self) -> None:
        self.rpc.close()
        self.program.stop()
        print(self.program.said())


@pytest.fixture
def rig(rig_file: Path) -> Iterator[Rpc]:
    """The back door of `seod rig`."""
    program = Program(rig_file.with_suffix(".rig.log"), "rig", rig_file)
    rpc = Rpc(program.ready()["control_port"])
    yield rpc
    rpc.close()
    program.stop()
    print(program.said())


@pytest.fixture
def daemon(rig: Rpc, rig_file: Path) -> Iterator[Daemon]:
    daemon = Daemon(rig_file)
    yield daemon
    daemon.close()


@pytest.fixture
def amplifier_file(rig_file: Path) -> Path:
    """The rig with enable and mode bytes in its commands, and a validity byte in its samples."""
    text = rig_file.read_text()
    valve = "  - {name: valve, type: int16, scale: 1.0e-3, unit: V}\n"
    output = "    channel: valve\n    unit: V\n"
    sensor = "    channel: angle\n    unit: rad\n"
    for old, new in (
        (valve, "  - {name: drive_on, type: uint8}\n  - {name: mode, type: uint8}\n" + valve),
        (
            "  - {name: run_enable, type: uint8}\n",
            "  - {name: run_enable, type: uint8}\n  - {name: sound, type: uint8}\n",
        ),
        (output, output + "    enable: {channel: drive_on, on: 5, off: 1}\n    fixed: {mode: 3}\n"),
        (sensor, sensor + "    valid: {channel: sound, is: 2}\n"),
        ("      input: valve\n", "      input: valve\n      enabled_by: {drive_on: 5, mode: 3}\n"),
        ("    run_enable: 1\n", "    run_enable: 1\n    sound: 2\n"),
    ):
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    rig_file.write_text(text)
    return rig_file


@pytest.fixture
def amplifier(amplifier_file: Path, rig: Rpc) -> Rpc:
    """Its back door: the board reads the rig file with all of that."""
    return rig


def test_the_boards_amplifier_is_enabled_only_while_it_moves(amplifier: Rpc, daemon: Daemon) -> None:
    enabled = lambda: amplifier.call("state")["plants"]["motor"]["enabled"]  # noqa: E731
    assert enabled() is False
    daemon.rpc.call("start")
    daemon.estimates(2)  # it obeys
    assert enabled() is True
    kill(find_process("seod.loop", daemon.program.pid), signal.SIGKILL)
    until("neutral by the supervisor", lambda: enabled() is False)
    assert amplifier.call("state")["plants"]["motor"]["watchdog_trips"] == 0


def test_readings_that_the_board_calls_invalid_stop_the_rig(amplifier: Rpc, daemon: Daemon) -> None:
    daemon.rpc.call("start")
    daemon.estimates(1)
    amplifier.call("constant", channel="sound", value=0.0)
    fault = daemon.rpc.event(event="fault")
    assert fault["code"] == "stale_sample"
    assert "sound reads 0: readings are valid at 2" in fault["why"]


def test_a_line_with_nobody_at_its_end_is_told(rig_file: Path) -> None:
    program = Program(rig_file.with_suffix(".log"), "run", rig_file)
    assert program.wait() != 0
    assert "there is no such port" in program.said()


def test_the_example_of_an_arduino(tmp_path: Path) -> None:
    rig_file = write_rig_file(tmp_path, "arduino")
    program = Program(rig_file.with_suffix(".rig.log"), "rig", rig_file)
    back_door = Rpc(program.ready()["control_port"])
    try:
        assert_found(rig_file, 117.0, 0.21)
    finally:
        back_door.close()
        program.stop()


HYDRAULIC = """      plant: hydraulic
      input: valve
      output: angle
      noise: 4.0e-5
      stops: [-1.5, 1.5]
      hydraulic:
        supply: {pressure: 8.0e6}
        valve: {rated_flow: 5.0e-4, rated_drop: 2.1e7, leakage: 1.2e-5}
        oil: {air: 0.01}
        motor: {displacement: 1.75e-6, volume: 5.0e-5}
        leakage: {cross: 1.0e-12}
        load: {inertia: 1.92e-2}
"""
"""A valve, two chambers and a motor: the small movements of 0.02 V are those of Eq. 1.

To 0.06 % of the motion, which a sensor without noise would show; it has as much as the reduced rig's, in
proportion to the movement.
"""


def test_a_hydraulic_rig_at_the_other_end_of_the_line(rig_file: Path) -> None:
    text = rig_file.read_text()
    begin, end = text.index("      input: valve\n"), text.index("  constants:\n")
    text = text[:begin] + HYDRAULIC + text[end:]
    for old, new in (
        ("e_a: 0.5 V", "e_a: 0.02 V"),
        ("hysteresis: 4 mrad", "hysteresis: 0.16 mrad"),
        ("movement: 30 mrad", "movement: 1 mrad"),
        ("scale: 1.0e-5", "scale: 1.0e-7"),
    ):
        assert old in text, old
        text = text.replace(old, new)
    rig_file.write_text(text)
    told = truth(load_rig(rig_file))["motor"]
    rig_file.write_text(text.replace("K_L: 17 ", f"K_L: {told['K_L']:.6g} "))
    program = Program(rig_file.with_suffix(".rig.log"), "rig", rig_file)
    back_door = Rpc(program.ready()["control_port"])
    try:
        assert_found(rig_file, told["omega_n"] or 0.0, told["zeta"] or 0.0)
        back_door.call("set", plant="motor", hydraulic={"oil": {"air": 0.05}})
        assert back_door.call("truth")["motor"]["omega_n"] < 0.95 * told["omega_n"]
    finally:
        back_door.close()
        program.stop()


def assert_found(rig_file: Path, omega_n: float, zeta: float) -> None:
    """A daemon on this rig comes to these values."""
    daemon = Daemon(rig_file)
    try:
        until("a sample", lambda: daemon.counter("samples"))
        daemon.rpc.call("start")
        last = daemon.estimates(10)[-1]
        assert last["omega_n"] == pytest.approx(omega_n, rel=0.03)
        assert last["zeta"] == pytest.approx(zeta, rel=0.1)
    finally:
        daemon.close()


@pytest.fixture(scope="module")
def firmware(tmp_path_factory: pytest.TempPathFactory) -> Path:
    if shutil.which("gcc") is None:
        pytest.fail("no gcc: `apt-get install gcc libc6-dev`")
    target = tmp_path_factory.mktemp("firmware") / "board"
    sources = [FIRMWARE / name for name in ("seod_frame.c", "seod_board.c", "posix/main.c")]
    strict = ["-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wshadow", "-Werror"]
    subprocess.run(
        ["gcc", "-std=c99", "-O2", *strict, *map(str, sources), "-lm", "-o", str(target)], check=True
    )
    return target


def test_zeta_from_the_reference_firmware(firmware: Path, rig_file: Path) -> None:
    line = str(rig_file.with_name("board"))
    board = subprocess.Popen([firmware, line, "95", "0.35"], stdout=subprocess.PIPE)
    assert board.stdout is not None
    try:
        assert b"ready" in board.stdout.readline()
        assert_found(rig_file, 95.0, 0.35)
    finally:
        board.terminate()
        board.wait()
        board.stdout.close()
