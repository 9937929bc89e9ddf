"""Daemons that run on this computer, by the names of their rigs. Standard library only.

A gateway holds an abstract Unix socket whose name says where it listens. The kernel lists these names for all
users of a network namespace, and drops one with its owner however that ends: no file can be left over.
"""

from __future__ import annotations

import socket
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple
from urllib.parse import quote, unquote

from seod.client.connection import UnreachableError

if TYPE_CHECKING:
    from collections.abc import Iterable

_PREFIX = "seod-at/"
_LONGEST = 107
"""Bytes of such a name."""
_LIST = Path("/proc/net/unix")


class Address(NamedTuple):
    """Where a daemon listens, and whether it wants TLS."""

    rig: str
    host: str
    port: int
    tls: bool


def announce(address: Address) -> socket.socket | None:
    """Hold the name of an address; closing the socket gives it up. None: the name is too long, or taken."""
    name = _PREFIX + "/".join(
        (quote(address.rig, safe=""), address.host, str(address.port), str(int(address.tls)))
    )
    held = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        if len(name.encode()) <= _LONGEST:
            held.bind("\0" + name)
            return held
    except OSError:  # another daemon of this rig ends just now
        pass
    held.close()
    return None


def running(lines: Iterable[str] | None = None) -> list[Address]:
    """All daemons of this computer (of this network namespace).

    Args:
        lines: Of the kernel's list, to be read in its place.
    """
    if lines is None:
        try:
            lines = _LIST.read_text("utf-8", "replace").splitlines()
        except OSError:  # no Linux
            return []
    found = set()
    for line in lines:
        _, at, name = line.partition(f" @{_PREFIX}")
        parts = name.split("/")
        if at and len(parts) == 4 and parts[2].isdigit():
            found.add(Address(unquote(parts[0]), parts[1], int(parts[2]), parts[3] == "1"))
    return sorted(found)


def find(rig: str) -> Address:
    """The daemon of a rig.

    Raises:
        UnreachableError: None runs here; says which do.
    """
    every = running()
    for address in every:
        if address.rig == rig:
            return address
    there = ", ".join(each.rig for each in every) or "none"
    raise UnreachableError(f"no daemon of rig {rig!r} runs on this computer; there are: {there}")
