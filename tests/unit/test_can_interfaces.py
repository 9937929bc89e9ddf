"""Interfaces of python-can as they are, or as its own code makes them of an adapter that the test plays."""

from __future__ import annotations

import ast
import json
import os
import shutil
import subprocess
import sys
import time
import tty
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import TYPE_CHECKING, Any

import can
import can.interfaces
import pytest

from drivers.can import CanDriver
from drivers.can_interfaces import ECHOES, asks_for_echo, echo_of, interface_warnings
from seod.config.check import check
from seod.config.load import load_text
from seod.files.shipped import configs_dir
from tests.peers import until
from tests.unit.can_bench import CODEC, ENCODER, VALVE, options

if TYPE_CHECKING:
    from collections.abc import Iterator

TAKEOVER_S = 1.0


def running(**changes: object) -> CanDriver:
    driver = CanDriver(options(**changes), time.monotonic)
    driver.open(["Encoder.angle"], ["Valve.voltage"])
    driver.start()
    driver._outputs._takeover = (0.0, frozenset())
    return driver


def read_until_foreign(driver: CanDriver) -> None:
    """Ticks until it has heard a foreign command."""
    until("a foreign command", lambda: driver.read(time.monotonic()) and driver.foreign_commands)


def counted(driver: CanDriver, name: str) -> int:
    return driver.counters[driver.counter_names.index(name)]


def test_virtual_buses_of_one_process_tell_who_sent() -> None:
    driver = running(interface="virtual", channel="who")
    with can.Bus(interface="virtual", channel="who", ignore_config=True) as peer:
        for volts in (0.5, 1.0, 1.5):
            driver.write(time.monotonic(), [volts])
            driver.read(time.monotonic())
        assert driver.foreign_commands == 0
        own = peer.recv(0.0)
        assert own is not None
        peer.send(own)  # the very same bytes, by another
        driver.read(time.monotonic())
        assert driver.foreign_commands == 1
    driver.close()


class SlcanAdapter:
    """The other end of a serial line with an adapter that speaks the protocol of slcan."""

    def __init__(self) -> None:
        self.end, theirs = os.openpty()
        tty.setraw(theirs)
        os.set_blocking(self.end, False)
        self.port = os.ttyname(theirs)
        self._theirs = theirs
        self._said = b""

    def frames(self) -> list[tuple[int, bytes]]:
        """Classic frames that it was given for the bus so far."""
        with suppress(BlockingIOError):
            self._said += os.read(self.end, 65536)
        lines = [line for line in self._said.split(b"\r")[:-1] if line.startswith(b"t")]
        return [(int(line[1:4], 16), bytes.fromhex(line[5:].decode())) for line in lines]

    def hears(self, number: int, data: bytes) -> None:
        """A frame on the bus."""
        os.write(self.end, f"t{number:03X}{len(data)}{data.hex()}\r".encode())

    def close(self) -> None:
        os.close(self.end)
        os.close(self._theirs)


@pytest.fixture
def adapter() -> Iterator[SlcanAdapter]:
    it = SlcanAdapter()
    yield it
    it.close()


def test_slcan_hands_nothing_back_and_a_foreign_command_is_one(adapter: SlcanAdapter) -> None:
    driver = running(interface="slcan", channel=adapter.port, bus_options={"sleep_after_open": 0.0})
    for _ in range(20):
        driver.write(time.monotonic(), [1.5])
        driver.read(time.monotonic())
    assert driver.trouble == ""
    assert driver.foreign_commands == 0
    until("all commands", lambda: len(adapter.frames()) == 20)
    numbers, data = zip(*adapter.frames(), strict=True)
    assert set(numbers) == {VALVE}
    assert data == tuple(CODEC.encode("Valve", {"voltage": 1.5}, n) for n in range(20))
    adapter.hears(ENCODER, CODEC.encode("Encoder", {"angle": 0.25, "run_enable": 1}, 0))
    until("the sample", lambda: driver.read(time.monotonic())[0].value > 0.2)
    adapter.hears(VALVE, CODEC.encode("Valve", {"voltage": 1.5}, 3))
    read_until_foreign(driver)
    driver.close()


