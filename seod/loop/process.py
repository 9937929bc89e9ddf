"""Set-up of the loop process: driver, real-time scheduling, signals; then `Loop.run`."""

from __future__ import annotations

import signal
import socket
from typing import TYPE_CHECKING, cast

from drivers import driver_class
from drivers.base import Driver, DriverError
from seod.config.channels import input_channels, neutral_values, output_channels
from seod.config.model import RigConfig
from seod.config.truth import truth
from seod.loop import events
from seod.loop.pacer import Pacer, SensorPacer, SimulatedPacer, TimerPacer
from seod.loop.tick import Loop
from seod.processes.handover import ChildArguments, die_with_parent, read_memfd, send_json
from seod.processes.realtime import enter_realtime
from seod.processes.ring import AxisState, Shared

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivers.replay import ReplayDriver


def make_driver(config: RigConfig, clock: Callable[[], float]) -> Driver:
    """The rig file's driver, opened and started.

    Raises:
        DriverError: The rig cannot be had.
    """
    kind = driver_class(config.driver["kind"])
    driver = kind(kind.Options.model_validate(config.driver), clock)
    driver.open(input_channels(config), output_channels(config), neutral_values(config))
    driver.start()
    return driver


def make_pacer(config: RigConfig, shared: Shared) -> Pacer:
    """Simulated time for a virtual rig that is not in real time, else the clock."""
    period = 1.0 / config.loop.rate_hz
    if config.driver.get("realtime") is False:
        return SimulatedPacer(period, shared)
    return TimerPacer(period)


def main() -> int:
    """Entry point of the loop process."""
    arguments = ChildArguments.from_argv()
    die_with_parent(arguments.supervisor_pid)
    link = socket.socket(fileno=arguments.supervisor_fd)
    config = RigConfig.model_validate_json(read_memfd(arguments.config_fd))
    shared = Shared(arguments.axes, arguments.rows, arguments.shared_fd)
    pacer = make_pacer(config, shared)
    try:
        driver = make_driver(config, pacer.now)
    except DriverError as error:
        send_json(link, {"loop": "failed", "why": str(error)})
        return 1
    send_json(link, {"loop": "open", "recipe": dict(driver.neutral_recipe())})
    if driver.acts_on == "recording":
        return replay(config, driver, shared, arguments.generation, link)
    refused = enter_realtime(config.loop.priority, config.loop.cpu)
    if config.loop.pace == "sensor" and not isinstance(pacer, SimulatedPacer):
        pacer = SensorPacer(driver, 1.0 / config.loop.rate_hz)
    loop = Loop(config, driver, shared, pacer, arguments.generation)
    install_signals(loop)
    announce(loop, refused)
    send_json(link, {"loop": "ready", "warnings": refused})
    loop.run()
    return 0


def replay(config: RigConfig, driver: Driver, shared: Shared, generation: int, link: socket.socket) -> int:
    """Play a recording, at ordinary priority."""
    from seod.loop.replay import Replay  # noqa: PLC0415 - a loop that moves a rig has no need of it

    try:
        loop = Replay(config, cast("ReplayDriver", driver), shared, generation)
    except DriverError as error:
        send_json(link, {"loop": "failed", "why": str(error)})
        return 1
    signal.signal(signal.SIGTERM, lambda *_: setattr(loop, "ending", True))
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGUSR1, signal.SIG_IGN)
    send_json(link, {"loop": "ready", "warnings": []})
    loop.run()
    return 0


def install_signals(loop: Loop) -> None:
    """SIGTERM ends the loop, SIGUSR1 says that the gateway is lost. Both take effect at the next tick."""

    def end(*_: object) -> None:
        loop.ending = True

    def gateway_lost(*_: object) -> None:
        loop.gateway_lost = True

    signal.signal(signal.SIGTERM, end)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGUSR1, gateway_lost)


def announce(loop: Loop, refused: list[str]) -> None:
    """Tell the gateway what runs here."""
    config = loop.config
    loop.shared.events.put(
        {
            "event": "started",
            "t": loop.pacer.now(),
            "generation": loop.generation,
            "realtime": {"ok": not refused, "why": refused},
            "simulated": config.simulation is not None,
            "truth": truth(config),
            "counters": list(loop.driver.counter_names),
            "untold_delay_s": loop.driver.untold_delay(loop.period),
        }
    )
    for axis in loop.axes:
        told = events.state(loop.pacer.now(), axis.name, AxisState.IDLE, None, "loop started")
        loop.shared.events.put(told)
