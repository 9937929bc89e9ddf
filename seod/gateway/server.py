"""Where clients come in: listening, TLS, and who is there."""

from __future__ import annotations

import asyncio
import ipaddress
import os
import socket
import ssl
from typing import TYPE_CHECKING, Any

from seod.config.tokens import RIGHTS, is_filled, located
from seod.gateway.connection import Connection
from seod.gateway.lobby import AUTHENTICATE_S, Lobby
from seod.gateway.turns import Turns
from seod.protocol.jsonrpc import NO_ANSWER, RpcError

if TYPE_CHECKING:
    from pathlib import Path

    from seod.config.server import ServerConfig, TlsConfig
    from seod.gateway.hub import Hub, Sink
    from seod.gateway.service import Service
    from seod.processes.hand_in import Peer

GOODBYE_S = 0.5
ACCEPTED_A_TURN = 16
"""Connections that are taken before others get their turn; each takes 0.1 ms."""
LISTEN_BACKLOG = 1024
"""Connections that the kernel keeps meanwhile."""


class ServerError(Exception):
    """The server cannot start; the message says what would be right."""


class Server:
    """Listens, and knows all connections.

    Args:
        config: The rig file's section.
        base: Folder that certificate and key are relative to.
        service: Answers requests.
        hub: Holds the subscriptions.
    """

    def __init__(self, config: ServerConfig, base: Path, service: Service, hub: Hub) -> None:
        self.config = config
        self.service = service
        self.hub = hub
        self.turns = Turns()
        self._base = base
        self._connections: dict[Connection, None] = {}  # in the order in which they came
        self._lobby = Lobby(config.max_clients)
        if service is not None:
            service.overtake = self.overtake
        self._server: asyncio.Server | None = None
        self._ending = False
        self._taking: set[asyncio.Task[Any]] = set()

    async def start(self) -> int:
        """Listen; returns the port.

        Raises:
            ServerError: Unsafe, taken, or without its certificate.
        """
        check_safe(self.config)
        context = None if self.config.tls is None else tls_context(self.config.tls, self._base)
        host, port = self.config.host, self.config.port
        timeout = None if context is None else AUTHENTICATE_S
        loop = asyncio.get_running_loop()
        try:
            self._server = await loop.create_server(
                lambda: Connection(self),
                host,
                port,
                ssl=context,
                ssl_handshake_timeout=timeout,
                backlog=ACCEPTED_A_TURN,
            )
        except OSError as error:
            what = f"cannot listen on {host} port {port}: {error.strerror or error}"
            raise ServerError(f"{what}; another daemon may have it: choose another server.port") from error
        for each in self._server.sockets:
            listen_on(each.fileno(), LISTEN_BACKLOG)
        number: int = self._server.sockets[0].getsockname()[1]
        return number

    def take_in(self, end: socket.socket, peer: Peer) -> None:
        """Serve a client that the panel hands in: its end of the connection, and where it comes from."""
        loop = asyncio.get_running_loop()
        taking = loop.create_task(loop.connect_accepted_socket(lambda: Connection(self, peer), end))
        self._taking.add(taking)
        taking.add_done_callback(self._taking.discard)

    def admit(self, connection: Connection) -> RpcError | None:
        """Take one more connection; or the reason why not. Who may do nothing yet waits in the lobby."""
        if self._ending:
            return RpcError(NO_ANSWER, "the daemon is ending")
        self._connections[connection] = None
        self._lobby.enter(connection)
        return None

    def forget(self, connection: Connection) -> None:
        """A connection has ended."""
        self._connections.pop(connection, None)
        self._lobby.leave(connection)
        self.hub.drop(connection)
        self.service.gone(connection.session, connection.name)

    def overtake(self, by: Sink) -> None:
        """An e-stop came: what any client asked before, and has not begun, is not carried out."""
        for connection in self._connections:
            connection.overtake(by)

    def clients(self) -> dict[str, Any]:
        """For `health`: how many there are, and which have lost messages."""
        dropped = {each.name: lost for each in self._connections if (lost := self.hub.dropped(each))}
        waiting = {"waiting": len(self._lobby), "turned_away": self._lobby.turned_away}
        return {"connected": len(self._lobby.seated), **waiting, "dropped": dropped}

    async def close(self) -> None:
        """Stop listening; give clients a moment to read the rest."""
        if self._server is None:
            return
        self._ending = True  # for those that are on their way in
        self._server.close()
        connections = list(self._connections)
        for connection in connections:
            connection.close()
        try:
            async with asyncio.timeout(GOODBYE_S):
                for connection in connections:
                    await connection.closed.wait()
        except TimeoutError:
            for connection in connections:
                connection.abort()
        for connection in connections:
            await connection.closed.wait()
        await self._server.wait_closed()


def listen_on(fd: int, backlog: int) -> None:
    """Let the kernel keep more connections than are taken in one turn, which asyncio has by one number."""
    with socket.socket(fileno=os.dup(fd)) as listening:
        listening.listen(backlog)


def is_loopback(host: str) -> bool:
    """Whether only this machine can reach an address."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def check_safe(config: ServerConfig) -> None:
    """Beyond loopback there must be TLS and a token, and tokens that were asked for must have come here.

    Raises:
        ServerError: There is not, or they have not.
    """
    for right in RIGHTS:
        token = getattr(config, right)
        asked = getattr(config, f"{right}_file") is not None
        if (token is None and asked) or (token is not None and is_filled(token.get_secret_value())):
            raise ServerError(f"server.{right}: the token itself did not come with the configuration")
    if is_loopback(config.host):
        return
    missing = [] if config.tls else ["server.tls"]
    if config.read_token is None and config.command_token is None:
        missing.append("server.command_token or server.read_token")
    if missing:
        what = f"server.host {config.host} can be reached by others: it needs {' and '.join(missing)}"
        raise ServerError(f"{what} in the rig file (or 127.0.0.1 as host)")


def tls_context(config: TlsConfig, base: Path) -> ssl.SSLContext:
    """Certificate and key, read.

    Raises:
        ServerError: They cannot be.
    """
    context = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
    certificate, key = located(config.certificate, base), located(config.key, base)
    if certificate is None or key is None:
        what = f"{config.certificate} and {config.key}: credentials are there only in the systemd unit"
        raise ServerError(f"server.tls: {what}")
    try:
        context.load_cert_chain(certificate, key)
    except OSError as error:  # ssl.SSLError is one
        raise ServerError(f"server.tls: cannot use {certificate} and {key}: {error}") from error
    return context
