"""What the panel costs and how fast it is, in a real browser: `python bench/panel.py [--seconds 60]`.

Four axes at 2 kHz on the virtual rig, excited and recorded, the scope open in chromium. Printed beside the
goal: frames a second, processor time of renderer and panel, rows lost; p99 of the lateness with the page open
over that without, in interleaved pairs; from a click on the e-stop to neutral.
"""

from __future__ import annotations

import argparse
import copy
import json
import os
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from seod.client import Client, ClientError
from seod.files.shipped import configs_dir

if TYPE_CHECKING:
    from collections.abc import Sequence

sys.path.insert(0, str(Path(__file__).parents[1]))
from tests.chromium import Page, chromium

AXES = 4
PLANTS = ((0.21, 117.0), (0.45, 145.0), (0.8, 60.0), (0.35, 90.0))
TICKS_S = os.sysconf("SC_CLK_TCK")
PATIENCE_S = 120.0
EDGES_US = [2.0 ** (k / 4) for k in range(63)]


def rig(axes: int, port: int, panel_port: int, rate_hz: float) -> str:
    """The shipped virtual rig with so many axes, and room for a busy machine."""
    raw = yaml.safe_load((configs_dir() / "virtual.yaml").read_text())
    axis, plant = raw["axes"].pop("motor"), raw["simulation"]["plants"].pop("motor")
    sensor, output = raw["sensors"].pop("angle"), raw["outputs"].pop("valve")
    for k, (zeta, omega_n) in enumerate(PLANTS[:axes]):
        scale = 0.21 * 117.0 / (zeta * omega_n)
        raw["sensors"][f"s{k}"] = sensor | {"channel": f"y{k}"}
        raw["outputs"][f"o{k}"] = output | {"channel": f"u{k}"}
        raw["axes"][f"axis{k}"] = one = copy.deepcopy(axis) | {"sensor": f"s{k}", "output": f"o{k}"}
        one["relay"]["hysteresis"] = 0.004 * scale
        one["limits"] |= {"travel": ["-120 deg", "120 deg"], "amplitude": "1.5 rad", "growth": 10}
        values = {"input": f"u{k}", "output": f"y{k}", "zeta": zeta, "omega_n": omega_n}
        raw["simulation"]["plants"][f"axis{k}"] = plant | values | {"noise": 1e-3 * scale}
    raw["rig"] = f"panel{os.getpid()}"
    raw["loop"] |= {"rate_hz": rate_hz, "hang_timeout": "1 s"}
    raw["guard"] |= {"stale": "100 ms", "overruns": {"count": 2000, "window": "1 s"}}
    raw["server"] |= {"port": port, "panel_port": panel_port}
    raw["record"] = {"folder": "recordings"}
    return json.dumps(raw)


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as free:
        number: int = free.getsockname()[1]
        return number


