"""The rig as an instrument: what each command does. Nothing here knows of sockets."""

from __future__ import annotations

import inspect
from typing import TYPE_CHECKING, Any, Final, Protocol

from seod import __version__
from seod.config.units import UNITS
from seod.processes.ring import AxisState
from seod.protocol.jsonrpc import INVALID_PARAMS, NO_ANSWER, UNAUTHORISED, RpcError
from seod.scpi.errors import ScpiError
from seod.scpi.parser import Channels, Number, Text, Word, parse
from seod.scpi.status import Event, Operation, Questionable, Status
from seod.scpi.tree import Tree

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable, Mapping

    from seod.scpi.parser import Argument, Command
    from seod.scpi.status import Register

    Handler = Callable[[Command], str | Awaitable[str | None] | None]

NOT_A_NUMBER: Final = "9.91E+37"
"""SCPI-1999, volume 1, 7.2.1.5: a number that is not defined."""
VERSION: Final = "1999.0"
FETCHED: Final = ("zeta", "zeta_sd", "omega_n", "omega_n_sd", "K_L", "K_L_sd")
MEASURED: Final = {
    "ZETA": "zeta",
    "ZETA:SDEViation": "zeta_sd",
    "OMEGa": "omega_n",
    "OMEGa:SDEViation": "omega_n_sd",
    "GAIN": "K_L",
    "GAIN:SDEViation": "K_L_sd",
    "DELay": "delay_s",
    "FREQuency": "frequency",
    "AMPLitude": "amplitude",
    "PRESsure": "ps",
    "TEMPerature": "temperature",
}
"""Fields of an estimate."""
SETTINGS: Final = {
    "RELay:AMPLitude": "e_a",
    "RELay:HYSTeresis": "hysteresis",
    "BIAS": "bias",
    "GAIN": "K_L",
    "REFerence": "reference",
}
SWITCHES: Final = {"TWOPhase": "two_phase", "TRIM": "trim"}
ERRORS: Final = {INVALID_PARAMS: -222, UNAUTHORISED: -203, NO_ANSWER: -241}
"""What the gateway says, as SCPI numbers; anything else is a conflict."""


class Rig(Protocol):
    """What the device needs of the rig."""

    @property
    def axes(self) -> Mapping[str, Mapping[str, str]]:
        """Units of each axis' settings."""

    @property
    def name(self) -> str:
        """The rig's."""

    @property
    def may_read(self) -> bool:
        """Whether the client may know anything of the rig."""

    @property
    def stale(self) -> bool:
        """Whether no rows come."""

    def estimate(self, axis: str) -> Mapping[str, Any] | None:
        """The newest one."""

    def state(self, axis: str) -> AxisState:
        """Of an axis now."""

    def take(self) -> None:
        """Become the one who commands."""

    def release(self) -> None:
        """Do not command any more."""

    async def log_in(self, token: str) -> bool:
        """Show a token; whether it is right."""

    async def call(self, method: str, params: dict[str, Any]) -> Any:
        """One of the gateway's methods.

        Raises:
            RpcError: It says why not.
        """


