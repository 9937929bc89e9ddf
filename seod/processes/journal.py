"""Lines of systemd's journal with fields (RIG=, AXIS=, CODE=), by its own protocol. Standard library only.

`journalctl RIG=press CODE=travel` finds them. Outside a unit nothing is sent: `connected` says so.
"""

from __future__ import annotations

import os
import socket
import struct
import sys
from typing import Final

SOCKET: Final = "/run/systemd/journal/socket"
ERROR, WARNING, NOTICE, INFO = 3, 4, 5, 6
"""Priorities, as syslog has them."""


def connected() -> bool:
    """Whether standard error is a stream to the journal."""
    device, _, inode = os.environ.get("JOURNAL_STREAM", "").partition(":")
    try:
        here = os.fstat(sys.stderr.fileno())
    except (OSError, ValueError):  # closed, or no file at all
        return False
    return (device, inode) == (str(here.st_dev), str(here.st_ino))


def tell(message: str, priority: int = INFO, **fields: str) -> bool:
    """Write one line with its fields, if this is a unit; never waits. False where nothing was written.

    Args:
        message: For people.
        priority: As syslog has it.
        fields: By their upper-case names; empty ones are left out.
    """
    if not connected():
        return False
    said = {"MESSAGE": message, "PRIORITY": str(priority), "SYSLOG_IDENTIFIER": "seod", **fields}
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK) as sock:
        try:
            sock.sendto(encoded(said), SOCKET)
        except OSError:
            return False
    return True


def encoded(fields: dict[str, str]) -> bytes:
    """The datagram: each field with its length, so that a value may have any bytes."""
    parts = []
    for name, value in fields.items():
        if value:
            data = value.encode(errors="replace")
            parts.append(name.encode() + b"\n" + struct.pack("<Q", len(data)) + data + b"\n")
    return b"".join(parts)
