"""What clients can do to a daemon, each until it is killed: python bench/estop_attacks.py NAME PORT.

Written against the protocol alone.
"""

from __future__ import annotations

import json
import select
import socket
import sys
import time

PAUSE_S = 0.001


def line(method: str, number: int | None = 1, **params: object) -> bytes:
    request = {"jsonrpc": "2.0", "method": method, "params": params}
    return json.dumps(request | ({} if number is None else {"id": number})).encode() + b"\n"


def connect(port: int, blocking: bool = False) -> socket.socket:
    client = socket.create_connection(("127.0.0.1", port))
    client.setblocking(blocking)
    return client


def push(clients: list[socket.socket], data: bytes) -> None:
    """Send as much as each takes, for ever, without reading."""
    offsets = dict.fromkeys(clients, 0)
    while True:
        _, ready, _ = select.select([], clients, [], 1.0)
        for client in ready:
            offsets[client] = (offsets[client] + client.send(data[offsets[client] :])) % len(data)


def drain(clients: list[socket.socket]) -> None:
    """Read all that comes, for ever."""
    while True:
        for client in select.select(clients, [], [], 1.0)[0]:
            client.recv(1 << 20)


def status_unread(port: int) -> None:
    """20 clients that ask `status` and never read."""
    push([connect(port) for _ in range(20)], line("status") * 1000)


def subscriptions(port: int) -> None:
    """60 clients with 40 subscriptions each, all at rates of their own."""
    clients = [connect(port, blocking=True) for _ in range(60)]
    topics = ["sample", "estimate", "event", "health"]
    for number, client in enumerate(clients):
        asked = [line("subscribe", k, topics=topics, rate_hz=50.0 + 40 * number + k) for k in range(40)]
        client.sendall(b"".join(asked))
    drain(clients)


def gain(port: int) -> None:
    """K_L at the ends of what can be set, twice a second; the worst that could be is tried, too."""
    client = connect(port, blocking=True)
    while True:
        for value in (1e-308, 1.7, 170.0, 1e308, 17.0):
            client.sendall(line("set", K_L=value))
            time.sleep(0.5)
            client.recv(65536)


def half_lines(port: int) -> None:
    """90 clients whose lines never end, a byte at a time."""
    clients = [connect(port) for _ in range(90)]
    while True:
        for client in clients:
            client.send(b'{"jsonrpc":"2.0","id":1,"method":"status","params":{"a":'[:1])
        time.sleep(PAUSE_S)


def sets(port: int) -> None:
    """Four clients that set something as fast as it is taken, and read the answers."""
    clients = [connect(port, blocking=True) for _ in range(4)]
    data = b"".join(line("set", k, bias=(k % 3) * 1e-3) for k in range(50))
    while True:
        for client in clients:
            client.sendall(data)
        for client in clients:
            client.recv(1 << 20)


def strangers(port: int) -> None:
    """Connections that never authenticate, as many and as fast as the daemon takes them."""
    held: list[socket.socket] = []
    while True:
        try:
            held.append(connect(port))
        except OSError:
            time.sleep(PAUSE_S)
        if len(held) > 500:
            held.pop(0).close()


def burst(port: int) -> None:
    """98,944 commands at once, again and again."""
    while True:
        with connect(port, blocking=True) as client:
            client.settimeout(1.0)
            try:
                client.sendall(line("set", bias=0.001) * 98_944)
            except TimeoutError:
                continue


ATTACKS = {
    "status, unread": status_unread,
    "60 x 40 subscriptions": subscriptions,
    "K_L at its bounds": gain,
    "half lines": half_lines,
    "flood of set": sets,
    "strangers": strangers,
    "98,944 commands": burst,
}

if __name__ == "__main__":
    ATTACKS[sys.argv[1]](int(sys.argv[2]))