class GsUsbFrame(SimpleNamespace):
    """As of the package gs_usb: `echo_id` is 0xFFFFFFFF for what other nodes sent."""

    def __init__(self) -> None:
        super().__init__(echo_id=0, can_id=0, can_dlc=0, data=[0] * 8, timestamp=0.0)
        self.is_extended_id = self.is_remote_frame = self.is_error_frame = False

    @property
    def arbitration_id(self) -> int:
        return self.can_id & 0x1FFFFFFF


@pytest.fixture
def gs_usb_device(monkeypatch: pytest.MonkeyPatch) -> list[GsUsbFrame]:
    """Frames that the adapter has for the computer; it hands each of ours back, as candleLight does."""
    incoming: list[GsUsbFrame] = []

    class Device:
        device_capability = SimpleNamespace(fclk_can=48_000_000)

        def send(self, frame: GsUsbFrame) -> None:
            assert len(frame.data) == 8, "python-can pads the data"
            incoming.append(frame)

        def read(self, frame: GsUsbFrame, timeout_ms: int) -> bool:
            del timeout_ms
            if incoming:
                vars(frame).update(vars(incoming.pop(0)))
                return True
            return False

        def __getattr__(self, name: str) -> Any:
            return lambda *_, **__: None

    flags = {"CAN_EFF_FLAG": 1 << 31, "CAN_RTR_FLAG": 1 << 30, "CAN_ERR_FLAG": 1 << 29, "CAN_MAX_DLC": 8}
    made = {
        "usb": {"core": SimpleNamespace(USBError=OSError)},
        "gs_usb": {},
        "gs_usb.constants": flags,
        "gs_usb.gs_usb": {"GsUsb": SimpleNamespace(scan=lambda: [Device()], find=lambda **_: Device())},
        "gs_usb.gs_usb_frame": {"GS_USB_NONE_ECHO_ID": 0xFFFFFFFF, "GsUsbFrame": GsUsbFrame},
    }
    for name, content in made.items():
        module = ModuleType(name)
        vars(module).update(content)
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.delitem(sys.modules, "can.interfaces.gs_usb", raising=False)
    return incoming


def test_gs_usb_pads_the_data_and_marks_what_it_hands_back(gs_usb_device: list[GsUsbFrame]) -> None:
    driver = running(interface="gs_usb", channel="first", bus_options={"index": 0})
    for volts in (0.5, 1.0, 1.5, 2.0, 2.5):
        driver.write(time.monotonic(), [volts])
        driver.read(time.monotonic())
    assert driver.foreign_commands == 0
    assert counted(driver, "deferred") == 0, "each was confirmed"
    assert driver.left()[0] > 0.0
    foreign = GsUsbFrame()
    foreign.echo_id, foreign.can_id, foreign.can_dlc = 0xFFFFFFFF, VALVE, 4
    foreign.data = [*CODEC.encode("Valve", {"voltage": 2.5}, 4), 0, 0, 0, 0]
    gs_usb_device.append(foreign)
    driver.read(time.monotonic())
    assert driver.foreign_commands == 1
    driver.close()


MULTICAST = """
import json, sys, time
import can
from tests.unit.test_can_interfaces import counted, read_until_foreign, running
from tests.unit.can_bench import CODEC, ENCODER, VALVE

group = {"interface": "udp_multicast", "channel": "239.74.163.2"}
peer = can.Bus(**group, ignore_config=True)
driver = running(**group)
heard = []
for number in range(50):
    driver.write(time.monotonic(), [0.01 * number])
    data = CODEC.encode("Encoder", {"angle": 0.01 * number, "run_enable": 1}, number)
    peer.send(can.Message(arbitration_id=ENCODER, is_extended_id=False, data=data))
    while (message := peer.recv(0.01)) is not None:
        heard.append(message)
    driver.read(time.monotonic())
ours = [m for m in heard if m.arbitration_id == VALVE]
before = driver.foreign_commands
peer.send(ours[-1])
read_until_foreign(driver)
told = {
    "trouble": driver.trouble, "angle": driver.read(0.0)[0].value, "commands": len(ours), "before": before,
    "foreign": driver.foreign_commands, "deferred": counted(driver, "deferred"), "left": driver.left()[0],
}
driver.close()
peer.shutdown()
print(json.dumps(told))
"""
IN_A_NETWORK_OF_ITS_OWN = 'ip link set lo up && ip route add 224.0.0.0/4 dev lo && exec "$@"'


