"""SCPI without sockets: what lines mean, what status they leave, what reaches the rig."""

from __future__ import annotations

import contextlib
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from seod.processes.ring import AxisState
from seod.protocol.jsonrpc import INVALID_PARAMS, NO_ANSWER, REFUSED, UNAUTHORISED, RpcError
from seod.scpi.device import Device
from seod.scpi.errors import TEXTS, ScpiError
from seod.scpi.parser import Channels, Number, Text, Word, parse
from seod.scpi.status import QUEUE, Byte, Event, Operation, Questionable
from seod.scpi.tree import matches, nodes

ESTIMATE = {
    "zeta": 0.21,
    "zeta_sd": 0.001,
    "omega_n": 117.0,
    "omega_n_sd": 0.1,
    "K_L": 17.0,
    "K_L_sd": None,
    "delay_s": 0.0,
    "frequency": 114.0,
    "amplitude": 0.22,
    "ps": 7e6,
    "temperature": None,
    "quality": "ok",
}


class FakeRig:
    """Two axes; keeps what was asked of the gateway."""

    def __init__(self) -> None:
        units = {"e_a": "V", "bias": "V", "hysteresis": "rad", "K_L": "rad/s/V"}
        self.axes = {"pitch": units, "roll": units}
        self.name = "seat"
        self.may_read = True
        self.stale = False
        self.states = {"pitch": AxisState.IDLE, "roll": AxisState.IDLE}
        self.estimates: dict[str, dict[str, Any]] = {"roll": dict(ESTIMATE)}
        self.calls: list[tuple[str, dict[str, Any]]] = []
        self.error: RpcError | None = None

    def estimate(self, axis: str) -> dict[str, Any] | None:
        return self.estimates.get(axis)

    def state(self, axis: str) -> AxisState:
        return self.states[axis]

    def take(self) -> None:
        self.calls.append(("take", {}))

    def release(self) -> None:
        self.calls.append(("release", {}))

    async def log_in(self, token: str) -> bool:
        self.may_read = token == "right"
        return self.may_read

    async def call(self, method: str, params: dict[str, Any]) -> Any:
        if self.error is not None:
            raise self.error
        self.calls.append((method, params))
        return {"settings": {"e_a": 0.5, "two_phase": True, "K_L": None}}


@pytest.fixture
def rig() -> FakeRig:
    return FakeRig()


@pytest.fixture
def device(rig: FakeRig) -> Device:
    return Device(rig)


def headers(line: bytes) -> list[tuple[str, bool]]:
    return [(":".join(each.header), each.query) for each in parse(line)]


def test_headers_go_on_from_the_last_one() -> None:
    assert headers(b"SOUR:REL:AMPL 1;HYST 2;:INIT;*OPC?;abor\n") == [
        ("SOUR:REL:AMPL", False),
        ("SOUR:REL:HYST", False),
        ("INIT", False),
        ("*OPC?".rstrip("?"), True),
        ("ABOR", False),
    ]
    assert headers(b"STAT:OPER:ENAB 1;*CLS;COND?") == [
        ("STAT:OPER:ENAB", False),
        ("*CLS", False),
        ("STAT:OPER:COND", True),
    ]
    assert headers(b"") == headers(b" ; ;\r\n") == []


@pytest.mark.parametrize(
    ("text", "argument"),
    [
        ("0.5 V", Number(0.5, "V")),
        ("-1e-3", Number(-1e-3)),
        (".5mV", Number(0.5, "mV")),
        ("ON", Word("ON")),
        ('"a;b,c""d"', Text('a;b,c"d')),
        ("'it''s'", Text("it's")),
        ("(@pitch, roll)", Channels(("pitch", "roll"))),
    ],
)
def test_arguments(text: str, argument: object) -> None:
    (command,) = parse(f"A:B {text}".encode())
    assert command.arguments == (argument,)


