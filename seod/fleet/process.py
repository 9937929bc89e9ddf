"""The process that makes a rig one of a fleet: a client of the gateway, and of the broker.

The rig does not depend on it: a broker that is gone or hangs delays nothing but this process.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import socket
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from seod import PROTOCOL, __version__
from seod.config.model import RigConfig
from seod.fleet.broker import BrokerError, broker_of, need_library
from seod.fleet.commands import Commands, RefusedError, answer_suffix
from seod.fleet.outbox import Outbox
from seod.fleet.store import Store
from seod.fleet.teller import Teller
from seod.processes.handover import ChildArguments, die_with_parent, read_memfd, send_json
from seod.processes.realtime import OTHERS_OOM, be_ended_sooner
from seod.processes.uplink import Uplink
from seod.protocol.jsonrpc import RpcError

if TYPE_CHECKING:
    import aiomqtt

    from seod.config.mqtt import MqttConfig

NICE: Final = 5
"""Behind all that concerns the rig itself."""
AGAIN_S: Final = 0.5
"""Between two attempts to reach the gateway [s]."""
MODEL_HZ: Final = 1.0
"""Errors of the model that are looked at [Hz]; only changes are told."""
PEER: Final = ("mqtt", 0)


class Member:
    """The rig as one of a fleet.

    Args:
        config: The rig file, with its tokens.
        mqtt: Its section.
        way: Where clients are handed in to the gateway.
        link: To the supervisor.

    Raises:
        BrokerError: Library, password or certificate cannot be had.
        OSError: The store cannot be used.
    """

    def __init__(self, config: RigConfig, mqtt: MqttConfig, way: socket.socket, link: socket.socket) -> None:
        from seod.fleet.publisher import Publisher  # noqa: PLC0415 - an extra

        self._config, self._mqtt, self._way, self._link = config, mqtt, way, link
        rig = mqtt.rig_id or config.rig
        self.store = Store(store_folder(mqtt, rig), mqtt.store_mb * 1e6, time.time())
        self._outbox = Outbox(rig, self.store, mqtt.archive)
        command = self._command if mqtt.commands else None
        self._publisher = Publisher(broker_of(mqtt), self._outbox, self._birth, command, self._say)
        self._teller = Teller(config, self._publisher.put, self.store.report)
        self._commands = Commands()

    async def run(self) -> None:
        """Until cancelled."""
        tasks = [asyncio.create_task(self._publisher.run()), asyncio.create_task(self._listen())]
        try:
            done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            for task in done:
                task.result()
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
            self._outbox.close()

    def _say(self, sentence: str) -> None:
        send_json(self._link, {"says": [f"fleet: {sentence}"]})

    def _birth(self) -> dict[str, Any]:
        axes = {
            name: {"mode": axis.mode, "unit": axis.measured_unit, "gain_unit": axis.gain_unit}
            for name, axis in self._config.axes.items()
        }
        about = {"version": __version__, "protocol": PROTOCOL, "driver": self._config.driver["kind"]}
        simulated = self._config.simulation is not None
        return {**about, "simulated": simulated, "axes": axes, "now": self._teller.state()}

    # ---- from the gateway

    async def _listen(self) -> None:
        """Hear the gateway, and the next one once it is gone."""
        while True:
            gone = asyncio.Event()
            uplink = Uplink(self._way, PEER, self._heard, gone.set)
            try:
                await self._begin(uplink)
                await gone.wait()
            except RpcError:  # not there yet
                pass
            finally:
                self._teller.lost(time.time())
                with contextlib.suppress(RpcError):
                    await uplink.close()
            await asyncio.sleep(AGAIN_S)

    async def _begin(self, uplink: Uplink) -> None:
        await uplink.open(self._reading_token())
        await uplink.call("subscribe", {"topics": ["event", "health"]})
        await uplink.call("subscribe", {"topics": ["estimate"], "rate_hz": self._mqtt.rate_hz})
        await uplink.call("subscribe", {"topics": ["model_error"], "rate_hz": MODEL_HZ})
        self._teller.began(await uplink.call("status"), time.time())

    def _reading_token(self) -> str | None:
        token = self._config.server.read_token or self._config.server.command_token
        return None if token is None else token.get_secret_value()

    def _heard(self, topic: str, params: dict[str, Any]) -> None:
        self._teller.heard(topic, params, time.time())

    # ---- commands

    async def _command(self, message: aiomqtt.Message) -> tuple[str, dict[str, Any]]:
        """Carry out a command, with the rights of its own token; returns suffix and body of the answer."""
        try:
            command = self._commands.judge(message.payload, message.retain, time.time())
        except RefusedError as error:
            return answer_suffix(error.client), {"id": error.identity, "ok": False, "error": str(error)}
        uplink = Uplink(self._way, PEER, lambda *_: None)
        try:
            await uplink.open(command.token)
            result = await uplink.call(command.method, command.params)
        except RpcError as error:
            answer = {"ok": False, "error": error.message, "code": error.code}
        else:
            answer = {"ok": True, "result": result}
        finally:
            await uplink.close()
        return command.answer_suffix, {"id": command.identity, **answer}


def store_folder(mqtt: MqttConfig, rig: str) -> Path:
    """Where a rig's messages wait: as the rig file says, the service's state folder, or the user's."""
    if mqtt.store is not None:
        return Path(mqtt.store) / rig
    service = os.environ.get("STATE_DIRECTORY", "").partition(":")[0]
    user = os.environ.get("XDG_STATE_HOME") or str(Path.home() / ".local" / "state")
    return Path(service or str(Path(user) / "seod")) / "fleet" / rig


async def serve(arguments: ChildArguments, link: socket.socket) -> None:
    """Run until the end.

    Raises:
        BrokerError: It cannot start.
        OSError: The store cannot be used.
    """
    config = RigConfig.model_validate_json(read_memfd(arguments.config_fd))
    if config.mqtt is None:
        raise BrokerError("the rig file has no section mqtt")
    need_library()
    with socket.socket(fileno=arguments.panel_fd) as way:
        running = asyncio.create_task(Member(config, config.mqtt, way, link).run())
        for number in (signal.SIGTERM, signal.SIGINT):
            asyncio.get_running_loop().add_signal_handler(number, running.cancel)
        send_json(link, {"fleet": "ready"})
        with contextlib.suppress(asyncio.CancelledError):
            await running


def main() -> int:
    """Entry point of this process."""
    arguments = ChildArguments.from_argv()
    die_with_parent(arguments.supervisor_pid)
    be_ended_sooner(OTHERS_OOM)
    os.nice(NICE)
    with socket.socket(fileno=arguments.supervisor_fd) as link:
        try:
            asyncio.run(serve(arguments, link))
        except (BrokerError, OSError) as error:
            send_json(link, {"fleet": "failed", "why": str(error)})
            return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
