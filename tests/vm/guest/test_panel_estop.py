"""From a page's e-stop to neutral on a real bus: over its WebSocket, up to the first neutral frame."""

from __future__ import annotations

import json
import time
import urllib.request
from typing import TYPE_CHECKING, Any

import pytest
from bus import CONFIG
from conftest import run_daemon
from websockets.sync.client import connect

from tests.peers import until

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from bus import Listener
    from conftest import Bench

    from tests.peers import Rpc

URL = "127.0.0.1:7680"
ROUNDS = 8


@pytest.fixture
def panel_bench(rig: Rpc, tmp_path: Path) -> Iterator[Bench]:
    """A daemon with its panel."""
    text = CONFIG.read_text().replace("panel: false", "panel: true")
    config = CONFIG.with_name("with-panel.yaml")  # beside its DBC
    config.write_text(text)
    try:
        with run_daemon(rig, config, tmp_path) as bench:
            until("the panel", lambda: "panel on" in bench.program.said())
            yield bench
    finally:
        config.unlink()


def page_headers() -> tuple[dict[str, str], str]:
    """The cookie and the word of a session, as a browser gets them."""
    with urllib.request.urlopen(f"http://{URL}/") as answer:
        cookie = answer.headers["set-cookie"].split(";")[0]
    request = urllib.request.Request(f"http://{URL}/api/about", headers={"cookie": cookie})
    with urllib.request.urlopen(request) as answer:
        return {"cookie": cookie}, json.load(answer)["csrf"]


def test_neutral_follows_a_page_at_once(panel_bench: Bench, listener: Listener) -> None:
    headers, word = page_headers()
    protocols: list[Any] = ["seod.panel.1", f"csrf.{word}"]
    origin: Any = f"http://{URL}"
    delays = []
    with connect(f"ws://{URL}/ws", subprotocols=protocols, origin=origin, additional_headers=headers) as page:
        for number in range(ROUNDS):
            panel_bench.excite()
            until("commands", lambda: any(frame.volts for frame in listener.read()))
            listener.read()
            seen, asked = len(listener.frames), time.monotonic()
            page.send(json.dumps({"id": number, "method": "estop"}))
            answer: dict[str, Any] = {}
            while answer.get("id") != number:
                data = page.recv(timeout=30)
                answer = json.loads(data) if isinstance(data, str) else {}
            assert answer["result"] == {"ok": True}
            until("neutral", lambda seen=seen: any(f.volts == 0.0 for f in listener.read()[seen:] or []))
            after = [frame for frame in listener.frames[seen:] if frame.t >= asked]
            first = next(k for k, frame in enumerate(after) if frame.volts == 0.0)
            assert {frame.volts for frame in after[first:]} == {0.0}
            delays.append(after[first].t - asked)
            panel_bench.recover()
            panel_bench.center()
    told = ", ".join(f"{1e3 * delay:.1f}" for delay in sorted(delays))
    print(f"from the page's e-stop to neutral on the bus [ms]: {told}")
