"""A client for programs: live estimates and commands over TCP.

    from seod.client import Client
    with Client() as rig:
        rig.start()
        for e in rig.estimates():
            print(e["zeta"], e["omega_n"])

Standard library only.
"""

from seod.client.connection import (
    DEFAULT_HOST,
    DEFAULT_PORT,
    Client,
    ClientError,
    EndedError,
    RequestError,
    UnreachableError,
)
from seod.client.keepalive import Hold

__all__ = [
    "DEFAULT_HOST",
    "DEFAULT_PORT",
    "Client",
    "ClientError",
    "EndedError",
    "Hold",
    "RequestError",
    "UnreachableError",
]
