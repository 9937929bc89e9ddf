"""`seod run --start --watch`: the daemon as a child of the terminal, and this process as its first client."""

from __future__ import annotations

import signal
import time
from contextlib import nullcontext, suppress
from typing import TYPE_CHECKING

from seod.client import Client, EndedError, RequestError, UnreachableError
from seod.client.keepalive import Hold
from seod.config.tokens import TokenError, client_token
from seod.files.user_files import not_recordable
from seod.launch.daemon import prepare, spawn
from seod.protocol.jsonrpc import NO_ANSWER

if TYPE_CHECKING:
    import subprocess
    from pathlib import Path

    from seod.config.model import RigConfig

READY_S = 30.0
"""The daemon must answer within this time."""
FIRST_TICK_S = 120.0
"""A loop that has not started yet is waited for this long: a busy machine loads the plant slowly."""
SAMPLES_S = 5.0
"""A rig that refuses to start is asked again for this long: its first samples may still be under way."""
PAUSE_S = 0.1


class StartError(Exception):
    """The daemon did not come up or does not start the excitation; the message says why."""


def run_with_client(
    config: RigConfig, path: Path, duration: float | None, record: Path | None, start: bool, watch: bool
) -> int:
    """Run the daemon until it ends; ends it on Ctrl-C and SIGTERM. Returns its exit code.

    Args:
        config: The rig file, read.
        path: Where it is.
        duration: How long the daemon runs [s].
        record: File that it records to.
        start: Excite all axes once it is up.
        watch: Show live estimates.

    Raises:
        StartError: The excitation cannot be started.
    """
    if record is not None and (why := not_recordable(record)):
        raise StartError(f"--record {record}: {why}")
    if config.server.port == 0:
        raise StartError("server.port is 0, any free one: --start and --watch need a fixed port")
    signal.signal(signal.SIGTERM, _interrupt)
    prepare(config)
    daemon = spawn(path, duration, record)
    try:
        _accompany(config, path, daemon, start, watch)
        return daemon.wait()
    except KeyboardInterrupt:
        return _end(daemon)
    finally:
        _end(daemon)


def _interrupt(*_: object) -> None:
    raise KeyboardInterrupt


def _end(daemon: subprocess.Popen[bytes]) -> int:
    if daemon.poll() is None:
        daemon.terminate()
    return daemon.wait()


def _accompany(
    config: RigConfig, path: Path, daemon: subprocess.Popen[bytes], start: bool, watch: bool
) -> None:
    client = connect(config, path, daemon)
    if client is None:
        return
    with client, suppress(EndedError), Hold(client) if start else nullcontext():
        if start:
            begin(client, daemon)
        if watch:
            from seod.terminal.live_view import watch as show_live  # noqa: PLC0415 - rich is needed for nothing else

            show_live(client)
        daemon.wait()  # an end is told by its exit code


def connect(config: RigConfig, path: Path, daemon: subprocess.Popen[bytes]) -> Client | None:
    """A client of this very daemon, once it is up; None if it ends before.

    Raises:
        StartError: It does not come up in time.
    """
    server = config.server
    tls = None if server.tls is None else path.parent / server.tls.certificate
    try:
        token = client_token(config)
    except TokenError as error:
        raise StartError(str(error)) from error
    deadline = time.monotonic() + READY_S
    while daemon.poll() is None:
        try:
            client = Client(server.host, server.port, token, tls)
        except UnreachableError as error:
            if time.monotonic() > deadline:
                raise StartError(f"the daemon does not answer: {error}") from error
        else:
            if client.info()["rig"] == config.rig:
                return client
            client.close()  # another daemon has the port: ours will say so and end
        time.sleep(PAUSE_S)
    return None


def begin(client: Client, daemon: subprocess.Popen[bytes]) -> None:
    """Start the excitation, as soon as the loop ticks and samples come.

    Raises:
        StartError: The rig refuses; says why.
    """
    asked = time.monotonic()
    while daemon.poll() is None:
        try:
            client.start()
        except RequestError as error:
            patience = FIRST_TICK_S if error.code == NO_ANSWER else SAMPLES_S
            if time.monotonic() > asked + patience:
                raise StartError(f"cannot start: {error}") from error
            time.sleep(PAUSE_S)
        else:
            return
