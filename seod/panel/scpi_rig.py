"""The rig as an SCPI client of the panel sees it: with a connection to the gateway of its own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from seod.processes.ring import AxisState
from seod.processes.uplink import Uplink
from seod.protocol.jsonrpc import UNAUTHORISED, RpcError
from seod.scpi.device import Device

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable, Mapping

    from seod.panel.panel import Panel
    from seod.processes.hand_in import Peer


@dataclass(frozen=True, eq=False)
class ScpiClient:
    """A client, as the panel's others see it."""

    name: str
    session: object = None


class ScpiRig:
    """One client's.

    Args:
        panel: What the clients share.
        peer: The client.
    """

    def __init__(self, panel: Panel, peer: Peer) -> None:
        self._panel, self._peer = panel, peer
        self._token = ""
        self._uplink: Uplink | None = None
        self._client = ScpiClient(f"the SCPI client at {peer[0]}:{peer[1]}")
        server = panel.config.server
        self.may_read = server.read_token is None and server.command_token is None
        self._may_command = False
        self.axes = {name: axis.setting_units for name, axis in panel.config.axes.items()}
        self.name = panel.config.rig

    @property
    def stale(self) -> bool:
        """Whether no rows come."""
        return self._panel.stale

    def estimate(self, axis: str) -> Mapping[str, Any] | None:
        """The newest one."""
        return self._panel.house.estimates.get(axis)

    def state(self, axis: str) -> AxisState:
        """Of an axis now."""
        return AxisState(self._panel.histories[axis].state)

    def take(self) -> None:
        """Become the one who commands."""
        self._panel.commander.take(self._client)

    def release(self) -> None:
        """Do not command any more."""
        self._panel.commander.release(self._client)

    async def log_in(self, token: str) -> bool:
        """Show a token; whether it is right."""
        self._token = token
        await self.close_uplink()
        try:
            await self._open()
        except RpcError:
            return False
        return self.may_read

    async def call(self, method: str, params: dict[str, Any]) -> Any:
        """One of the gateway's methods.

        Raises:
            RpcError: It says why not.
        """
        if self._uplink is None or not self._uplink.is_open:
            await self._open()
        if self._may_command:
            self._panel.commander.check(self._client, method)
        if self._uplink is None:
            raise RpcError(UNAUTHORISED, "show a token first: SYST:PASS")
        return await self._uplink.call(method, params)

    async def _open(self) -> None:
        uplink = Uplink(self._panel.way, self._peer, lambda *_: None)
        try:
            rights = await uplink.open(self._token)
        except RpcError as error:
            await uplink.close()
            if error.code == UNAUTHORISED:
                raise RpcError(UNAUTHORISED, "show a token first: SYST:PASS") from None
            raise
        self._uplink, self.may_read, self._may_command = uplink, rights["read"], rights["command"]

    async def close_uplink(self) -> None:
        """Let the gateway go."""
        if self._uplink is not None:
            await self._uplink.close()
            self._uplink = None

    async def close(self) -> None:
        """The client has gone."""
        self.release()
        await self.close_uplink()


def scpi_device(panel: Panel) -> Callable[[Peer], Awaitable[tuple[Device, Callable[[], Awaitable[None]]]]]:
    """Makes a device for each client."""

    async def make(peer: Peer) -> tuple[Device, Callable[[], Awaitable[None]]]:
        rig = ScpiRig(panel, peer)
        return Device(rig), rig.close

    return make
