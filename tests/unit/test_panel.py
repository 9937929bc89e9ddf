"""The panel without a browser: rows kept and cut, trends, who commands, who may come in; its docs."""

from __future__ import annotations

import re
import socket
import struct
import tracemalloc
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from seod.config.server import ServerConfig
from seod.files.shipped import configs_dir
from seod.panel.commander import Commander
from seod.panel.files import replace_text, style_hashes, with_secrets
from seod.panel.history import FIELDS, AxisHistory
from seod.panel.metrics import RigCollector, buckets
from seod.panel.process import panel_port
from seod.panel.sessions import LIFE_S, WRONG, Session, Sessions, is_ours, is_same_origin
from seod.panel.trends import KEYS, OLDER, RECENT, Trend
from seod.panel.view import HistoryParams, View, ViewParams
from seod.panel.wire import ANSWER, HEAD, LIVE, SWEEP
from seod.processes.hand_in import hand_in, receive_client
from seod.processes.ring import HISTOGRAM_BINS
from seod.protocol.jsonrpc import RpcError
from seod.record.layout import row_dtype
from seod.scpi.device import Device

if TYPE_CHECKING:
    from collections.abc import Callable

DOCS = Path(__file__).parents[2] / "docs"
RATE_HZ = 1000.0


def block(t: np.ndarray[Any, Any], **fields: Any) -> np.ndarray[Any, Any]:
    rows = np.zeros(len(t), row_dtype(1))["axes"][:, 0]
    for name in FIELDS:
        rows[name] = fields.get(name, np.nan)
    rows["t"] = t
    rows["state"] = 2
    return rows


def filled(seconds: float, rows: int, at_once: int = 37) -> AxisHistory:
    """y is the number of the row, u a square wave of 10 Hz, e_a 1."""
    history = AxisHistory(rows)
    t = (np.arange(round(seconds * RATE_HZ)) + 0.5) / RATE_HZ
    u = np.where(np.floor(t * 20.0 + 1e-9) % 2 == 0, 1.0, -1.0)
    whole = block(t, y=np.arange(len(t)), u=u, signal=-u, e_a=1.0)
    for start in range(0, len(t), at_once):
        part = slice(start, start + at_once)
        history.add(t[part], whole[part], np.ones(len(t[part]), bool))
    return history


def test_history_keeps_the_newest_rows_in_one_piece() -> None:
    history = filled(10.0, rows=500)
    assert len(history.time) == 500
    assert history.time[-1] == history.newest_t == pytest.approx(9.9995)
    assert list(history.field("y")[[0, -1]]) == [9500.0, 9999.0]
    assert history.newest("y") == 9999.0
    assert history.newest("ps") is None
    assert history.state == 2


def test_history_begins_anew_when_time_jumps_back() -> None:
    history = filled(1.0, rows=500)
    t = np.arange(10) / RATE_HZ
    history.add(t, block(t, y=7.0), np.ones(10, bool))
    assert list(history.field("y")) == [7.0] * 10


def test_intervals_are_lowest_and_highest_on_an_absolute_grid() -> None:
    history = filled(2.0, rows=5000)
    table = history.intervals(100, 110, 0.01, ["y", "u"])
    assert table.shape == (4, 10)
    assert list(table[0]) == [1000.0 + 10 * k for k in range(10)]
    assert list(table[1]) == [1009.0 + 10 * k for k in range(10)]
    assert set(table[2]) == set(table[3]) == {1.0, -1.0}
    late = history.intervals(195, 205, 0.01, ["y"])
    assert np.isnan(late[0, 5:]).all()
    assert late[1, 4] == 1999.0
    assert np.isnan(AxisHistory(10).intervals(0, 3, 0.01)).all()


