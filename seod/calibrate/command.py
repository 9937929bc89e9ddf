"""`seod calibrate`: the daemon, one axis after the other, the table of results, and the rig file."""

from __future__ import annotations

import datetime as dt
import math
from contextlib import closing, contextmanager
from typing import TYPE_CHECKING, Any

from seod.calibrate.procedure import CalibrationError, Plan, Procedure
from seod.calibrate.session import RemoteRig
from seod.calibrate.static import by_pressure
from seod.client import Client, RequestError, UnreachableError
from seod.config.tokens import TokenError, client_token
from seod.config.translate import at
from seod.config.units import written_as
from seod.launch.daemon import spawn
from seod.launch.with_client import StartError, connect
from seod.terminal.console import ask
from seod.terminal.progress import bar
from seod.terminal.text import with_sd

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from rich.console import Console

    from seod.calibrate.procedure import Edge, Result
    from seod.calibrate.static import Static
    from seod.calibrate.value import Value
    from seod.config.axis import AxisConfig
    from seod.config.errors import KeyPath
    from seod.config.model import RigConfig

SCATTER = 4.0
"""Speeds that scatter so much more than the noise explains are no line."""

CALIBRATION_KEYS = (
    "K_L",
    "K_L_up",
    "K_L_down",
    "null",
    "deadband_up",
    "deadband_down",
    "delay",
    "supply_pressure",
)
"""Results that the rig file keeps."""


@contextmanager
def daemon(config: RigConfig, path: Path) -> Iterator[Client]:
    """A client of the running daemon, or of one that is started for it and ended afterwards.

    Raises:
        CalibrationError: There is none and none comes up, or another rig's has the port.
    """
    if config.server.port == 0:
        raise CalibrationError("server.port is 0, any free one: a calibration needs a fixed port")
    running = _running(config, path)
    if running is not None:
        with running:
            yield running
        return
    process = spawn(path, None, None)
    try:
        client = connect(config, path, process)
        if client is None:
            raise CalibrationError("the daemon ended; its message stands above")
        with client:
            yield client
    except StartError as error:
        raise CalibrationError(str(error)) from error
    finally:
        process.terminate()
        process.wait()


def _running(config: RigConfig, path: Path) -> Client | None:
    server = config.server
    tls = None if server.tls is None else path.parent / server.tls.certificate
    try:
        client = Client(server.host, server.port, client_token(config), tls)
    except UnreachableError:
        return None
    except TokenError as error:
        raise CalibrationError(str(error)) from error
    rig = client.info()["rig"]
    if rig == config.rig:
        return client
    client.close()
    raise CalibrationError(f"the daemon of another rig, {rig}, has port {server.port}")


def calibrate_axis(
    client: Client, name: str, axis: AxisConfig, pressures: int, console: Console
) -> tuple[Result, list[Static]]:
    """Measure one axis, at several supply pressures if asked; its bias is as before afterwards.

    Raises:
        CalibrationError: It cannot be done.
    """
    now = client.get(name)
    if now["state"] != "idle":
        raise CalibrationError(f"{name} is {now['state']}: stop or reset it first")
    bias = now["settings"]["bias"]
    try:
        results = [_measure(client, name, axis, console)]
        for number in range(1, pressures):
            wait_for_pressure(console, number + 1, pressures)
            results.append(_measure(client, name, axis, console))
    finally:
        client.set(name, bias=bias)
    return results[0], by_pressure([result.static for result in results])


def wait_for_pressure(console: Console, number: int, pressures: int) -> None:
    """Ask for the next supply pressure.

    Raises:
        CalibrationError: Nobody is there.
    """
    try:
        ask(console, f"Set supply pressure {number} of {pressures}, then press Enter. ")
    except EOFError:
        raise CalibrationError("nobody can be asked to change the pressure") from None


def _measure(client: Client, name: str, axis: AxisConfig, console: Console) -> Result:
    limits, pulse, speed = axis.limits, axis.relay.e_a, axis.mode == "velocity"
    with closing(RemoteRig(client, name)) as rig, bar(console) as show:
        plan = Plan(rig.gain(), limits.travel, limits.output, pulse, rig.bias(), speed, axis.command_unit)
        return Procedure(rig, plan, lambda what, done: show(f"{name}: {what}", done)).run()


def as_json(result: Result, statics: list[Static], polarity: str) -> dict[str, Any]:
    """Results for programs: each value with sd and 95 % interval, SI units."""
    static = result.static
    lines = {"K_L_up": static.up, "K_L_down": static.down}
    return {
        "polarity": polarity,
        "K_L": _value(static.K_L),
        **{key: None if line is None else _value(line.K_L) for key, line in lines.items()},
        "null": _value(static.null),
        "deadband_up": _edge(result.up),
        "deadband_down": _edge(result.down),
        "delay": _value(result.delay),
        "supply_pressure": None if math.isnan(static.ps) else static.ps,
        "pressures": [{"ps": each.ps, "K_L": _value(each.K_L)} for each in statics]
        if len(statics) > 1
        else [],
        "warnings": warnings(result),
    }


def _value(value: Value) -> dict[str, Any]:
    return {"value": value.value, "sd": value.sd, "interval": list(value.interval)}