class Device:
    """One client's instrument.

    Args:
        rig: What it stands for.
    """

    def __init__(self, rig: Rig) -> None:
        self._rig = rig
        self.status = Status()
        self._tree: Tree[Handler] = Tree(self._table())
        self.patterns = self._tree.patterns

    def _table(self) -> dict[str, Handler]:
        return {
            **self._common(),
            **self._system(),
            **{f"MEASure:{name}?": self._measure(field) for name, field in MEASURED.items()},
            "MEASure:QUALity?": lambda command: self._estimate_of(command).get("quality", "no_oscillation"),
            "FETCh?": self._fetch,
            **{f"SOURce:{name}": self._set(field) for name, field in SETTINGS.items()},
            **{f"SOURce:{name}?": self._setting(field) for name, field in SETTINGS.items()},
            **{f"SOURce:{name}": self._switch(field) for name, field in SWITCHES.items()},
            **{f"SOURce:{name}?": self._setting(field) for name, field in SWITCHES.items()},
            "INITiate[:IMMediate]": self._act("start"),
            "ABORt": self._act("stop"),
            "OUTPut[:STATe]?": lambda command: str(int(self._state(command) is AxisState.EXCITING)),
            "SYSTem:STATe?": lambda command: self._state(command).name,
            **self._registers("OPERation", self.status.operation),
            **self._registers("QUEStionable", self.status.questionable),
        }

    def _common(self) -> dict[str, Handler]:
        status = self.status
        return {
            "*IDN?": lambda _: f"seod,{self._rig.name},0,{__version__}",
            "*RST": self._reset_all,
            "*CLS": lambda _: status.clear(),
            "*ESR?": lambda _: str(status.read_events()),
            "*ESE": self._store(status, "events_enable", 0xFF),
            "*ESE?": lambda _: str(status.events_enable),
            "*SRE": self._store(status, "service_enable", 0xBF),
            "*SRE?": lambda _: str(status.service_enable),
            "*STB?": lambda _: str(status.byte()),
            "*OPC": self._complete,
            "*OPC?": lambda _: "1",
            "*WAI": lambda _: None,
            "*TST?": lambda _: str(int(self._rig.stale)),
            "STATus:PRESet": lambda _: status.preset(),
        }

    def _system(self) -> dict[str, Handler]:
        return {
            "SYSTem:ERRor[:NEXT]?": lambda _: self.status.next_error(),
            "SYSTem:ERRor:COUNt?": lambda _: str(self.status.errors),
            "SYSTem:VERSion?": lambda _: VERSION,
            "SYSTem:AXES?": lambda _: ",".join(self._rig.axes),
            "SYSTem:PASSword[:CENable]": self._log_in,
            "SYSTem:LOCK[:REQuest]": lambda _: self._rig.take(),
            "SYSTem:LOCK:RELease": lambda _: self._rig.release(),
            "SYSTem:ESTop": self._estop,
            "SYSTem:RESet": self._act("reset"),
        }

    def is_estop(self, line: bytes) -> bool:
        """Whether a line asks for an e-stop: that goes before all else."""
        try:
            return any(self._tree.find(command) == self._estop for command in parse(line))
        except ScpiError:
            return False

    async def answer(self, line: bytes) -> str:
        """Carry out a line; answers to its queries are joined by `;`, "" for none."""
        answers = []
        try:
            for command in parse(line):
                self._look()
                found = self._tree.find(command)(command)
                told = await found if inspect.isawaitable(found) else found
                if told is not None:
                    answers.append(told)
        except ScpiError as error:
            self.status.error(error)
        except RpcError as error:
            self.status.error(ScpiError(ERRORS.get(error.code, -221), error.message))
        return ";".join(answers)

    def overtaken(self) -> None:
        """An e-stop came: what was asked before and has not begun is not carried out."""
        self.status.error(ScpiError(-221, "an e-stop came after it"))

    def _look(self) -> None:
        """Conditions as they are now."""
        if not self._rig.may_read:
            return
        operation, questionable = Operation(0), Questionable.STALE if self._rig.stale else Questionable(0)
        for axis in self._rig.axes:
            state = self._rig.state(axis)
            quality = (self._rig.estimate(axis) or {}).get("quality")
            if state is AxisState.EXCITING:
                operation |= Operation.MEASURING
                questionable |= Questionable(0) if quality == "ok" else Questionable.QUALITY
            operation |= Operation.ARMED if state is AxisState.ARMED else Operation(0)
            operation |= Operation.HOLDING if state is AxisState.HOLDING else Operation(0)
            questionable |= Questionable.FAULT if state is AxisState.FAULT else Questionable(0)
        self.status.operation.update(int(operation))
        self.status.questionable.update(int(questionable))

    # ---- queries

    def _measure(self, field: str) -> Handler:
        return lambda command: number(self._estimate_of(command).get(field))

    def _fetch(self, command: Command) -> str:
        estimate = self._estimate_of(command)
        if not estimate:
            raise ScpiError(-230, "there is no estimate yet")
        return ",".join([*(number(estimate[field]) for field in FETCHED), estimate["quality"]])

    def _estimate_of(self, command: Command) -> Mapping[str, Any]:
        (axis,) = self._axes(_only_channels(command.arguments), most=1)
        return self._rig.estimate(axis) or {}

    def _state(self, command: Command) -> AxisState:
        (axis,) = self._axes(_only_channels(command.arguments), most=1)
        return self._rig.state(axis)

    def _setting(self, field: str) -> Handler:
        async def ask(command: Command) -> str:
            (axis,) = self._axes(_only_channels(command.arguments), most=1)
            settings = (await self._rig.call("get", {"axis": axis}))["settings"]
            if field not in settings:
                raise ScpiError(-221, f"axis {axis} has no {field} in its mode")
            return number(settings[field])

        return ask

    # ---- commands

    def _set(self, field: str) -> Handler:
        async def change(command: Command) -> None:
            value, channels = _value_and_channels(command.arguments)
            if not isinstance(value, Number):
                raise ScpiError(-104, "a number is right")
            for axis in self._axes(channels, most=1):
                await self._rig.call("set", {"axis": axis, field: in_si(value, self._rig.axes[axis][field])})

        return change

    def _switch(self, field: str) -> Handler:
        async def change(command: Command) -> None:
            value, channels = _value_and_channels(command.arguments)
            on = {Word("ON"): True, Word("OFF"): False, Number(1.0): True, Number(0.0): False}.get(value)
            if on is None:
                raise ScpiError(-224, "ON or OFF is right")
            for axis in self._axes(channels, most=1):
                await self._rig.call("set", {"axis": axis, field: on})

        return change

    def _act(self, method: str) -> Handler:
        async def act(command: Command) -> None:
            channels = _only_channels(command.arguments)
            for params in [{"axis": name} for name in self._axes(channels)] if channels else [{}]:
                await self._rig.call(method, dict(params))

        return act

    async def _estop(self, _: Command) -> None:
        await self._rig.call("estop", {})

    async def _reset_all(self, _: Command) -> None:
        """`*RST`: at rest; settings and status stay."""
        await self._rig.call("stop", {})

    async def _log_in(self, command: Command) -> None:
        given = command.arguments
        if len(given) != 1 or not isinstance(given[0], Text):
            raise ScpiError(-109, "a token in quotes")
        if not await self._rig.log_in(given[0].text):
            raise ScpiError(-203, "wrong token")

    def _complete(self, _: Command) -> None:
        self.status.events |= int(Event.OPERATION_COMPLETE)

    # ---- registers

    def _store(self, place: object, name: str, most: int) -> Handler:
        def store(command: Command) -> None:
            if len(command.arguments) != 1 or not isinstance(command.arguments[0], Number):
                raise ScpiError(-109, "a number is right")
            value = command.arguments[0].value
            if value != int(value) or not 0 <= value <= 0xFFFF:
                raise ScpiError(-222, "a whole number from 0 on")
            setattr(place, name, int(value) & most)

        return store

    def _registers(self, name: str, register: Register) -> dict[str, Handler]:
        return {
            f"STATus:{name}[:EVENt]?": lambda _: str(register.read_event()),
            f"STATus:{name}:CONDition?": lambda _: str(register.condition),
            f"STATus:{name}:ENABle": self._store(register, "enable", 0x7FFF),
            f"STATus:{name}:ENABle?": lambda _: str(register.enable),
        }

    def _axes(self, channels: Channels | None, most: int | None = None) -> tuple[str, ...]:
        """The axes meant; left out, all of them, or the only one."""
        if not self._rig.may_read:
            raise ScpiError(-203, "show a token first: SYST:PASS")
        names = tuple(self._rig.axes) if channels is None else channels.names
        known = {axis.lower(): axis for axis in self._rig.axes}
        for name in names:
            if name.lower() not in known:
                raise ScpiError(-224, f"no axis {name}; there are {', '.join(self._rig.axes)}")
        if most is not None and len(names) > most:
            raise ScpiError(-109, "which axis? (@name)")
        return tuple(known[name.lower()] for name in names)


def number(value: object) -> str:
    """A number as SCPI answers it."""
    if isinstance(value, bool):
        return str(int(value))
    return f"{value:.9E}" if isinstance(value, (int, float)) else NOT_A_NUMBER


def in_si(given: Number, unit: str) -> float:
    """A number in the SI unit of its quantity.

    Raises:
        ScpiError: The suffix is of no unit, or of another quantity.
    """
    if not given.suffix:
        return given.value
    by_capitals = {known.upper(): known for known in UNITS}
    known = given.suffix if given.suffix in UNITS else by_capitals.get(given.suffix.upper())
    if known is None or UNITS[known][0] != UNITS[unit][0]:
        raise ScpiError(-131, f"{given.suffix}: {unit} is right")
    return given.value * UNITS[known][1]


def _only_channels(arguments: tuple[Argument, ...]) -> Channels | None:
    if not arguments:
        return None
    if len(arguments) > 1 or not isinstance(arguments[0], Channels):
        raise ScpiError(-108, "only a list of axes: (@name)")
    return arguments[0]


def _value_and_channels(arguments: tuple[Argument, ...]) -> tuple[Argument, Channels | None]:
    if not arguments:
        raise ScpiError(-109)
    return arguments[0], _only_channels(arguments[1:])