def test_an_interval_without_rows_does_not_take_its_neighbours() -> None:
    history = AxisHistory(100)
    t = np.array([0.0, 0.001, 0.052])
    history.add(t, block(t, u=[5.0, 6.0, 7.0]), np.ones(3, bool))
    table = history.intervals(0, 6, 0.01, ["u"])
    assert table[0, 0] == 5.0
    assert table[1, 0] == 6.0
    assert np.isnan(table[:, 1:5]).all()
    assert table[0, 5] == 7.0
    held = history.intervals(0, 6, 0.01, ["u"], holds=0.02)
    assert list(held[0, 1:3]) == [6.0, 6.0]
    assert np.isnan(held[:, 3:5]).all()


def view_of(history: AxisHistory) -> View:
    return View({"motor": history}, 1.0 / RATE_HZ)


def unpacked(data: bytes) -> list[tuple[int, int, float, float, np.ndarray[Any, Any]]]:
    found, at = [], 0
    while at < len(data):
        kind, _, rows, columns, number, _, start, step = HEAD.unpack_from(data, at)
        at += HEAD.size
        table = np.frombuffer(data, "<f4", rows * columns, at).reshape(rows, columns)
        at += 4 * rows * columns
        found.append((kind, number, start, step, table))
    return found


def test_live_frames_join_without_a_gap_and_hold_only_what_is_new() -> None:
    history = filled(1.0, rows=5000)
    view = view_of(history)
    number = view.show(ViewParams(axes=["motor"], span=0.5, columns=100))
    ((kind, told, first, step, table),) = unpacked(view.message())
    assert (kind, told, step) == (LIVE, number, 0.005)
    assert (first, table.shape) == (99.0, (6, 100))
    assert view.message() == b""
    t = 1.0 + (np.arange(25) + 0.5) / RATE_HZ
    history.add(t, block(t, y=1000.0 + np.arange(25), u=0.0, signal=0.0), np.ones(25, bool))
    ((_, _, second, _, more),) = unpacked(view.message())
    assert second == first + table.shape[1]
    assert list(more[2]) == [995.0, 1000.0, 1005.0, 1010.0, 1015.0][: more.shape[1]]


def test_sweeps_begin_at_the_relays_switches_and_one_shot_ends() -> None:
    history = filled(1.0, rows=5000)
    view = view_of(history)
    view.show(ViewParams(axes=["motor"], span=0.1, columns=100, mode="single"))
    assert view.message() == b""  # what was before it was armed does not count
    t = 1.0 + (np.arange(300) + 0.5) / RATE_HZ
    u = np.where(np.floor(t * 20.0 + 1e-9) % 2 == 0, 1.0, -1.0)
    history.add(t, block(t, y=0.0, u=u, signal=-u, e_a=1.0), np.ones(300, bool))
    ((kind, _, start, step, table),) = unpacked(view.message())
    assert kind == SWEEP
    switch = start + 0.2 * 0.1
    assert switch == pytest.approx(round(switch * 10.0) / 10.0, abs=2 * step)
    assert table[0, 10] == -1.0
    assert table[0, 30] == 1.0
    assert view.message() == b""


def test_the_past_is_answered_at_the_loops_rate() -> None:
    view = view_of(filled(2.0, rows=5000))
    asked = HistoryParams(axis="motor", start=1.0, end=1.1, columns=4096, number=9)
    ((kind, number, start, step, table),) = unpacked(view.answer(asked))
    assert (kind, number, start, step) == (ANSWER, 9, 1.0, 0.001)
    assert list(table[2])[:100] == list(np.arange(1000.0, 1100.0))


def test_trends_are_thinned_and_keep_the_newest() -> None:
    trend = Trend()
    count = RECENT + 3 * OLDER
    for k in range(count):
        trend.add({"t": float(k), "zeta": 0.2, "quality": "ok"})
    trend.add({"t": 5.0, "zeta": 9.0})  # told again, as stale
    columns = trend.columns()
    assert set(columns) == set(KEYS)
    assert len(columns["t"]) <= RECENT + OLDER
    assert columns["t"] == sorted(columns["t"])
    assert columns["t"][-RECENT:] == [float(k) for k in range(count - RECENT, count)]
    assert columns["t"][0] < OLDER
    newest = trend.columns(since=count - 3.0)
    assert newest["t"] == [count - 2.0, count - 1.0]
    assert (newest["zeta"], newest["ps"], newest["quality"]) == ([0.2, 0.2], [None, None], ["ok", "ok"])


