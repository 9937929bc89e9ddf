"""The control port: requests without sockets, then the server and what a client can do to it."""

from __future__ import annotations

import json
import socket
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.control import LONGEST_LINE, ControlServer, answer

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sim.control import Methods


def refuse(_params: dict[str, Any]) -> object:
    raise ValueError("not like this")


METHODS: Methods = {"echo": lambda params: params, "big": lambda _params: "x" * (4 << 20), "refuse": refuse}


def call(request: object) -> Any:
    line = answer(json.dumps(request).encode(), METHODS)
    assert line.endswith(b"\n")
    return json.loads(line)


def test_a_request_is_answered_with_its_id() -> None:
    request = {"jsonrpc": "2.0", "id": "a", "method": "echo", "params": {"x": 1}}
    assert call(request) == {"jsonrpc": "2.0", "id": "a", "result": {"x": 1}}


def test_params_may_be_left_out() -> None:
    assert call({"id": 1, "method": "echo"})["result"] == {}


def test_a_notification_is_done_without_an_answer() -> None:
    assert answer(b'{"method": "echo"}', METHODS) == b""


@pytest.mark.parametrize(
    ("request_", "code", "said"),
    [
        ({"id": 1, "method": "nothing"}, -32601, "echo"),
        ({"id": 1, "method": "echo", "params": [1]}, -32602, "object"),
        ({"id": 1, "method": "refuse"}, -32602, "not like this"),
        ({"id": 1, "method": ["echo"]}, -32600, "method"),
        ([1, 2], -32600, "method"),
    ],
)
def test_a_wrong_request_is_told_why(request_: object, code: int, said: str) -> None:
    error = call(request_)["error"]
    assert error["code"] == code
    assert said in error["message"]


@pytest.mark.parametrize("line", [b"", b"{", b"\xff\xfe", b"[" * 50000])
def test_what_is_no_json_is_told_so(line: bytes) -> None:
    assert json.loads(answer(line, METHODS))["error"]["code"] == -32700


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda children: st.lists(children, max_size=3) | st.dictionaries(st.text(), children, max_size=3),
    max_leaves=8,
)


@given(line=st.binary() | JSON.map(lambda value: json.dumps(value).encode()))
def test_any_line_has_an_answer_or_is_a_notification(line: bytes) -> None:
    response = answer(line, METHODS)
    assert response == b"" or "error" in json.loads(response)


@given(method=JSON, params=JSON, identity=JSON)
def test_any_request_has_an_answer(method: object, params: object, identity: object) -> None:
    line = answer(json.dumps({"id": identity, "method": method, "params": params}).encode(), METHODS)
    assert ("result" in json.loads(line)) != ("error" in json.loads(line))


@pytest.fixture
def server() -> Iterator[ControlServer]:
    server = ControlServer(0, METHODS)
    yield server
    server.close()


@pytest.fixture
def client(server: ControlServer) -> Iterator[socket.socket]:
    with socket.create_connection(("127.0.0.1", server.port)) as client:
        client.settimeout(0.05)
        yield client


def exchange(server: ControlServer, client: socket.socket, end: bytes = b"\n") -> bytes:
    """Poll until the client has a whole answer, or the end of the stream."""
    received = bytearray()
    for _ in range(1000):
        server.poll()
        try:
            chunk = client.recv(1 << 20)
        except TimeoutError:
            continue
        received += chunk
        if not chunk or received.endswith(end):
            return bytes(received)
    raise AssertionError(f"no whole answer, only {len(received)} bytes")


def test_several_requests_in_pieces_are_answered_in_order(
    server: ControlServer, client: socket.socket
) -> None:
    client.sendall(b'{"id": 1, "method": "echo"}\n{"id": 2, "met')
    assert json.loads(exchange(server, client))["id"] == 1
    client.sendall(b'hod": "echo"}\n')
    assert json.loads(exchange(server, client))["id"] == 2


def test_an_answer_larger_than_the_socket_takes_arrives_whole(
    server: ControlServer, client: socket.socket
) -> None:
    client.sendall(b'{"id": 1, "method": "big"}\n')
    assert len(json.loads(exchange(server, client))["result"]) == 4 << 20


def test_a_client_that_does_not_read_holds_up_nobody(server: ControlServer, client: socket.socket) -> None:
    client.sendall(b'{"id": 1, "method": "big"}\n' * 10)
    for _ in range(50):
        server.poll()
    with socket.create_connection(("127.0.0.1", server.port)) as other:
        other.settimeout(0.05)
        other.sendall(b'{"id": 7, "method": "echo"}\n')
        assert json.loads(exchange(server, other))["id"] == 7


def test_a_line_without_end_is_hung_up_on(server: ControlServer, client: socket.socket) -> None:
    client.sendall(b" " * (LONGEST_LINE + 1))
    assert exchange(server, client) == b""


def test_a_client_that_goes_away_is_forgotten(server: ControlServer) -> None:
    with socket.create_connection(("127.0.0.1", server.port)) as client:
        client.sendall(b'{"id": 1, "method": "big"}\n')
    for _ in range(50):
        server.poll()
    with socket.create_connection(("127.0.0.1", server.port)) as client:
        client.settimeout(0.05)
        client.sendall(b'{"id": 2, "method": "echo"}\n')
        assert json.loads(exchange(server, client))["id"] == 2


def test_a_taken_port_is_an_error(server: ControlServer) -> None:
    with pytest.raises(OSError, match="in use"):
        ControlServer(server.port, METHODS)
