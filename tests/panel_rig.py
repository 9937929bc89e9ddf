"""A daemon with a panel, for tests: a virtual rig on free ports, patient with a busy machine."""

from __future__ import annotations

import json
import re
import ssl
import urllib.request
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from tests.peers import Program, Rpc, find_process, free_port, port_of, until, write_rig_file

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


class PanelRig:
    """The daemon, and where its servers are."""

    def __init__(self, program: Program, rig_file: Path, ports: dict[str, int], scheme: str) -> None:
        self.program, self.rig_file, self.ports = program, rig_file, ports
        self.port = port_of(rig_file)
        self.url = f"{scheme}://127.0.0.1:{ports['panel']}"

    def ask(
        self, path: str, method: str = "GET", body: bytes | None = None, **headers: str
    ) -> tuple[int, dict[str, str], str]:
        """One request: status, headers and body; redirections are not followed."""
        told = {name.replace("_", "-"): value for name, value in headers.items()}
        request = urllib.request.Request(self.url + path, body, told, method=method)
        context = ssl.create_default_context()
        context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
        opener = urllib.request.build_opener(_Stay, urllib.request.HTTPSHandler(context=context))
        with opener.open(request) as answer:
            return answer.status, {k.lower(): v for k, v in answer.headers.items()}, answer.read().decode()

    def session(self) -> dict[str, str]:
        """Cookie, origin and word of a session of its own, as headers."""
        cookie = self.ask("/")[1]["set-cookie"].split(";")[0]
        about = json.loads(self.ask("/api/about", cookie=cookie)[2])
        return {"cookie": cookie, "origin": self.url, "x_seod_csrf": about["csrf"]}

    def child(self, module: str) -> int:
        """The daemon's process that runs this module."""
        return until(module, lambda: find_process(module, self.program.pid))

    def rpc(self) -> Rpc:
        return Rpc(self.port)


class _Stay(urllib.request.HTTPErrorProcessor):
    def http_response(self, request: Any, response: Any) -> Any:
        return response

    https_response = http_response


@contextmanager
def panel_daemon(folder: Path, server: str = "", scheme: str = "http") -> Iterator[PanelRig]:
    """The daemon, up and ticking, with its panel, SCPI and Foxglove; `server` goes into that section."""
    path = write_rig_file(folder)
    ports = {"panel": free_port(), "scpi": free_port()}
    text = f"panel_port: {ports['panel']}\n  scpi: true\n  scpi_port: {ports['scpi']}\n  foxglove: true\n"
    written = path.read_text().replace("panel: false\n", text + server, 1)
    written = re.sub(r"^# record:.*$", "record:\n  folder: recordings", written, count=1, flags=re.MULTILINE)
    path.write_text(written)
    program = Program(path.with_name("log"), "run", path)
    try:
        until("the panel", lambda: "SCPI on" in program.said() or program.process.poll() is not None, 100)
        assert program.process.poll() is None, program.said()
        until("the gateway", lambda: "JSON-RPC on" in program.said())
        yield PanelRig(program, path, ports, scheme)
    finally:
        program.stop()