def processes(word: str) -> list[int]:
    """Processes with this word in their command line."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                if word.encode() in (entry / "cmdline").read_bytes():
                    found.append(int(entry.name))
            except OSError:  # ended meanwhile
                continue
    return found


def processor_s(pids: Sequence[int]) -> float:
    """User and system time of processes so far [s]."""
    total = 0
    for pid in pids:
        after_name = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
        total += int(after_name[11]) + int(after_name[12])
    return total / TICKS_S


def p99_us(before: Sequence[int], after: Sequence[int]) -> float:
    """99th percentile of the lateness between two readings of its histogram [us], within its bin."""
    bins = [b - a for a, b in zip(before, after, strict=True)]
    wanted, reached = 0.99 * sum(bins), 0.0
    for edge, count in zip(EDGES_US, bins, strict=False):
        if count and reached + count >= wanted:
            low = edge / 2.0**0.25
            return low + (edge - low) * (wanted - reached) / count
        reached += count
    return EDGES_US[-1]


def excite(client: Client) -> None:
    end = time.monotonic() + PATIENCE_S
    while time.monotonic() < end:
        try:
            client.start()
        except ClientError as error:
            print("waiting:", error)
        time.sleep(1.0)
        if all(axis["state"] == "exciting" for axis in client.status()["axes"].values()):
            return
        if client.status()["state"] == "fault":
            client.reset()
    sys.exit("the rig cannot be excited")


def watch(client: Client, page: Page, seconds: float) -> dict[str, float]:
    """Frames, processor time and lateness while the page is open."""
    renderers, panel = processes("--type=renderer"), processes("seod.panel")
    before, begun = client.status()["health"], time.monotonic()
    renderer_s, panel_s = processor_s(renderers), processor_s(panel)
    frames = []
    while time.monotonic() - begun < seconds:
        time.sleep(1.0)
        frames.append(int(page.js("document.documentElement.dataset.frames || '0'")))
    passed = time.monotonic() - begun
    after = client.status()["health"]
    return {
        "frames": statistics.mean(frames[1:]),
        "least": min(frames[1:]),
        "renderer": (processor_s(renderers) - renderer_s) / passed,
        "panel": (processor_s(panel) - panel_s) / passed,
        "p99": p99_us(before["lateness"]["bins"], after["lateness"]["bins"]),
        "lost": after["rows_lost"] - before["rows_lost"],
        "overruns": after["overruns"] - before["overruns"],
    }


def without_page(client: Client, seconds: float) -> float:
    """p99 of the lateness [us] while nobody has a page open."""
    before = client.status()["health"]["lateness"]["bins"]
    time.sleep(seconds)
    return p99_us(before, client.status()["health"]["lateness"]["bins"])


def clicks(client: Client, page: Page, rounds: int) -> list[float]:
    """From the press of the button to the first row with u = 0 in fault [ms]."""
    page.js(
        "document.addEventListener('pointerdown', () => {"
        "window.pressed = performance.timeOrigin + performance.now(); }, true)"
    )
    delays = []
    for _ in range(rounds):
        excite(client)
        page.click("estop")
        page.until(lambda: page.text("state") == "fault", "not stopped", PATIENCE_S)
        fault = client.get("axis0")["fault"]
        pressed = float(page.js("window.pressed")) / 1e3 - (time.time() - time.monotonic())
        delays.append(1e3 * (fault["t"] - pressed))
        client.reset()
    return delays


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--pairs", type=int, default=4)
    parser.add_argument("--rounds", type=int, default=10)
    parser.add_argument("--rate-hz", type=float, default=2000.0)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        port, panel_port = free_port(), free_port()
        config = Path(name) / "rig.yaml"
        config.write_text(rig(AXES, port, panel_port, given.rate_hz))
        command = [sys.executable, "-m", "seod.cli", "run", str(config)]
        with subprocess.Popen(command, stderr=subprocess.DEVNULL) as process:
            try:
                run(given, port, panel_port)
            finally:
                process.terminate()


def connected(port: int) -> Client:
    end = time.monotonic() + PATIENCE_S
    while time.monotonic() < end:
        try:
            client = Client(port=port)
            if client.status()["health"]["ticks"]:
                return client
        except ClientError:
            time.sleep(0.2)
    sys.exit("the daemon does not come up")


def run(given: argparse.Namespace, port: int, panel_port: int) -> None:
    with connected(port) as client:
        excite(client)
        client.call("record", on=True)
        found: list[dict[str, Any]] = []
        part = given.seconds / given.pairs
        for _ in range(given.pairs):
            alone = without_page(client, part)
            with chromium() as page:
                page.driver.get(f"http://127.0.0.1:{panel_port}/")
                page.until(lambda page=page: page.text("link") == "live", "never live", PATIENCE_S)
                time.sleep(2.0)
                found.append(watch(client, page, part) | {"alone": alone})
            print({key: round(value, 3) for key, value in found[-1].items()}, flush=True)
        recorder = client.status()["health"]["recorder"]
        client.call("record", on=False)
        with chromium() as page:
            page.driver.get(f"http://127.0.0.1:{panel_port}/")
            page.until(lambda: page.text("link") == "live", "never live", PATIENCE_S)
            delays = clicks(client, page, given.rounds)
    tell(found, delays, recorder)


def tell(found: list[dict[str, Any]], delays: list[float], recorder: dict[str, Any]) -> None:
    ratio = statistics.median(each["p99"] / each["alone"] for each in found)
    print(f"machine shared by others: load {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors")
    print(f"frames/s: {statistics.mean(e['frames'] for e in found):.0f} (goal: at least 50)")
    print(
        f"renderer: {100 * statistics.mean(e['renderer'] for e in found):.1f} % of a core (goal: at most 25)"
    )
    print(f"panel: {100 * statistics.mean(e['panel'] for e in found):.1f} % of a core")
    print(
        f"loop p99 with the page over without: {ratio:.2f}, median of {len(found)} pairs (goal: at most 1.1)"
    )
    print(f"rows lost: {sum(e['lost'] for e in found)}, by the recorder {recorder['lost']} (goal: 0)")
    print(f"click to neutral [ms]: median {statistics.median(delays):.1f}, most {max(delays):.1f} (goal: 50)")


if __name__ == "__main__":
    main()
