"""What only one daemon may have at a time: its rig, and each actuator that it commands.

A lock is a name of an abstract Unix socket: seen by all users of this network namespace, and gone with its
owner however that ends. A CAN interface is in one network namespace, too. The supervisor holds the locks, so
that they stay taken while a loop is started again.
"""

from __future__ import annotations

import errno
import hashlib
import os
import socket
import struct
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Iterable

LONGEST: Final = 90
"""Bytes of a name; longer ones (the kernel takes 107) are shortened to their digest."""


class LockedError(Exception):
    """Somebody else has it; the message says who, and what to do."""


def lock_rig(rig: str) -> None:
    """Take the lock of a rig, by its name, for the life of this process, `exec` included.

    Raises:
        LockedError: It is run already.
    """
    owner = _take(f"seod/{rig}")
    if owner:
        raise LockedError(f"rig {rig!r} is run already by {owner}: stop that daemon first")


def lock_claims(claims: Iterable[str]) -> None:
    """Likewise what a rig's driver commands (`Driver.claims`).

    Raises:
        LockedError: Another daemon commands it.
    """
    for claim in claims:
        owner = _take(f"seod/claim/{claim}")
        if owner:
            raise LockedError(
                f"{claim} is commanded already by {owner}, another daemon on this computer: two would fight "
                "over the actuator; stop that daemon first"
            )


def _take(name: str) -> str:
    """Take a name; "" or who has it already."""
    address = "\0" + (name if len(name.encode()) <= LONGEST else _digest(name))
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_NONBLOCK) as mine:
        try:
            mine.bind(address)
        except OSError as error:
            if error.errno != errno.EADDRINUSE:
                raise
            return _owner(mine, address)
        mine.listen(128)
        os.set_inheritable(mine.fileno(), True)
        mine.detach()
    return ""


def _digest(name: str) -> str:
    return "seod/" + hashlib.sha256(name.encode()).hexdigest()


def _owner(mine: socket.socket, address: str) -> str:
    """Who holds a lock, for people."""
    try:
        mine.connect(address)
        pid, _, _ = struct.unpack("3i", mine.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, 12))
    except OSError:  # it ends just now
        return "another process"
    return f"process {pid}"
