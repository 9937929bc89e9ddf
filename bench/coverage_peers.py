"""Coverage of the live 95 % intervals on a rig in a process of its own: on a pty, or on a (virtual) CAN bus.

    python bench/coverage_peers.py serial [--trials 10] [--seconds 3]
    tests/vm/canvm.sh -- .venv/bin/python bench/coverage_peers.py can --rate 200        # as root

`seod rig` is the other end, `seod run` the daemon, both with a shipped rig file: its plant is another, takes
0 to 2 ticks longer than anybody is told (`transport_delay`), and nothing is said of the delay. Plants are
those of `coverage_live.py`, slower where the loop is slower than 2 kHz. A trial is an excitation; its first
`ok` and its last answer count. In between the daemon forgets what it learnt (another method and back).
What the machine's own scheduling adds to latency and jitter comes on top: that is the point of it.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import yaml
from accuracy_summary import wilson
from coverage_truth import E_A, K_L, PLANTS, Rig

from seod.client import Client, UnreachableError
from seod.files.shipped import configs_dir

if TYPE_CHECKING:
    from collections.abc import Iterator

SEOD = Path(sys.executable).with_name("seod")
LATENCIES = (0.0, 0.5, 2.0)
DESIGN_HZ = 2000.0
INTERVAL = 1.96
PATIENCE_S = 240.0


def rig_file(kind: str, rig: Rig, rate: float, folder: Path) -> dict[str, Any]:
    """The shipped one with another plant, patience with a busy machine, and no word of the delay."""
    told: dict[str, Any] = yaml.safe_load((configs_dir() / f"{kind}.yaml").read_text())
    tick = 1.0 / rate
    told["rig"] = f"coverage-{os.getpid()}"
    told["loop"] = {"rate_hz": int(rate), "hang_timeout": "1 s"}
    told["guard"] |= {
        "stale": "400 ms",
        "rig_watchdog": "500 ms",
        "overruns": {"count": int(rate), "window": "1 s"},
    }
    told["server"] |= {"port": _free_port(), "panel": False}
    axis, plant = told["axes"]["motor"], told["simulation"]["plants"]["motor"]
    axis["K_L"] = K_L
    axis["relay"] = {"e_a": E_A, "hysteresis": max(3.0 * rig.noise, 0.02) * rig.amplitude}
    axis["limits"] |= {"travel": [-8.0, 8.0], "amplitude": 4.0, "speed": 200.0, "growth": 100.0}
    axis["polarity"] = {"enabled": False, "movement": 1e-3}
    plant |= {"K_L": K_L, "omega_n": rig.omega_n, "zeta": rig.zeta, "noise": rig.noise * rig.amplitude}
    plant |= {"stops": [-9.0, 9.0], "effects": {"transport_delay": {"time": rig.latency * tick}}}
    told["simulation"] |= {"watchdog_s": 0.5, "control_port": 0, "sensor_rate_hz": rate}
    if kind == "serial":
        told["driver"] |= {
            "port": str(folder / "board"),
            "rate_hz": rate,
            "confirm_timeout_s": 1.0,
            "watchdog_s": 0.5,
        }
    else:
        told["driver"] |= {"dbc": str(configs_dir() / "motor.dbc"), "confirm_timeout_s": 1.0}
        told["driver"]["messages"]["Encoder"]["rate_hz"] = rate
    return told


def _free_port() -> int:
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


@contextlib.contextmanager
def program(log: Path, *arguments: object) -> Iterator[subprocess.Popen[bytes]]:
    """A seod command, ended afterwards."""
    with (
        log.open("wb") as said,
        subprocess.Popen([SEOD, *map(str, arguments)], stdout=said, stderr=said) as one,
    ):
        try:
            yield one
        finally:
            one.send_signal(signal.SIGTERM)
            one.wait(PATIENCE_S)


@contextlib.contextmanager
def running(told: dict[str, Any], folder: Path) -> Iterator[Client]:
    """Rig, daemon and a client."""
    path = folder / "rig.yaml"
    path.write_text(yaml.safe_dump(told))
    until = time.monotonic() + PATIENCE_S
    with contextlib.ExitStack() as programs:
        programs.enter_context(program(folder / "rig.log", "rig", path))
        while not (folder / "rig.log").read_text() and time.monotonic() < until:
            time.sleep(0.1)  # it says when it can be heard
        daemon = programs.enter_context(program(folder / "run.log", "run", path))
        while True:
            with contextlib.suppress(OSError, UnreachableError):
                client = Client(port=told["server"]["port"])
                break
            if time.monotonic() > until or daemon.poll() is not None:
                raise SystemExit((folder / "run.log").read_text() + (folder / "rig.log").read_text())
            time.sleep(0.1)
        with client:
            while not client.status()["health"]["ticks"] and time.monotonic() < until:
                time.sleep(0.1)
            time.sleep(1.0)  # some samples
            yield client


def trial(client: Client, seconds: float) -> list[dict[str, Any]]:
    """The first and the last answer that is `ok` of one excitation."""
    client.start("motor")
    good: list[dict[str, Any]] = []
    end = time.monotonic() + seconds
    for estimate in client.estimates("motor", timeout=PATIENCE_S):
        if estimate["quality"] == "fault":
            raise SystemExit(f"fault: {estimate['advice']}")
        if estimate["quality"] == "ok":
            good.append(estimate)
        if time.monotonic() > end:
            break
    client.stop("motor")
    while client.get("motor")["state"] != "idle":
        time.sleep(0.1)
    for method in ("exact", "wave"):
        client.set("motor", method=method)
    return [good[0], good[-1]] if good else []


def line(title: str, rig: Rig, answers: list[dict[str, Any]], tick: float) -> None:
    """Coverage, errors and widths of so many answers."""
    text = f"{title} {len(answers):4d}"
    for name in ("omega_n", "zeta"):
        true = getattr(rig, name)
        errors = np.array([each[name] / true - 1.0 for each in answers])
        sds = np.array([each[f"{name}_sd"] / true for each in answers])
        hits = int(np.sum(np.abs(errors) < INTERVAL * sds))
        low, high = (100.0 * x for x in wilson(hits, len(answers)))
        error, stated = (100.0 * np.sqrt(np.mean(x**2)) for x in (errors, sds))
        text += f"   {100 * hits / len(answers):5.1f} ({low:4.1f}-{high:5.1f}) {error:6.3f} {stated:6.3f}"
    delays = np.array([each["delay_s"] for each in answers]) / tick
    print(
        f"{text}   {delays.mean():6.2f} +- {np.mean([each['delay_sd_s'] for each in answers]) / tick:.2f}",
        flush=True,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("kind", choices=("serial", "can"))
    parser.add_argument("--rate", type=float, default=DESIGN_HZ, help="of the loop and of the sensor [Hz]")
    parser.add_argument("--trials", type=int, default=10)
    parser.add_argument(
        "--seconds", type=float, default=3.0, help="of an excitation at 2 kHz; longer where slower"
    )
    parser.add_argument("--noise", type=float, default=0.01)
    asked = parser.parse_args()
    slower = DESIGN_HZ / asked.rate / (2.0 if asked.rate < 1000.0 else 1.0)
    print(
        "zeta omega_n latency  answer   N   omega_n covers % (Wilson), error RMS %, sd %; likewise zeta; "
        "delay in ticks"
    )
    for (zeta, omega_n), latency in product(PLANTS, LATENCIES):
        rig = Rig(zeta, omega_n / slower, latency, asked.noise)
        with tempfile.TemporaryDirectory() as place:
            told = rig_file(asked.kind, rig, asked.rate, Path(place))
            with running(told, Path(place)) as client:
                heard = [trial(client, asked.seconds * slower) for _ in range(asked.trials)]
        for index, name in enumerate(("first", "last")):
            answers = [each[index] for each in heard if each]
            line(f"{zeta:4.2f} {rig.omega_n:7.1f} {latency:7.1f} {name:>7}", rig, answers, 1.0 / asked.rate)


if __name__ == "__main__":
    main()
