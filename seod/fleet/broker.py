"""How to reach a broker: address, TLS, user. The library for MQTT is loaded only where it is needed."""

from __future__ import annotations

import asyncio
import logging
import ssl
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Final

from seod.config.mqtt import PLAIN_PORT, TLS_PORT
from seod.config.tokens import located, too_open
from seod.files.user_files import irregular

if TYPE_CHECKING:
    from collections.abc import AsyncIterator

    import aiomqtt

    from seod.config.mqtt import MqttConfig

KEEPALIVE_S: Final = 15
"""A broker that is silent for about 1.5 times this is given up; it gives us up likewise [s]; chosen."""
ANSWER_S: Final = 10.0
"""A broker that does not confirm for this long hangs [s]; chosen."""
FIRST_S: Final = 0.5
LONGEST_S: Final = 15.0
"""Between two attempts to reach it [s]: at first, and at last."""
GOODBYE_S: Final = 1.0
"""For the last words to a broker that may hang [s]; chosen."""
WINDOW: Final = 64
"""Messages that go before the first of them is confirmed."""
_PASSWORD_BYTES: Final = 4096


class BrokerError(Exception):
    """The broker cannot be reached as it was asked for; the message says what would be right."""


@dataclass(frozen=True, slots=True)
class Broker:
    """Where a broker is, and who we are there.

    Attributes:
        host: Name or address.
        port: TCP port.
        tls: What is trusted; None for plain TCP.
        user: User name.
        password: Password of that.
    """

    host: str
    port: int
    tls: ssl.SSLContext | None = None
    user: str | None = None
    password: str | None = None

    @property
    def address(self) -> str:
        """For people."""
        return f"{self.host}:{self.port}"

    def client(
        self, identity: str, will: aiomqtt.Will | None = None, *, clean: bool = True
    ) -> aiomqtt.Client:
        """A connection, not yet open; `clean`: the broker keeps nothing of the last one.

        Raises:
            BrokerError: The library is not there.
        """
        need_library()
        import aiomqtt  # noqa: PLC0415 - an extra

        client = aiomqtt.Client(
            self.host,
            self.port,
            identifier=identity,
            username=self.user,
            password=self.password,
            tls_context=self.tls,
            will=will,
            clean_session=clean,
            keepalive=KEEPALIVE_S,
            timeout=ANSWER_S,
            max_inflight_messages=2 * WINDOW,
            logger=_silent(),
        )
        client.pending_calls_threshold = 2 * WINDOW
        return client


def _silent() -> logging.Logger:
    logger = logging.getLogger("seod.fleet.mqtt")
    logger.setLevel(logging.CRITICAL)
    return logger


def need_library() -> None:
    """Make sure that the library for MQTT is there.

    Raises:
        BrokerError: It is not.
    """
    if find_spec("aiomqtt") is None:
        raise BrokerError("MQTT needs the package aiomqtt: pip install 'seod[fleet]'")


def broker_of(config: MqttConfig) -> Broker:
    """The broker of a rig file, with its password.

    Raises:
        BrokerError: Password or certificate cannot be had.
    """
    tls = None if config.tls is None else tls_context(config.tls.ca)
    password = None if config.password_file is None else read_password(config.password_file)
    return Broker(config.host, config.broker_port, tls, config.user, password)


def broker_at(address: str, tls: ssl.SSLContext | None, user: str | None, password: str | None) -> Broker:
    """The broker at `HOST`, `HOST:PORT` or `[IPV6]:PORT`.

    Raises:
        BrokerError: The address is none.
    """
    host, colon, port = address.rpartition(":")
    if not colon or address.endswith("]") or (":" in host and not host.startswith("[")):
        host, port = address, str(PLAIN_PORT if tls is None else TLS_PORT)
    number = int(port) if port.isdigit() else 0
    if not host or not 0 < number < 1 << 16:
        raise BrokerError(f"{address!r} is no broker: HOST or HOST:PORT, such as broker.plant:8883")
    return Broker(host.strip("[]"), number, tls, user, password)


def tls_context(ca: str | None) -> ssl.SSLContext:
    """What is trusted: a certificate (PEM), or what the system trusts.

    Raises:
        BrokerError: The certificate cannot be read.
    """
    path = None if ca is None else located(ca, Path())
    if ca is not None and path is None:
        raise BrokerError(f"mqtt.tls.ca: {ca}: only the systemd unit has it")
    try:
        return ssl.create_default_context(cafile=None if path is None else str(path))
    except OSError as error:  # ssl.SSLError is one
        raise BrokerError(f"cannot use the certificate {path}: {error}") from error


def read_password(name: str) -> str:
    """The password in a file: its first line.

    Raises:
        BrokerError: It cannot be read, is empty, or others can read it.
    """
    path = located(name, Path())
    if path is None:
        raise BrokerError(f"mqtt.password_file: {name}: only the systemd unit has it")
    try:
        why = irregular(path) or too_open(path)
        text = "" if why else path.read_bytes()[:_PASSWORD_BYTES].decode(errors="replace")
    except OSError as error:
        raise BrokerError(f"{path}: {error.strerror or error}") from error
    password = text.partition("\n")[0].rstrip("\r")
    if why or not password:
        raise BrokerError(f"{path}: {why or 'its first line must be the password'}")
    return password


@asynccontextmanager
async def opened(client: aiomqtt.Client) -> AsyncIterator[None]:
    """The connection open; closed with a word where the broker still hears, and its socket in any case.

    Raises:
        aiomqtt.MqttError: The broker cannot be reached.
    """
    import aiomqtt  # noqa: PLC0415 - an extra

    try:
        await client.__aenter__()
        try:
            yield
        finally:
            with suppress(aiomqtt.MqttError, TimeoutError):
                async with asyncio.timeout(GOODBYE_S):
                    await client.__aexit__(None, None, None)
    finally:
        _give_up(client)


def _give_up(client: aiomqtt.Client) -> None:
    """Close the socket of a connection that never came to be: the library leaves it open."""
    with suppress(OSError, ValueError):
        inner = client._client
        inner._sock_close()
