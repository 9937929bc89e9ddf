"""Where clients come in: listening, TLS, and who is there."""

from __future__ import annotations

import asyncio
import ipaddress
import ssl
from typing import TYPE_CHECKING, Any

from seod.gateway.connection import AUTHENTICATE_S, Connection
from seod.protocol import NO_ANSWER, TOO_MANY_CLIENTS, RpcError

if TYPE_CHECKING:
    from pathlib import Path

    from seod.config.model import ServerConfig, TlsConfig
    from seod.gateway.hub import Hub
    from seod.gateway.service import Service

GOODBYE_S = 0.5


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
        self._base = base
        self._connections: set[Connection] = set()
        self._server: asyncio.Server | None = None
        self._ending = False

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
                lambda: Connection(self), host, port, ssl=context, ssl_handshake_timeout=timeout
            )
        except OSError as error:
            what = f"cannot listen on {host} port {port}: {error.strerror or error}"
            raise ServerError(f"{what}; another daemon may have it: choose another server.port") from error
        number: int = self._server.sockets[0].getsockname()[1]
        return number

    def admit(self, connection: Connection) -> RpcError | None:
        """Take one more connection; or the reason why not."""
        most = self.config.max_clients
        if self._ending:
            return RpcError(NO_ANSWER, "the daemon is ending")
        if len(self._connections) >= most:
            why = f"too many clients: server.max_clients is {most}; close one, or raise it in the rig file"
            return RpcError(TOO_MANY_CLIENTS, why)
        self._connections.add(connection)
        return None

    def forget(self, connection: Connection) -> None:
        """A connection has ended."""
        self._connections.discard(connection)
        self.hub.drop(connection)

    def clients(self) -> dict[str, Any]:
        """For `health`: how many there are, and which have lost messages."""
        dropped = {each.name: self.hub.dropped(each) for each in self._connections}
        return {"connected": len(dropped), "dropped": {name: lost for name, lost in dropped.items() if lost}}

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


def is_loopback(host: str) -> bool:
    """Whether only this machine can reach an address."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def check_safe(config: ServerConfig) -> None:
    """Beyond loopback there must be TLS and a token.

    Raises:
        ServerError: There is not.
    """
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
    try:
        context.load_cert_chain(base / config.certificate, base / config.key)
    except OSError as error:  # ssl.SSLError is one
        files = f"{base / config.certificate} and {base / config.key}"
        raise ServerError(f"server.tls: cannot use {files}: {error}") from error
    return context