def _edge(edge: Edge) -> dict[str, Any]:
    return {"interval": sorted((edge.still, edge.moves))}


def warnings(result: Result) -> list[str]:
    """What a person should know before using the results."""
    said = []
    up, down = result.static.up, result.static.down
    for name, line in (("up", up), ("down", down)):
        if line is not None and line.scatter > SCATTER:
            what = f"speeds {name} scatter {line.scatter:.1f} times more than the noise explains"
            said.append(f"{what}: friction, saturation, or a pressure that changed")
    if up is not None and down is not None:
        apart = abs(up.K_L.value - down.K_L.value)
        if apart > 3.0 * (up.K_L.sd**2 + down.K_L.sd**2) ** 0.5 and apart > 0.02 * abs(
            result.static.K_L.value
        ):
            said.append(
                f"K_L is {up.K_L.value:.4g} up and {down.K_L.value:.4g} down: the actuator is asymmetric"
            )
    return said


def as_text(name: str, axis: AxisConfig, answer: dict[str, Any]) -> str:
    """Results for people."""
    gain, command = axis.gain_unit, axis.command_unit
    units = {"K_L": gain, "K_L_up": gain, "K_L_down": gain, "null": command, "delay": "s"}
    lines = [f"{name}: polarity {answer['polarity']}"]
    for key, unit in units.items():
        if (found := answer[key]) is not None:
            low, high = found["interval"]
            between = f"95 % [{low:.6g}, {high:.6g}]"
            lines.append(f"  {key:<14}{with_sd(found['value'], found['sd'])} {unit}  {between}")
    for key in ("deadband_up", "deadband_down"):
        low, high = answer[key]["interval"]
        lines.append(f"  {key:<14}between {low:.4g} and {high:.4g} {command}")
    if answer["supply_pressure"] is not None:
        lines.append(f"  {'ps':<14}{answer['supply_pressure']:.4g} Pa")
    lines += [
        f"  K_L at {each['ps']:.4g} Pa: {each['K_L']['value']:.5g} {gain}" for each in answer["pressures"]
    ]
    return "\n".join(lines + [f"  warning: {why}" for why in answer["warnings"]])


def changes(name: str, axis: AxisConfig, answer: dict[str, Any], written: Any) -> dict[KeyPath, Any]:
    """What to write into the rig file: the results, and the values in use.

    A value whose interval holds zero is zero; one that is written with a unit keeps it.

    Args:
        name: The axis.
        axis: What the rig file says of it.
        answer: As of `as_json`.
        written: The rig file's values as they are written.

    Raises:
        CalibrationError: The gain cannot be told from zero.
    """
    here = ("axes", name)
    found = {key: answer[key] for key in CALIBRATION_KEYS if answer[key] is not None}
    date = dt.datetime.now(dt.UTC).date().isoformat()
    null, delay = round(_or_zero(answer["null"]), 6), round(max(0.0, _or_zero(answer["delay"])), 7)
    values: dict[KeyPath, Any] = {}
    if null or axis.relay.bias:
        values[(*here, "relay", "bias")] = null
    if delay or axis.estimator.delay:
        values[(*here, "estimator", "delay")] = delay
    if not answer["pressures"] and isinstance(axis.K_L, float | int):
        values[(*here, "K_L")] = _gain(name, axis, answer["K_L"])
    values = {path: written_as(value, at(written, path)) for path, value in values.items()}
    if answer["pressures"]:
        gains = [_gain(name, axis, each["K_L"]) for each in answer["pressures"]]
        ps = [round(each["ps"]) for each in answer["pressures"]]
        values[(*here, "K_L")] = {"table": {"ps": ps, "K_L": gains}}
    return {**values, (*here, "calibration"): {"date": date, **_rounded(found)}}


def _or_zero(found: dict[str, Any]) -> float:
    """The value; 0 where its interval holds 0: what was measured is noise."""
    low, high = found["interval"]
    return 0.0 if low <= 0.0 <= high else float(found["value"])


def _gain(name: str, axis: AxisConfig, found: dict[str, Any]) -> float:
    if _or_zero(found) == 0.0:
        low, high = found["interval"]
        between = f"K_L lies between {low:.4g} and {high:.4g} {axis.gain_unit}"
        raise CalibrationError(
            f"{name}: {between}: it cannot be told from 0; raise relay.e_a or limits.travel"
        )
    return float(f"{found['value']:.6g}")


def _rounded(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _rounded(each) for key, each in value.items()}
    if isinstance(value, list):
        return [_rounded(each) for each in value]
    return float(f"{value:.6g}")


def calibrate(
    config: RigConfig, path: Path, axes: list[str], pressures: int, console: Console
) -> dict[str, dict[str, Any]]:
    """Measure axes one after the other; answers as of `as_json` by axis.

    Raises:
        CalibrationError: It cannot be done; says why.
    """
    answers = {}
    try:
        with daemon(config, path) as client:
            for name in axes:
                result, statics = calibrate_axis(client, name, config.axes[name], pressures, console)
                answers[name] = as_json(result, statics, "ok")
    except RequestError as error:
        raise CalibrationError(str(error)) from error
    return answers
