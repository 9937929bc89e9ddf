"""A connection to a daemon: requests, answers and notifications, one a line. Standard library only."""

from __future__ import annotations

import json
import socket
import ssl
import time
from collections import deque
from contextlib import suppress
from typing import TYPE_CHECKING, Any, Self

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    Message = dict[str, Any]

DEFAULT_HOST = "127.0.0.1"
DEFAULT_PORT = 7600


class ClientError(Exception):
    """Something between here and the rig went wrong; the message says what would help."""


class UnreachableError(ClientError):
    """No daemon answers at this address."""


class EndedError(ClientError):
    """The daemon has closed the connection."""


class RequestError(ClientError):
    """The daemon refused a request; `code` is that of JSON-RPC."""

    def __init__(self, code: int, message: str) -> None:
        super().__init__(message)
        self.code = code


class Client:
    """A connection to a daemon; one thread at a time may use it.

    Args:
        host: Where the daemon runs.
        port: Its `server.port`.
        token: Its read or command token, where it wants one.
        tls: Certificate (PEM) to trust, True for those that the system trusts, None for no TLS.
        timeout: How long to wait for an answer [s].
        wait: How long to wait for the daemon to come up [s].

    Raises:
        UnreachableError: No daemon answers there.
        RequestError: It does not accept the token.
    """

    def __init__(
        self,
        host: str = DEFAULT_HOST,
        port: int = DEFAULT_PORT,
        token: str | None = None,
        tls: Path | bool | None = None,
        timeout: float = 10.0,
        wait: float = 0.0,
    ) -> None:
        self.address = f"{host}:{port}"
        self._given = (host, port, token, tls, timeout)
        self._timeout = timeout
        self._last_id = 0
        self._buffer = bytearray()
        self._notifications: deque[Message] = deque()
        self._socket = self._connect(host, port, tls, time.monotonic() + wait)
        if token is not None:
            try:
                self.call("authenticate", token=token)
            except ClientError:
                self.close()
                raise

    def _connect(self, host: str, port: int, tls: Path | bool | None, deadline: float) -> socket.socket:
        while True:
            try:
                plain = socket.create_connection((host, port), self._timeout)
                return plain if not tls else secure(plain, host, tls)
            except ConnectionRefusedError:
                if time.monotonic() >= deadline:
                    what = f"no daemon listens at {self.address}; start one with `seod run CONFIG`"
                    raise UnreachableError(what) from None
                time.sleep(0.05)
            except OSError as error:
                raise UnreachableError(f"cannot reach {self.address}: {error.strerror or error}") from error

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def again(self) -> Client:
        """Another connection to the same daemon, with the same token, for another thread."""
        return Client(*self._given)

    def close(self) -> None:
        """Close the connection; the daemon goes on."""
        self._socket.close()

    def call(self, method: str, /, **params: Any) -> Message:
        """Call a method of the protocol; parameters that are None are left out.

        Raises:
            RequestError: Refused, with the daemon's reason.
            EndedError: The daemon ended.
            ClientError: No answer in time.
        """
        self._last_id += 1
        given = {key: value for key, value in params.items() if value is not None}
        request = {"jsonrpc": "2.0", "id": self._last_id, "method": method, "params": given}
        self._send(json.dumps(request).encode() + b"\n")
        deadline = time.monotonic() + self._timeout
        while True:
            message = self._receive(deadline)
            if message is None:
                raise ClientError(f"{self.address} did not answer {method!r} within {self._timeout:g} s")
            if "method" in message:
                self._notifications.append(message)
            elif message.get("id") in (self._last_id, None):
                return answer(message)

    def _send(self, data: bytes) -> None:
        try:
            self._socket.settimeout(self._timeout)
            self._socket.sendall(data)
        except OSError as error:
            raise EndedError(f"the daemon at {self.address} is gone: {error.strerror or error}") from error

    def _receive(self, deadline: float | None) -> Message | None:
        while (end := self._buffer.find(b"\n")) < 0:
            left = None if deadline is None else deadline - time.monotonic()
            if left is not None and left <= 0:
                return None
            self._socket.settimeout(left)
            try:
                data = self._socket.recv(65536)
            except TimeoutError:
                return None
            except OSError as error:
                raise EndedError(
                    f"the daemon at {self.address} is gone: {error.strerror or error}"
                ) from error
            if not data:
                raise EndedError(f"the daemon at {self.address} has ended the connection")
            self._buffer += data
        line = bytes(self._buffer[:end])
        del self._buffer[: end + 1]
        message: Message = json.loads(line)
        return message

    def notifications(self, timeout: float | None = None) -> Iterator[Message]:
        """What the subscriptions bring, as `{"method": topic, "params": {...}}`; ends after `timeout` [s].

        Raises:
            EndedError: The daemon ended.
        """
        deadline = None if timeout is None else time.monotonic() + timeout
        while True:
            message = self._notifications.popleft() if self._notifications else self._receive(deadline)
            if message is None:
                return
            if "method" in message:
                yield message

    def estimates(self, axis: str | None = None, timeout: float | None = None) -> Iterator[Message]:
        """Estimates as they come, of one axis or all; ends after `timeout` [s]."""
        subscription = self.subscribe(["estimate"], None if axis is None else [axis])
        try:
            for message in self.notifications(timeout):
                if message["method"] == "estimate" and axis in (None, message["params"]["axis"]):
                    yield message["params"]
        finally:
            with suppress(EndedError):
                self.unsubscribe(subscription)

    def subscribe(
        self, topics: Sequence[str], axes: Sequence[str] | None = None, rate_hz: float | None = None
    ) -> int:
        """Ask for `estimate`, `sample`, `event` or `health`; returns the subscription's number."""
        number: int = self.call("subscribe", topics=topics, axes=axes, rate_hz=rate_hz)["subscription"]
        return number

    def unsubscribe(self, subscription: int) -> None:
        """End a subscription; what came before may still be among the notifications."""
        self.call("unsubscribe", subscription=subscription)

    def forget(self) -> None:
        """Drop the notifications that have come and were not taken."""
        self._notifications.clear()

    def info(self) -> Message:
        """Versions, rig, axes, whether the loop is real-time, and the truth of a simulated rig."""
        return self.call("info")

    def status(self) -> Message:
        """Everything about the rig at once."""
        return self.call("status")

    def get(self, axis: str | None = None) -> Message:
        """State, settings and newest estimate of an axis; with one axis its name may be left out."""
        return self.call("get", axis=axis)

    def set(self, axis: str | None = None, **values: float | str) -> Message:
        """Change e_a [V], hysteresis, bias [V], K_L or method of an axis; returns its settings.

        A number is in SI; text carries its unit: `e_a="400 mV"`.

        In velocity mode also `reference` [axis unit/s] and `trim` (True or False).
        """
        return self.call("set", axis=axis, **values)

    def start(self, axis: str | None = None) -> Message:
        """Excite an axis, or all; `seod.client.waiting.start_and_wait` waits for an answer as well."""
        return self.call("start", axis=axis)

    def stop(self, axis: str | None = None) -> Message:
        """End the excitation of an axis, or all; it goes back to where it stood."""
        return self.call("stop", axis=axis)

    def drive(
        self,
        axis: str | None,
        volts: float,
        duration: float,
        stay: bool = False,
        tones: Sequence[Sequence[float]] | None = None,
    ) -> Message:
        """Put a voltage on an axis, open loop, for `duration` [s]; the guard stays, then it is held.

        It is held where it began, or where it has come to (`stay`). With `tones`, [Hz, V, rad] each, their
        sum takes the place of the steady voltage, clipped at `volts`; a position is held slowly meanwhile, a
        speed axis is brought to its reference before.

        Returns at once; the `state` events tell when it is over. The axis must be idle.
        """
        return self.call("drive", axis=axis, volts=volts, duration=duration, stay=stay, tones=tones)

    def estop(self) -> Message:
        """Neutral at once; needs a reset afterwards."""
        return self.call("estop")

    def reset(self, axis: str | None = None) -> Message:
        """Leave the fault, of an axis or of all; starts a new loop where it has died."""
        return self.call("reset", axis=axis)

    def keepalive(self) -> Message:
        """Tell a rig with `guard.dead_man` that somebody is still there."""
        return self.call("keepalive")


def answer(message: dict[str, Any]) -> dict[str, Any]:
    """The result of a reply.

    Raises:
        RequestError: It is an error.
    """
    if "error" in message:
        raise RequestError(message["error"]["code"], message["error"]["message"])
    result: dict[str, Any] = message["result"]
    return result


def secure(plain: socket.socket, host: str, tls: Path | bool) -> ssl.SSLSocket:
    """Wrap a socket, trusting one certificate or the system's.

    Raises:
        OSError: The handshake failed (`ssl.SSLError` is one).
    """
    context = ssl.create_default_context(cafile=None if tls is True else str(tls))
    try:
        return context.wrap_socket(plain, server_hostname=host)
    except OSError:
        plain.close()
        raise


def speaks_tls(host: str, port: int) -> bool:
    """Whether a server that ended a plain connection wants TLS. Nothing is told to it, nobody is trusted."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname = False
    context.verify_mode = ssl.CERT_NONE
    try:
        with socket.create_connection((host, port), 2.0) as plain, context.wrap_socket(plain):
            return True
    except OSError:
        return False
