"""The back door of the simulated rig: JSON-RPC 2.0 by line on TCP, looked after between frames.

No thread: `poll` never waits, and a client that does not read only fills its own buffer.
"""

from __future__ import annotations

import json
import selectors
import socket
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from pydantic import ValidationError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from pydantic_core import ErrorDetails

    Methods = Mapping[str, Callable[[dict[str, Any]], object]]

LONGEST_LINE = 65536
LARGEST_BACKLOG = 8 << 20


def answer(line: bytes, methods: Methods) -> bytes:
    """The response line to one request line; nothing to a notification.

    Methods take the request's `params` and say by ValueError what is wrong with them.
    """
    try:
        request = json.loads(line)
    except (ValueError, RecursionError):
        return _response(None, error=(-32700, "expected one JSON object a line"))
    if not isinstance(request, dict) or not isinstance(request.get("method"), str):
        return _response(None, error=(-32600, "expected an object with method, params and id"))
    response = _call(request, methods)
    return response if "id" in request else b""


def _call(request: dict[str, Any], methods: Methods) -> bytes:
    identity, name, params = request.get("id"), request["method"], request.get("params", {})
    if name not in methods:
        return _response(identity, error=(-32601, f"no method {name!r}; there are {', '.join(methods)}"))
    if not isinstance(params, dict):
        return _response(identity, error=(-32602, "params must be an object"))
    try:
        return _response(identity, result=methods[name](params))
    except ValidationError as error:
        return _response(identity, error=(-32602, "; ".join(map(_plain, error.errors()))))
    except ValueError as error:
        return _response(identity, error=(-32602, str(error)))


def _plain(error: ErrorDetails) -> str:
    place = ".".join(map(str, error["loc"]))
    return f"{place}: {error['msg']}" if place else error["msg"]


def _response(identity: object, result: object = None, error: tuple[int, str] | None = None) -> bytes:
    body: dict[str, object] = {"jsonrpc": "2.0", "id": identity}
    if error is None:
        body["result"] = result
    else:
        body["error"] = {"code": error[0], "message": error[1]}
    return json.dumps(body).encode() + b"\n"


@dataclass
class _Client:
    connection: socket.socket
    received: bytearray = field(default_factory=bytearray)
    unsent: bytearray = field(default_factory=bytearray)


class ControlServer:
    """Listens on 127.0.0.1.

    Args:
        port: TCP port; 0 for any free one.
        methods: What can be called.

    Raises:
        OSError: The port is taken.
    """

    def __init__(self, port: int, methods: Methods) -> None:
        self.methods = methods
        self._listener = socket.create_server(("127.0.0.1", port))
        self._listener.setblocking(False)
        self.port: int = self._listener.getsockname()[1]
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._listener, selectors.EVENT_READ)

    def poll(self) -> None:
        """Do all that can be done without waiting."""
        for key, _events in self._selector.select(0):
            if key.data is None:
                self._accept()
            else:
                self._serve(key.data)

    def _accept(self) -> None:
        try:
            connection, _address = self._listener.accept()
        except OSError:  # the client has gone already
            return
        connection.setblocking(False)
        self._selector.register(connection, selectors.EVENT_READ, _Client(connection))

    def _serve(self, client: _Client) -> None:
        try:
            self._receive(client)
            self._send(client)
        except BlockingIOError:
            self._watch(client)
        except OSError:
            self._drop(client)

    def _receive(self, client: _Client) -> None:
        if client.unsent:  # first it must take what it has asked for
            return
        data = client.connection.recv(LONGEST_LINE)
        if not data:
            raise ConnectionResetError
        *lines, rest = (client.received + data).split(b"\n")
        for line in lines:
            client.unsent += answer(bytes(line), self.methods)
        client.received = rest
        if len(rest) > LONGEST_LINE or len(client.unsent) > LARGEST_BACKLOG:
            raise ConnectionAbortedError

    def _send(self, client: _Client) -> None:
        if client.unsent:
            del client.unsent[: client.connection.send(client.unsent)]
        self._watch(client)

    def _watch(self, client: _Client) -> None:
        events = selectors.EVENT_WRITE if client.unsent else selectors.EVENT_READ
        self._selector.modify(client.connection, events, client)

    def _drop(self, client: _Client) -> None:
        self._selector.unregister(client.connection)
        client.connection.close()

    def close(self) -> None:
        """Hang up on all."""
        for key in list(self._selector.get_map().values()):
            if key.data is not None:
                self._drop(key.data)
        self._selector.close()
        self._listener.close()