@pytest.mark.slow
@pytest.mark.skipif(os.geteuid() != 0 or not shutil.which("unshare"), reason="needs root and unshare")
@pytest.mark.skipif(find_spec("msgpack") is None, reason="needs msgpack")
def test_own_frames_of_udp_multicast_come_back_and_are_our_own() -> None:
    command = ["unshare", "--net", "sh", "-c", IN_A_NETWORK_OF_ITS_OWN, "sh", sys.executable, "-c", MULTICAST]
    repository = Path(__file__).parents[2]
    run = subprocess.run(command, cwd=repository, capture_output=True, text=True, check=False, timeout=60)
    assert run.returncode == 0, run.stderr
    told = json.loads(run.stdout)
    assert (told["trouble"], told["commands"], told["deferred"]) == ("", 50, 0)
    assert told["angle"] == pytest.approx(0.49)
    assert (told["before"], told["foreign"]) == (0, 1)
    assert told["left"] > 0.0


def own_constructor(interface: str) -> tuple[set[str], bool]:
    """Arguments that an interface's bus takes, and whether it takes any others: read from its source."""
    module, name = can.interfaces.BACKENDS[interface]
    spec = find_spec(module)
    assert spec is not None
    assert spec.origin is not None
    origin = Path(spec.origin)
    files = origin.parent.glob("*.py") if origin.stem == "__init__" else [origin]
    nodes = [node for file in files for node in ast.walk(ast.parse(file.read_text()))]
    for bus in (node for node in nodes if isinstance(node, ast.ClassDef) and node.name == name):
        for part in bus.body:
            if isinstance(part, ast.FunctionDef) and part.name == "__init__":
                known = {argument.arg for argument in (*part.args.args, *part.args.kwonlyargs)}
                return known, part.args.kwarg is not None
    raise AssertionError(f"{interface}: no constructor found")


@pytest.mark.parametrize("interface", sorted(can.interfaces.BACKENDS))
def test_every_interface_of_python_can_takes_what_it_is_given(interface: str) -> None:
    names, any_other = own_constructor(interface)
    given = {"channel", "bitrate", "fd", "can_filters"}
    if asks_for_echo(options(interface=interface)):
        given.add("receive_own_messages")
    assert any_other or given <= names, given - names


@pytest.mark.parametrize("interface", sorted(ECHOES))
def test_every_interface_of_the_table_is_one_of_python_can(interface: str) -> None:
    assert interface in can.interfaces.BACKENDS


@pytest.mark.parametrize(
    ("interface", "echo", "expected", "asked"),
    [
        ("socketcan", None, "ours", True),
        ("socketcan", False, "none", False),
        ("slcan", None, "none", False),
        ("made_elsewhere", True, "plain", True),
        ("udp_multicast", None, "plain", False),
        ("udp_multicast", False, "plain", False),
        ("gs_usb", False, "ours", False),
    ],
)
def test_what_comes_back(interface: str, echo: bool | None, expected: str, asked: bool) -> None:
    chosen = options(interface=interface, echo=echo)
    assert (echo_of(chosen), asks_for_echo(chosen)) == (expected, asked)


def test_check_says_what_an_interface_cannot_do() -> None:
    text = (configs_dir() / "can.yaml").read_text()
    slcan = text.replace("interface: socketcan", "interface: slcan")
    assert slcan != text
    warnings = check(load_text(slcan, "can.yaml", configs_dir())).warnings
    assert [w for w in warnings if w.startswith("driver.interface slcan does not hand our frames back")]
    assert [w for w in warnings if "the supervisor cannot write neutral" in w]
    assert interface_warnings(options(interface="socketcan")) == []
    assert not [
        w for w in interface_warnings(options(interface="udp_multicast")) if "hand our frames back" in w
    ]
