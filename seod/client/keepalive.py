"""Holding a rig that has `guard.dead_man`: keepalives while this process lives. Standard library only."""

from __future__ import annotations

import signal
import threading
import time
from contextlib import suppress
from typing import TYPE_CHECKING, Self

from seod.client.connection import ClientError, RequestError

if TYPE_CHECKING:
    from seod.client.connection import Client

MOVING = ("exciting", "holding", "armed")
LOOK_S = 0.1
CALLS = 4
"""Keepalives in the time after which the rig would stop."""


STOPS_S = 10.0
"""An axis is back where it stood at start within this time."""


def hold_until_interrupted(client: Client, axis: str | None) -> None:
    """Start, hold until Ctrl-C or SIGTERM, stop, and let go once nothing moves any more.

    Raises:
        ClientError: It cannot be started; the daemon has ended.
    """
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.default_int_handler)
    with Hold(client):
        client.start(axis)
        try:
            while client.info()["state"] in MOVING:
                time.sleep(LOOK_S)
        except KeyboardInterrupt:
            client.stop(axis)
            deadline = time.monotonic() + STOPS_S
            while client.info()["state"] in MOVING and time.monotonic() < deadline:
                time.sleep(LOOK_S)


class Hold:
    """A context: within it the rig is held, by a thread with a connection of its own.

    The rig stops when the process ends, however that happens, when it stands still, or the connection breaks.
    A rig without `guard.dead_man` needs nothing of this, and nothing is done.

    Args:
        client: A connection; it stays free for others.

    Raises:
        ClientError: The daemon does not answer.
    """

    def __init__(self, client: Client) -> None:
        silent_s = client.info()["dead_man"]
        self._period_s = 0.0 if silent_s is None else silent_s / CALLS
        self._client = client.again() if self._period_s else None
        self._let_go = threading.Event()
        self._thread = threading.Thread(target=self._keep, name="holds the rig", daemon=True)

    def __enter__(self) -> Self:
        if self._client is not None:
            with suppress(RequestError):  # the loop may still start; who may not command is told by `start`
                self._client.keepalive()
            self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._client is not None:
            self._let_go.set()
            self._thread.join()
            self._client.close()

    def _keep(self) -> None:
        while self._client is not None and not self._let_go.wait(self._period_s):
            try:
                self._client.keepalive()
            except RequestError:  # in a fault, or just after an e-stop: goes on for the next start
                continue
            except ClientError:  # the daemon has ended, and the rig with it
                return
