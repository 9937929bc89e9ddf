"""The panel's process: listens, serves, ends. The rig does not depend on it."""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import socket
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import uvicorn

from seod.config.model import RigConfig
from seod.gateway.server import ServerError, check_safe, tls_context
from seod.panel.app import make_app
from seod.panel.panel import Panel
from seod.panel.scpi_rig import scpi_device
from seod.processes.handover import ChildArguments, die_with_parent, read_memfd, send_json
from seod.processes.realtime import OTHERS_OOM, be_ended_sooner
from seod.processes.ring import Shared
from seod.scpi.server import ScpiServer

if TYPE_CHECKING:
    import ssl
    from collections.abc import Iterator

    from seod.config.server import ServerConfig

NICE = -3
"""Where the system allows it: behind who estimates, before what is ordinary: an e-stop comes this way."""
ABOVE = 80
"""The panel's port where none is given, above that of the gateway."""
GOODBYE_S = 1
LARGEST_MESSAGE = 64 * 1024
"""Bytes that a page may send at once."""


class QuietServer(uvicorn.Server):
    """Leaves signals to this process."""

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Capture none."""
        yield


def panel_port(server: ServerConfig) -> int:
    """The port that the panel listens on; 0 for a free one."""
    if server.panel_port is not None:
        return server.panel_port
    port = server.port + ABOVE
    return port if server.port and port < 1 << 16 else 0


def listening(host: str, port: int, key: str) -> socket.socket:
    """A socket that listens.

    Raises:
        ServerError: The port is taken.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        return socket.create_server((host, port), family=family)
    except OSError as error:
        what = f"cannot listen on {host} port {port}: {error.strerror or error}"
        raise ServerError(f"{what}; another daemon may have it: choose another server.{key}") from error


class Serving:
    """All that this process serves.

    Args:
        panel: What the clients share.
    """

    def __init__(self, panel: Panel) -> None:
        self._panel = panel
        self._ended = asyncio.Event()
        self._server: QuietServer | None = None

    def end(self) -> None:
        """End `run`."""
        self._ended.set()

    async def run(self, link: socket.socket) -> None:
        """Serve until the end; tell the supervisor where.

        Raises:
            ServerError: It cannot listen.
        """
        server = self._panel.config.server
        check_safe(server)
        context = None if server.tls is None else tls_context(server.tls, self._panel.rig_file.parent)
        tasks = [asyncio.create_task(self._panel.run())]
        listens = []
        try:
            if server.panel or server.foxglove:
                opened = listening(server.host, panel_port(server), "panel_port")
                self._panel.sessions.cookie = f"seod_session_{opened.getsockname()[1]}"
                tasks.append(asyncio.create_task(self._serve_http(opened, context)))
                listens.append(f"panel on {address(opened, context)}")
            if server.scpi:
                opened = listening(server.host, server.scpi_port, "scpi_port")
                tasks.append(asyncio.create_task(ScpiServer(scpi_device(self._panel)).serve(opened, context)))
                listens.append(f"SCPI on port {opened.getsockname()[1]}")
            send_json(link, {"panel": "ready", "says": listens})
            await self._first_end(tasks)
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    async def _first_end(self, tasks: list[asyncio.Task[None]]) -> None:
        ended = asyncio.create_task(self._ended.wait())
        try:
            done, _ = await asyncio.wait([ended, *tasks], return_when=asyncio.FIRST_COMPLETED)
            for task in done - {ended}:
                task.result()  # raises what ended it
            if self._server is not None:
                self._server.should_exit = True
                await asyncio.wait(tasks[1:], timeout=GOODBYE_S + 0.5)
        finally:
            ended.cancel()

    async def _serve_http(self, opened: socket.socket, context: ssl.SSLContext | None) -> None:
        app, files = make_app(self._panel, "http" if context is None else "https")
        config = uvicorn.Config(
            app,
            ws="websockets-sansio",
            ws_max_size=LARGEST_MESSAGE,
            ws_per_message_deflate=False,
            log_config=None,
            access_log=False,
            lifespan="off",
            server_header=False,
            date_header=False,
            timeout_graceful_shutdown=GOODBYE_S,
        )
        config.load()
        config.ssl = context
        self._server = QuietServer(config)
        try:
            with opened:
                await self._server.serve(sockets=[opened])
        finally:
            await files.jobs.close()


def address(opened: socket.socket, context: ssl.SSLContext | None) -> str:
    """Where a browser finds it."""
    host, port = opened.getsockname()[:2]
    return f"{'http' if context is None else 'https'}://{f'[{host}]' if ':' in host else host}:{port}"


async def serve(arguments: ChildArguments, link: socket.socket) -> None:
    """Map what was inherited, then run until the end.

    Raises:
        ServerError: It cannot start.
    """
    config = RigConfig.model_validate_json(read_memfd(arguments.config_fd))
    shared = Shared(arguments.axes, arguments.rows, arguments.shared_fd)
    way = socket.socket(fileno=arguments.panel_fd)
    try:
        serving = Serving(Panel(config, shared, way, Path(arguments.config_path)))
        for number in (signal.SIGTERM, signal.SIGINT):
            asyncio.get_running_loop().add_signal_handler(number, serving.end)
        await serving.run(link)
    finally:
        way.close()
        shared.close()


def main() -> int:
    """Entry point of the panel's process."""
    arguments = ChildArguments.from_argv()
    die_with_parent(arguments.supervisor_pid)
    be_ended_sooner(OTHERS_OOM)
    with contextlib.suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, 0, NICE)
    with socket.socket(fileno=arguments.supervisor_fd) as link:
        try:
            asyncio.run(serve(arguments, link))
        except ServerError as error:
            send_json(link, {"panel": "failed", "why": str(error)})
            return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
