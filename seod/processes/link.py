"""Messages between two processes of the daemon, in order; nobody waits. Standard library only."""

from __future__ import annotations

import json
import socket
from collections import deque
from typing import Any

from seod.processes.handover import receive_json

BUFFER_BYTES = 1 << 20
"""What the kernel may hold of them; it gives less to who is not root."""


class Link:
    """One end. What the socket has no room for waits here until the next `flush`.

    Args:
        end: Connected SOCK_SEQPACKET socket.
    """

    def __init__(self, end: socket.socket) -> None:
        end.setblocking(False)
        end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, BUFFER_BYTES)
        self._end = end
        self._queue: deque[bytes] = deque()
        self.waiting = 0
        """Bytes that wait here."""

    def fileno(self) -> int:
        """For `select`."""
        return self._end.fileno()

    def send(self, message: dict[str, Any]) -> None:
        """Send, or keep for later."""
        data = json.dumps(message, separators=(",", ":")).encode()
        self._queue.append(data)
        self.waiting += len(data)
        self.flush()

    def flush(self) -> None:
        """Send what waits, as far as there is room; nothing once the other end is gone."""
        try:
            while self._queue:
                self._end.send(self._queue[0], socket.MSG_NOSIGNAL)
                self.waiting -= len(self._queue.popleft())
        except BlockingIOError:
            return
        except OSError:
            self._queue.clear()
            self.waiting = 0

    def receive(self) -> dict[str, Any] | None:
        """The next message if there is one; {} at the end of the stream, None if nothing is waiting."""
        return receive_json(self._end)

    def close(self) -> None:
        """Nothing more comes or goes."""
        self._end.close()