def test_a_trend_and_a_history_have_all_their_memory_from_the_begin() -> None:
    def grown(take: Callable[[int], None], count: int) -> int:
        tracemalloc.start()
        before = tracemalloc.get_traced_memory()[0]
        for k in range(count):
            take(k)
        after = tracemalloc.get_traced_memory()[0]
        tracemalloc.stop()
        return after - before

    trend, history = Trend(), AxisHistory(500)
    one = np.ones(1)
    assert grown(lambda k: trend.add({"t": float(k), "zeta": 0.2, "quality": "ok"}), 8000) < 10_000
    assert grown(lambda k: history.add(one * k, block(one * k), one > 0), 2000) < 10_000


def test_one_commands_and_others_take_over_openly() -> None:
    told: list[str] = []
    commander = Commander()
    commander.told = told.append
    a, b = SimpleNamespace(name="a", session=1), SimpleNamespace(name="b", session=2)
    commander.check(a, "set")
    commander.check(a, "start")
    with pytest.raises(RpcError, match="a commands at present"):
        commander.check(b, "start")
    for free in ("stop", "estop", "get"):
        commander.check(b, free)
    commander.take(b)
    with pytest.raises(RpcError, match="b commands"):
        commander.check(a, "set")
    commander.release(a)
    assert commander.now is b
    commander.release(b)
    commander.check(a, "set")
    assert told == [
        "a commands now",
        "b commands now, taken over from a",
        "b commands no longer",
        "a commands now",
    ]


@pytest.mark.parametrize(
    ("host", "listens_on", "ours"),
    [
        ("127.0.0.1:7680", "127.0.0.1", True),
        ("localhost:7680", "127.0.0.1", True),
        ("[::1]:7680", "::1", True),
        ("evil.example:7680", "127.0.0.1", False),
        ("192.168.1.5:7680", "127.0.0.1", False),
        ("", "127.0.0.1", False),
        ("rig.lab:7680", "0.0.0.0", True),
        ("192.168.1.5:7680", "0.0.0.0", True),
    ],
)
def test_names_that_may_be_ours(host: str, listens_on: str, ours: bool) -> None:
    assert is_ours(host, listens_on) is ours


