"""The browser panel killed and hung beside an excited rig, on real processes: the rows that nobody simulates.

    python bench/faults_panel.py [--runs 20]

The virtual rig is excited; each run takes the panel's process away, or stops it for a second. Meanwhile the
gateway is asked, and afterwards the panel. Prints rows as bench/faults.py does. A panel that has been started
again `RESTARTS` times stays away: then comes another daemon.
"""

from __future__ import annotations

import argparse
import os
import signal
import statistics
import sys
import tempfile
import time
import urllib.error
from pathlib import Path
from typing import TYPE_CHECKING, Any

REPO = Path(__file__).parents[1]
sys.path.insert(0, str(REPO))

from seod.supervisor.keeper import RESTARTS  # noqa: E402
from tests.panel_rig import PanelRig, panel_daemon  # noqa: E402
from tests.peers import Rpc, until  # noqa: E402

if TYPE_CHECKING:
    from collections.abc import Callable

HUNG_S = 1.0


def answers(rig: PanelRig) -> bool:
    """The panel serves its page."""
    try:
        return rig.ask("/")[0] == 200
    except (OSError, urllib.error.URLError):
        return False


def killed(rig: PanelRig) -> None:
    """Its process ends."""
    os.kill(rig.child("seod.panel"), signal.SIGKILL)


def hung(rig: PanelRig) -> None:
    """Its process stands still for a second."""
    pid = rig.child("seod.panel")
    os.kill(pid, signal.SIGSTOP)
    time.sleep(HUNG_S)
    os.kill(pid, signal.SIGCONT)


def state(rpc: Rpc) -> dict[str, Any]:
    """Of the axis."""
    told: dict[str, Any] = rpc.call("get", axis="motor")
    return told


class Row:
    """Runs of one fault."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.went_on: list[bool] = []
        self.asked: list[float] = []
        self.back: list[float] = []
        self.lost = 0

    def run(self, rig: PanelRig, rpc: Rpc, fault: Callable[[PanelRig], None]) -> None:
        """One run."""
        before = rpc.call("status")["health"]
        fault(rig)
        began = time.monotonic()
        excited = state(rpc)["state"] == "exciting"
        self.asked.append(time.monotonic() - began)
        until("the panel", lambda: answers(rig), 60)
        self.back.append(time.monotonic() - began)
        until("ticks", lambda: rpc.call("status")["health"]["ticks"] > before["ticks"])
        self.went_on.append(excited and state(rpc)["state"] == "exciting")
        self.lost += rpc.call("status")["health"]["rows_lost"] - before["rows_lost"]

    def line(self) -> str:
        """As a line of the matrix."""
        goes = "goes on" if all(self.went_on) else f"{sum(self.went_on)} of {len(self.went_on)} go on"
        times = f"panel again after {statistics.median(self.back):.1f} s, at most {max(self.back):.1f} s"
        return f"| {self.name} | may go on | {goes} | {goes} | 0 | {self.lost} | {times} |"


def main() -> int:
    """Print the rows."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=20)
    runs = parser.parse_args().runs
    rows = Row("browser panel killed"), Row(f"browser panel hung {HUNG_S:g} s")
    while len(rows[0].went_on) < runs:
        with tempfile.TemporaryDirectory() as folder, panel_daemon(Path(folder)) as rig:
            rpc = rig.rpc()
            until("the loop", lambda rpc=rpc: rpc.call("status")["health"]["ticks"])
            rpc.call("start")
            until("the excitation", lambda rpc=rpc: state(rpc)["state"] == "exciting")
            for _ in range(min(RESTARTS, runs - len(rows[0].went_on))):
                rows[0].run(rig, rpc, killed)
                rows[1].run(rig, rpc, hung)
            rpc.close()
    for row in rows:
        print(row.line())
    print(f"`get` was answered within {1e3 * max(rows[0].asked + rows[1].asked):.0f} ms")
    return int(not all(rows[0].went_on + rows[1].went_on))


if __name__ == "__main__":
    sys.exit(main())