@pytest.mark.parametrize(
    ("line", "number"),
    [
        (b"MEAS:\xff", -101),
        (b"A\x01B", -101),
        (b"1A", -102),
        (b'A "x', -102),
        (b"A (@x", -102),
        (b"A )", -102),
        (b"A 'x'y'", -102),
        (b"A $", -104),
        (b"A 1,", -109),
        (b"A 1 $", -131),
        (b"A 1e999", -222),
        (b"A (@1x)", -224),
        (b"x" * 5000, -363),
        (b";".join([b"*CLS"] * 40), -363),
    ],
)
def test_what_cannot_be_read_has_its_number(line: bytes, number: int) -> None:
    with pytest.raises(ScpiError) as caught:
        list(parse(line))
    assert caught.value.number == number


@given(st.one_of(st.binary(max_size=200), st.text("ABZ:;*?(@),'\" 0.5eV\t", max_size=60).map(str.encode)))
def test_no_line_breaks_the_parser(line: bytes) -> None:
    read = []
    with contextlib.suppress(ScpiError):  # with a number that there is, else a KeyError comes out
        read += list(parse(line))
    assert all(word == word.upper() and word for command in read for word in command.header)


def test_long_and_short_forms_and_nothing_between() -> None:
    pattern = nodes("INITiate[:IMMediate]")
    good = [("INIT",), ("INITIATE",), ("INIT", "IMM"), ("INITIATE", "IMMEDIATE")]
    assert all(matches(pattern, each) for each in good)
    assert not any(matches(pattern, each) for each in [("INITI",), ("INIT", "IM"), ("INIT", "IMM", "X"), ()])


async def test_identity_and_common_commands(device: Device, rig: FakeRig) -> None:
    assert (await device.answer(b"*IDN?")).startswith("seod,seat,0,")
    assert await device.answer(b"*OPC?;*WAI;*TST?") == "1;0"
    assert await device.answer(b"*ESR?") == str(int(Event.POWER_ON))
    await device.answer(b"*OPC")
    assert await device.answer(b"*ESR?;*ESR?") == "1;0"
    await device.answer(b"*RST")
    assert rig.calls == [("stop", {})]
    assert await device.answer(b"SYST:VERS?;AXES?") == "1999.0;pitch,roll"


async def test_measures_and_what_is_not_defined(device: Device) -> None:
    assert float(await device.answer(b"MEAS:ZETA? (@roll)")) == 0.21
    assert float(await device.answer(b"measure:omega:sdeviation? (@ROLL)")) == 0.1
    assert await device.answer(b"MEAS:GAIN:SDEV? (@roll);:MEAS:TEMP? (@roll)") == "9.91E+37;9.91E+37"
    assert await device.answer(b"MEAS:ZETA? (@pitch)") == "9.91E+37"
    assert (await device.answer(b"FETC? (@roll)")).endswith(",ok")
    assert await device.answer(b"FETC? (@pitch)") == ""
    assert (await device.answer(b"SYST:ERR?")).startswith("-230,")
    await device.answer(b"MEAS:ZETA?")
    assert (await device.answer(b"SYST:ERR?")).startswith("-109,")
    await device.answer(b"MEAS:ZETA? (@yaw)")
    assert "pitch, roll" in await device.answer(b"SYST:ERR?")


async def test_settings_with_units(device: Device, rig: FakeRig) -> None:
    await device.answer(b"SOUR:REL:AMPL 500 mV,(@roll);HYST 1 deg,(@roll);:SOUR:TWOP ON,(@roll)")
    (_, first), (_, second), (_, third) = rig.calls
    assert first == {"axis": "roll", "e_a": 0.5}
    assert second["hysteresis"] == pytest.approx(0.0174533, rel=1e-5)
    assert third == {"axis": "roll", "two_phase": True}
    rig.calls.clear()
    await device.answer(b"SOUR:REL:AMPL 1 rad,(@roll)")
    await device.answer(b"SOUR:REL:AMPL 1 parsec,(@roll)")
    await device.answer(b"SOUR:REL:AMPL ON,(@roll)")
    await device.answer(b"SOUR:TWOP 3,(@roll)")
    await device.answer(b"SOUR:REL:AMPL")
    assert rig.calls == []
    errors = [(await device.answer(b"SYST:ERR?")).split(",")[0] for _ in range(6)]
    assert errors == ["-131", "-131", "-104", "-224", "-109", "0"]
    assert await device.answer(b"SOUR:REL:AMPL? (@roll);:SOUR:TWOP? (@roll)") == "5.000000000E-01;1"
    assert await device.answer(b"SOUR:GAIN? (@roll)") == "9.91E+37"
    assert await device.answer(b"SOUR:REF? (@roll)") == ""


