"""What people see of a rig in a terminal: a live table, or plain lines where the output is no terminal."""

from __future__ import annotations

import json
import sys
import time
from typing import TYPE_CHECKING, Any, TextIO

from rich.console import Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from seod.terminal.console import console
from seod.terminal.text import estimate, event, health, number, with_sd

if TYPE_CHECKING:
    from rich.console import Console

    from seod.client import Client

    Message = dict[str, Any]

REDRAW_S = 0.1
EVENTS_SHOWN = 4
STATE_STYLE = {"exciting": "green", "armed": "cyan", "holding": "cyan", "fault": "bold red"}
QUALITY_STYLE = {"ok": "green", "settling": "yellow", "fault": "bold red"}


class Board:
    """What is known of the rig, from its status and the notifications since.

    Args:
        status: The answer to `status`.
        now: When it came [s], on the clock that `render` is given.
    """

    def __init__(self, status: Message, now: float) -> None:
        self.info = status
        self.health: Message = status["health"]
        self.axes: dict[str, Message] = status["axes"]
        self.events: list[str] = []
        self._heard = dict.fromkeys(self.axes, now)

    def take(self, message: Message, now: float) -> None:
        """Take one notification that came at `now` [s]."""
        topic, params = message["method"], message["params"]
        if topic == "health":
            self.health = params
        elif topic == "estimate":
            self.axes[params["axis"]]["estimate"] = params
            self._heard[params["axis"]] = now
        elif topic == "event":
            self._take_event(params)

    def _take_event(self, params: Message) -> None:
        self.events = [*self.events, event(params)][-EVENTS_SHOWN:]
        named = self.axes.get(params.get("axis") or "")
        if params["event"] == "fault":
            for name in params.get("latched", self.axes):
                self.axes[name].update(state="fault", fault=params)
        elif params["event"] == "state" and named is not None:
            named["state"] = params["state"]
            if params["state"] != "fault" and named["fault"] is not None:
                named["fault"] = named["estimate"] = None
        elif params["event"] == "changed" and named is not None:
            named["settings"].update(params["values"])

    def render(self, now: float) -> Group:
        """Everything, as of `now` [s]."""
        title = Text(f"{self.info['rig']}, driver {self.info['driver']}", style="bold")
        lines = [Text(health(self.health), style="dim")]
        faults = {axis["fault"]["why"] for axis in self.axes.values() if axis["fault"]}
        lines += [Text(f"fault: {why}", style="bold red") for why in sorted(faults)]
        lines += [Text(line) for line in self.events]
        return Group(title, self._table(now), *lines)

    def _table(self, now: float) -> Table:
        """One column for each axis: fits a narrow terminal."""
        table = Table()
        table.add_column("axis")
        columns = []
        for name in self.axes:
            table.add_column(name, min_width=18)
            columns.append(self._cells(name, now))
        for label in columns[0]:
            table.add_row(Text(label), *(cells.get(label, Text("-")) for cells in columns))
        return table

    def _cells(self, name: str, now: float) -> dict[str, Text]:
        axis = self.axes[name]
        e: Message = axis["estimate"] or {}
        quality = e.get("quality") or "-"
        units: dict[str, str] = axis.get("units") or {}
        true_units = {"K_L": units.get("K_L", ""), "omega_n": "rad/s"}
        age = None if not e else e["age_s"] + now - self._heard[name]
        cells = {
            "state": Text(axis["state"], style=STATE_STYLE.get(axis["state"], "")),
            "quality": Text(quality, style=QUALITY_STYLE.get(quality, "magenta")),
            "zeta": Text(with_sd(e.get("zeta"), e.get("zeta_sd")), style="bold"),
            "omega_n [rad/s]": Text(with_sd(e.get("omega_n"), e.get("omega_n_sd")), style="bold"),
            "frequency [rad/s]": Text(number(e.get("frequency"))),
            "amplitude": Text(f"{number(e.get('amplitude'))} {units.get('hysteresis', '')}".rstrip()),
            "e_a": Text(f"{number(axis['settings']['e_a'])} {units.get('e_a', '')}".rstrip()),
            "age [s]": Text("-" if age is None else f"{age:.1f}"),
        }
        for quantity, true in (self.info["truth"] or {}).get(name, {}).items():
            told = f"{number(true)} {true_units.get(quantity, '')}".rstrip()
            cells[f"true {quantity}"] = Text(told, style="dim")
        return cells


PIPED_HZ = 2.0
"""Lines of each axis a second where nobody asks for more and no terminal shows a table."""


def watch(
    client: Client,
    duration: float | None = None,
    count: int | None = None,
    out: TextIO | None = None,
    *,
    axis: str | None = None,
    rate_hz: float | None = None,
    as_json: bool = False,
) -> None:
    """Show live estimates until the time is up, `count` estimates have come, or the daemon ends.

    Args:
        client: A connection that nobody else uses meanwhile.
        duration: How long [s].
        count: How many estimates.
        out: Where to; the standard output if left out. A terminal gets the table, anything else lines.
        axis: Only this one.
        rate_hz: Estimates a second of each axis, at most; None: all in a table, `PIPED_HZ` as lines.
        as_json: Lines of JSON, each a notification of the protocol.

    Raises:
        EndedError: The daemon ended.
    """
    stream = out or sys.stdout
    as_table = stream.isatty() and not as_json
    axes = None if axis is None else [axis]
    client.subscribe(["estimate"], axes, rate_hz or (None if as_table else PIPED_HZ))
    client.subscribe(["event", "health"] if as_table else ["event"], axes)
    if as_table:
        status = client.status()
        status["axes"] = {name: each for name, each in status["axes"].items() if axis in (None, name)}
        _watch_table(client, Board(status, time.monotonic()), console(stream), duration, count)
    else:
        _watch_lines(client, stream, duration, count, as_json)


def _watch_table(
    client: Client, board: Board, console: Console, duration: float | None, count: int | None
) -> None:
    drawn = time.monotonic()
    with Live(board.render(drawn), console=console, auto_refresh=False) as live:
        for message in client.notifications(duration):
            now = time.monotonic()
            board.take(message, now)
            count = left(count, message)
            if now - drawn >= REDRAW_S or count == 0:
                drawn = now
                live.update(board.render(now), refresh=True)
            if count == 0:
                return


def _watch_lines(
    client: Client, stream: TextIO, duration: float | None, count: int | None, as_json: bool
) -> None:
    for message in client.notifications(duration):
        count = left(count, message)
        if as_json:
            told = {"method": message["method"], "params": message["params"]}
            print(json.dumps(told), file=stream, flush=True)
        elif message["method"] == "estimate":
            print(estimate(message["params"]), file=stream, flush=True)
        elif message["method"] == "event":
            print(event(message["params"]), file=stream, flush=True)
        if count == 0:
            return


def left(count: int | None, message: Message) -> int | None:
    """How many estimates are still to be shown."""
    return count if count is None or message["method"] != "estimate" else count - 1
