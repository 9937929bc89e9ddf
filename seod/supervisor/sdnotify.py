"""systemd's notification socket: one datagram of text (sd_notify(3)). Standard library only."""

from __future__ import annotations

import math
import os
import socket


def notify(state: str) -> None:
    """Send `state` ("READY=1", "WATCHDOG=1", ...) if systemd started us; never waits, never raises."""
    address = os.environ.get("NOTIFY_SOCKET")
    if not address:
        return
    if address.startswith("@"):
        address = "\0" + address[1:]
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK) as sock:
        try:
            sock.sendto(state.encode(), address)
        except OSError:
            return


def watchdog_interval() -> float:
    """How often to feed the watchdog [s]: a quarter of its time; infinite where there is none."""
    microseconds = os.environ.get("WATCHDOG_USEC")
    return float(microseconds) / 4e6 if microseconds else math.inf