async def test_start_stop_and_estop(device: Device, rig: FakeRig) -> None:
    await device.answer(b"INIT;:ABOR (@pitch,roll);:SYST:RES;:SYST:EST")
    wanted = [
        ("start", {}),
        ("stop", {"axis": "pitch"}),
        ("stop", {"axis": "roll"}),
        ("reset", {}),
        ("estop", {}),
    ]
    assert rig.calls == wanted
    assert device.is_estop(b"syst:estop\r\n")
    assert device.is_estop(b"MEAS:ZETA?;:SYST:EST")
    assert not device.is_estop(b"SYST:ERR?")
    assert not device.is_estop(b"\xff")


@pytest.mark.parametrize(
    ("code", "number"), [(INVALID_PARAMS, -222), (UNAUTHORISED, -203), (NO_ANSWER, -241), (REFUSED, -221)]
)
async def test_what_the_gateway_refuses(device: Device, rig: FakeRig, code: int, number: int) -> None:
    rig.error = RpcError(code, 'e_a: "too" large')
    await device.answer(b"INIT;:MEAS:ZETA? (@roll)")
    assert await device.answer(b"SYST:ERR?") == f"{number},\"{TEXTS[number]}; e_a: 'too' large\""


async def test_registers_and_the_bit_that_asks_for_service(device: Device, rig: FakeRig) -> None:
    await device.answer(b"*CLS;*SRE 8;:STAT:QUES:ENAB 512")
    assert await device.answer(b"*STB?") == "0"
    rig.states["roll"] = AxisState.FAULT
    assert int(await device.answer(b"*STB?")) == Byte.QUESTIONABLE | Byte.SERVICE
    assert int(await device.answer(b"STAT:QUES:COND?")) == Questionable.FAULT
    assert int(await device.answer(b"STAT:QUES?")) == Questionable.FAULT
    assert await device.answer(b"STAT:QUES?;*STB?") == "0;0"
    rig.states["roll"] = AxisState.EXCITING
    rig.estimates["roll"]["quality"] = "noisy"
    assert int(await device.answer(b"STAT:OPER:COND?")) == Operation.MEASURING
    assert int(await device.answer(b"STAT:QUES:COND?")) == Questionable.QUALITY
    await device.answer(b"NO:SUCH;")
    await device.answer(b"*ESE 32;*SRE 32")
    assert int(await device.answer(b"*STB?")) == Byte.ERRORS | Byte.EVENTS | Byte.SERVICE
    await device.answer(b"*CLS")
    assert await device.answer(b"*STB?;SYST:ERR?") == '0;0,"No error"'
    await device.answer(b"*ESE 70000;*ESE 1.5")
    assert (await device.answer(b"SYST:ERR?")).startswith("-222")


async def test_the_error_queue_has_an_end(device: Device) -> None:
    for _ in range(QUEUE + 5):
        await device.answer(b"NONSENSE?")
    assert await device.answer(b"SYST:ERR:COUN?") == str(QUEUE)
    last = [await device.answer(b"SYST:ERR?") for _ in range(QUEUE)][-1]
    assert last == '-350,"Queue overflow"'


async def test_without_a_token_nothing_is_told(device: Device, rig: FakeRig) -> None:
    rig.may_read = False
    rig.states["roll"] = AxisState.EXCITING
    assert await device.answer(b"MEAS:ZETA? (@roll)") == ""
    assert (await device.answer(b"SYST:ERR?")).startswith("-203")
    assert await device.answer(b"STAT:OPER:COND?") == "0"
    await device.answer(b"SYST:PASS 'wrong'")
    assert (await device.answer(b"SYST:ERR?")).startswith("-203")
    await device.answer(b'SYST:PASS:CEN "right"')
    assert float(await device.answer(b"MEAS:ZETA? (@roll)")) == 0.21
