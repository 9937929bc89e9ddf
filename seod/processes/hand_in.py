"""How the panel hands its clients to the gateway: an end of a new connection, and whom it is for.

So each of them is a client of the gateway like any other, with its rights, its turns and its e-stop.
"""

from __future__ import annotations

import json
import socket

Peer = tuple[str, int]
"""Address and port of a client."""
_BYTES = 256


def hand_in(way: socket.socket, peer: Peer) -> socket.socket:
    """Our end of a new connection to the gateway; it lives as long as the gateway does.

    Args:
        way: Connected SOCK_SEQPACKET socket whose other end the gateway has; it may come to read later.
        peer: Whom the connection is for.

    Raises:
        OSError: The gateway takes no more at present.
    """
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_STREAM)
    with theirs:
        try:
            flags = socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL
            socket.send_fds(way, [json.dumps(peer).encode()[:_BYTES]], [theirs.fileno()], flags)
        except OSError:
            ours.close()
            raise
    ours.setblocking(False)
    return ours


def receive_client(way: socket.socket) -> tuple[socket.socket, Peer] | None:
    """The next client that was handed in; None if there is none."""
    try:
        data, fds, _, _ = socket.recv_fds(way, _BYTES, 1, socket.MSG_DONTWAIT)
    except BlockingIOError:
        return None
    if not fds:
        return None
    end = socket.socket(fileno=fds[0])
    end.setblocking(False)
    host, port = json.loads(data)
    return end, (str(host), int(port))