def test_sessions_end_and_guessers_wait(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [1000.0]
    monkeypatch.setattr("seod.panel.sessions.time", SimpleNamespace(monotonic=lambda: now[0]))
    sessions = Sessions()
    session = Session(None, True, True, born=now[0])
    key = sessions.begin(session)
    assert sessions.find({sessions.cookie: key}) is session
    assert sessions.find({sessions.cookie: "other"}) is None
    assert session.owns(session.csrf)
    assert not session.owns("")
    now[0] += LIFE_S + 1.0
    assert sessions.find({sessions.cookie: key}) is None
    for _ in range(WRONG):
        assert not sessions.must_wait("host")
        sessions.was_wrong("host")
    assert sessions.must_wait("host")
    assert not sessions.must_wait("another")
    now[0] += 100.0
    assert not sessions.must_wait("host")
    assert is_same_origin({"origin": "http://a:1", "host": "A:1"}, "http")
    assert not is_same_origin({"host": "a:1"}, "http")
    assert not is_same_origin({"origin": "https://a:1", "host": "a:1"}, "http")


def test_a_saved_rig_file_keeps_its_tokens_and_rights(tmp_path: Path) -> None:
    token = "a-token-of-sixteen"
    now = f"server:\n  command_token: {token}\n  port: 7600\n"
    shown = now.replace(token, "x" * len(token))
    assert with_secrets(shown.replace("7600", "7700"), now) == now.replace("7600", "7700")
    other = shown.replace("x" * len(token), "another-token-here")
    assert with_secrets(other, now) == other
    path = tmp_path / "rig.yaml"
    path.write_text(now)
    path.chmod(0o640)
    replace_text(path, "new")
    assert path.read_text() == "new"
    assert path.stat().st_mode & 0o777 == 0o640
    assert list(tmp_path.iterdir()) == [path]


def test_styles_of_a_report_are_named_by_their_hashes() -> None:
    hashes = style_hashes('<style>a{}</style><p style="width:1px"></p><p style="width:1px"></p>')
    assert len(hashes) == 2
    assert all(re.fullmatch(r"'sha256-[A-Za-z0-9+/=]{44}'", each) for each in hashes)


def test_a_client_is_handed_in_with_where_it_comes_from() -> None:
    way, other = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with way, other, hand_in(way, ("10.0.0.1", 5)) as ours:
        taken = receive_client(other)
        assert taken is not None
        end, peer = taken
        with end:
            assert peer == ("10.0.0.1", 5)
            ours.send(b"hello")
            assert end.recv(10) == b"hello"
        assert receive_client(other) is None


@pytest.mark.parametrize(
    ("server", "port"),
    [({}, 7680), ({"port": 0}, 0), ({"port": 7610}, 7690), ({"port": 65500}, 0), ({"panel_port": 80}, 80)],
)
def test_the_panels_port_follows_the_gateways(server: dict[str, Any], port: int) -> None:
    assert panel_port(ServerConfig(**server)) == port


def test_histograms_are_cumulated_up_to_infinity() -> None:
    found = buckets([1] * HISTOGRAM_BINS)
    assert [count for _, count in found] == list(range(1, HISTOGRAM_BINS + 1))
    assert found[0][0] == "1e-06"
    assert found[-1][0] == "+Inf"


def metric_names() -> set[str]:
    estimate = dict.fromkeys([*KEYS, "zeta", "t"], 0.5) | {"quality": "ok"}
    shared = SimpleNamespace(words=[0] * 32, lateness=np.zeros(64, int), execution=np.zeros(64, int))
    house = SimpleNamespace(
        estimates={"motor": estimate},
        model_errors={"motor": {"nrmse": 0.1, "left": False}},
        faults={"motor": {"code": "estop"}},
        health={},
        connected=True,
    )
    record = SimpleNamespace(folder=None)
    config = SimpleNamespace(rig="a", simulation=None, record=record)
    panel: Any = SimpleNamespace(
        config=config,
        shared=shared,
        house=house,
        histories={"motor": AxisHistory(1)},
        pages=(),
        rows_age_s=0.0,
    )
    panel.rig_file = configs_dir() / "virtual.yaml"
    return {family.name for family in RigCollector(panel).collect()}


def test_the_page_of_metrics_names_each_of_them() -> None:
    page = (DOCS / "metrics.md").read_text()
    table = page.split("| metric |", 1)[1].split("| alert |", 1)[0]
    told = set(re.findall(r"`(seod_[a-z_]+)`", table))
    labels = {"seod_state", "seod_quality"}
    names = {"seod_info" if name == "seod" else name for name in metric_names()}
    assert told == names | labels
    alerts = re.findall(r"- alert: (\w+)", (configs_dir() / "monitoring" / "alerts.yml").read_text())
    assert set(alerts) == set(re.findall(r"`([A-Z]\w+)`", page.split("| alert |", 1)[1]))


def test_the_page_of_scpi_names_each_command() -> None:
    page = (DOCS / "scpi.md").read_text().split("| command |", 1)[1]
    told = set()
    for line in page.splitlines():
        if line.startswith("| `"):
            told |= set(re.findall(r"`([^`]+)`", line.split("|")[1]))
    rig: Any = SimpleNamespace(axes={}, may_read=True, stale=False)
    assert told == set(Device(rig).patterns)


def test_heads_of_messages_have_the_length_that_the_page_reads() -> None:
    assert HEAD.size == 32
    script = (Path(__file__).parents[2] / "seod" / "panel" / "page" / "wire.js").read_text()
    assert "const HEAD = 32;" in script
    assert struct.calcsize("<f") == 4
