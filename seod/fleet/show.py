"""A fleet in a terminal: a live table, or lines where the output is no terminal."""

from __future__ import annotations

import asyncio
import json
import sys
import time
from typing import TYPE_CHECKING, Any, Final

from rich.live import Live
from rich.table import Table
from rich.text import Text

from seod.fleet.board import Board
from seod.fleet.day_files import DayFiles
from seod.fleet.listener import Listener
from seod.terminal.console import console
from seod.terminal.text import number, with_sd

if TYPE_CHECKING:
    from pathlib import Path

    from seod.fleet.board import Heard
    from seod.fleet.broker import Broker

REDRAW_S: Final = 0.5
BARS: Final = "▁▂▃▄▅▆▇█"
BAR_POINTS: Final = 16
STYLES: Final = {"live": "green", "stale": "yellow", "dead": "bold red", "ended": "dim", "fault": "bold red"}


def sparks(values: list[float]) -> str:
    """A course as a line of bars, from its lowest to its highest value; "" without values."""
    step = max(1, -(-len(values) // BAR_POINTS))
    shown = values[::step]
    low, high = (min(shown), max(shown)) if shown else (0.0, 0.0)
    span = (high - low) or 1.0
    return "".join(BARS[min(len(BARS) - 1, int((value - low) / span * len(BARS)))] for value in shown)


def table(board: Board, now: float) -> Table:
    """All rigs, a row for each axis."""
    counts = board.counts
    told = (
        f"{len(board.rigs)} rigs; {counts.taken} messages, {counts.twice} came twice, {counts.lost} missing"
    )
    shown = Table(caption=told, caption_justify="left")
    for name in ("rig", "axis", "state", "zeta", "omega_n [rad/s]", "zeta since", "model", "heard [s]"):
        shown.add_column(name)
    for row in board.rows(now):
        shown.add_row(*_cells(row))
    return shown


def _cells(row: dict[str, Any]) -> list[Text]:
    state = str(row["state"] or "-") if row["standing"] == "live" else str(row["standing"])
    left = row["left_model"]
    model = Text("-") if left is None else Text("left", "bold red") if left else Text("fits", "green")
    zetas = [zeta for _, zeta, _ in row["trend"] if zeta is not None]
    silent = row["silent_s"]
    return [
        Text(row["rig"]),
        Text(row["axis"]),
        Text(state, style=STYLES.get(state, "")),
        Text(with_sd(row["zeta"], row["zeta_sd"])),
        Text(with_sd(row["omega_n"], row["omega_n_sd"])),
        Text(sparks(zetas)),
        model,
        Text("-" if silent is None else number(round(silent, 1))),
    ]


def line(heard: Heard) -> str:
    """One message, for people."""
    body, name = heard.body, heard.rig.name
    if heard.suffix.startswith("estimate/"):
        zeta, omega_n = (
            with_sd(body.get("zeta"), body.get("zeta_sd")),
            with_sd(body.get("omega_n"), body.get("omega_n_sd")),
        )
        return f"{name} {body.get('axis')}: zeta {zeta}, omega_n {omega_n} rad/s, {body.get('quality')}"
    if heard.suffix == "event":
        why = body.get("why") or body.get("state") or ""
        return f"{name} {body.get('axis') or 'rig'}: {body.get('event')} {why}".rstrip()
    return f"{name}: {heard.suffix} {body.get('state') or ''}".rstrip()


def as_json(heard: Heard) -> str:
    """One message as a line of JSON."""
    return json.dumps({"topic": heard.suffix, **heard.body, "rig": heard.rig.name})


async def watch(
    broker: Broker,
    identity: str,
    archive: Path | None,
    name: str,
    duration: float | None,
    lines_of_json: bool,
) -> None:
    """Listen until the time is up.

    Args:
        broker: Where it is.
        identity: Client identifier.
        archive: Folder to append to; None for none.
        name: Of the archive; rigs that name it keep what it has not confirmed.
        duration: How long [s]; None: until it is interrupted.
        lines_of_json: Each message as a line of JSON.

    Raises:
        OSError: The archive cannot be written.
    """
    files = None if archive is None else DayFiles(archive)
    board = Board(None if files is None else name)
    if files is not None:
        for rig, key in files.last.items():
            board.known(rig, key)
    as_table = sys.stdout.isatty() and not lines_of_json

    def show(heard: Heard) -> None:
        if not as_table:
            print(as_json(heard) if lines_of_json else line(heard), flush=True)  # noqa: T201 - what was asked for

    def say(sentence: str) -> None:
        print(f"seod: {sentence}", file=sys.stderr, flush=True)  # noqa: T201 - beside the table

    listener = Listener(broker, identity, board, files, show, say)
    try:
        async with asyncio.timeout(duration):
            drawing = asyncio.create_task(_draw(board)) if as_table else None
            try:
                await listener.run()
            finally:
                if drawing is not None:
                    drawing.cancel()
                    await asyncio.gather(drawing, return_exceptions=True)
    except TimeoutError:
        pass  # the time is up
    finally:
        if files is not None:
            files.close()


async def _draw(board: Board) -> None:
    with Live(table(board, time.monotonic()), console=console(sys.stdout), auto_refresh=False) as live:
        while True:
            await asyncio.sleep(REDRAW_S)
            live.update(table(board, time.monotonic()), refresh=True)
