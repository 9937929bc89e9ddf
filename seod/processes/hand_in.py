"""How the panel hands its clients to the gateway: an end of a new connection, and whom it is for.

So each of them is a client of the gateway like any other, with its rights, its turns and its e-stop.
"""

from __future__ import annotations

import json
import socket
from array import array

Peer = tuple[str, int]
"""Address and port of a client."""
_BYTES = 256
_FD_BYTES = array("i").itemsize


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
        rights = (socket.SOL_SOCKET, socket.SCM_RIGHTS, array("i", [theirs.fileno()]))
        try:
            way.sendmsg(
                [json.dumps(peer).encode()[:_BYTES]], [rights], socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL
            )
        except OSError:
            ours.close()
            raise
    ours.setblocking(False)
    return ours


def receive_client(way: socket.socket) -> tuple[socket.socket, Peer] | None:
    """The next client that was handed in; None if there is none."""
    try:
        # not socket.recv_fds, which drops its flags up to Python 3.13: it would wait
        data, ancillary, _, _ = way.recvmsg(_BYTES, socket.CMSG_SPACE(_FD_BYTES), socket.MSG_DONTWAIT)
    except BlockingIOError:
        return None
    fds = array("i", ancillary[0][2][:_FD_BYTES]) if ancillary else array("i")
    if not fds:
        return None
    end = socket.socket(fileno=fds[0])
    end.setblocking(False)
    host, port = json.loads(data)
    return end, (str(host), int(port))
