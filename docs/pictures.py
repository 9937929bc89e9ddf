"""The README's two pictures: the live table of a daemon, and the report of a diagnosis.

    python docs/pictures.py [REPORT.html]     # a report that is there already is not made anew

Needs Debian's chromium for the second.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from rich.console import Console

import seod
from seod.client.waiting import start_and_wait
from seod.terminal.live_view import Board
from seod.testing.daemon import Daemon, own_rig

HERE = Path(__file__).parent / "img"


def live_table(folder: Path) -> None:
    """`seod watch` as SVG."""
    rig = own_rig(seod.RigFile.shipped(), folder)
    with Daemon(rig, folder / "log") as daemon, daemon.client() as client:
        start_and_wait(client, None, 30.0)
        time.sleep(3.0)  # two messages about the loop's health: its rate is known
        status = client.status()
        status["rig"] = "virtual-motor"
        console = Console(record=True, width=86, file=(folder / "out").open("w"))
        console.print(Board(status, time.monotonic()).render(time.monotonic()))
        console.file.close()
        picture = console.export_svg(title="seod watch")
        (HERE / "watch.svg").write_text(re.sub(r"@font-face \{.*?\}", "", picture, flags=re.DOTALL))


def report(page: Path) -> None:
    """The top of the page as PNG."""
    size = "--window-size=1020,1460"
    target = f"--screenshot={HERE / 'report.png'}"
    command = ["chromium", "--headless", "--no-sandbox", "--hide-scrollbars", size, target, page.as_uri()]
    subprocess.run(command, check=True, capture_output=True)


def main() -> None:
    """Make both."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        live_table(folder)
        page = Path(sys.argv[1]).resolve() if len(sys.argv) > 1 else folder / "found" / "report.html"
        if not page.exists():
            made = seod.simulate(seod.RigFile.shipped(), effect={"coulomb_friction.level": 500}, seed=3)
            seod.diagnose(made).save(page.parent)
        report(page)


if __name__ == "__main__":
    main()
