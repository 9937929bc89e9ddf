"""A recorded run played again: the same rows, the same events, the same estimates, bit for bit."""

from __future__ import annotations

import json
import math
import os
import socket
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from loop_bench import PERIOD, Bench
from record_rows import Content, about, rows, write_recording

from drivers.base import DriverError
from drivers.replay import ReplayDriver, ReplayOptions
from seod.config.model import RigConfig
from seod.estimate import make_estimator
from seod.loop.replay import Replay
from seod.observe.estimation import Axis
from seod.observe.feeds import Feeds
from seod.observe.process import clock_of
from seod.observe.recording import Recording
from seod.observe.rig import Rig
from seod.processes.link import Link
from seod.processes.ring import Shared, Word
from seod.record.layout import ESTIMATES, EVENTS
from seod.record.mcap_file import About
from seod.record.read import RecordingError, beginning, items, parts
from seod.record.recorder import McapRecorder
from seod.record.series import Note, Rotation, Series

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from seod.record.opening import Recorder


class Notes:
    """A recorder that keeps what it is given."""

    waiting = 0
    error = ""

    def __init__(self) -> None:
        self.notes: list[Note] = []
        self.blocks: list[np.ndarray] = []

    def add(self, rows: np.ndarray) -> None:
        self.blocks.append(rows)

    def note(self, topic: str, t: float, message: dict[str, Any]) -> None:
        self.notes.append(Note(topic, t, message))

    def report(self) -> dict[str, Any]:
        return {}

    def close(self) -> None:
        pass

    def of(self, topic: str) -> list[dict[str, Any]]:
        return [dict(note.message) for note in self.notes if note.topic == topic]


def nobody() -> Feeds:
    """A gateway without clients."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    theirs.close()
    with ours:
        return Feeds(Link(ours))


def gateway(config: RigConfig, shared: Shared, recorder: Recorder) -> Rig:
    return Rig(
        config,
        shared,
        nobody(),
        make_estimator,
        clock_of(config, shared),
        lambda *_: None,
        Recording(recorder),
    )


def estimates(messages: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return [{key: value for key, value in message.items() if key != "age_s"} for message in messages]


class LiveRun:
    """A run of the virtual rig with its gateway and recorder, polled at odd times."""

    def __init__(self, path: Path) -> None:
        self.bench = Bench({"axes": {"motor": {"relay": {"hysteresis": 0.004}}}})
        config = self.bench.config
        about = About(config.rig, list(config.axes), "", config.model_dump_json(), 1e9, 10**18)
        self.rig = gateway(config, self.bench.shared, McapRecorder(path, about, Rotation()))
        self.bench.shared.events.put(
            {"event": "started", "t": 1000.0, "generation": 1, "realtime": {"ok": True, "why": []}}
        )

    def run(self, seconds: float) -> None:
        for ticks in (7, 1, 13, 40, 3, 111):
            self.bench.run(ticks * PERIOD)
            self.rig.poll()
        self.bench.run(seconds)
        self.rig.poll()

    def command(self, op: str, **values: float) -> None:
        self.bench.shared.commands.put({"id": 1, "op": op, "axis": 0, "values": values})

    def close(self) -> None:
        self.rig.close()
        self.bench.close()


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("live") / "live.mcap"
    live = LiveRun(path)
    axis = live.rig.axes["motor"]
    live.command("start")
    for _ in range(5):
        live.run(0.15)
    values = {"e_a": 0.4, "hysteresis": 0.006}
    live.command("set", **values)
    live.run(0.15)
    live.rig.change(axis, values, {})  # as a client's `set` does once the loop has answered
    for _ in range(4):
        live.run(0.15)
    live.rig.change(axis, {"method": "peaks"}, {"method": "peaks"})
    for _ in range(3):
        live.run(0.15)
    live.command("stop")
    live.run(0.5)
    live.close()
    return path


class Played:
    """A replay of a recording, its gateway polled whenever the replay sleeps."""

    def __init__(self, path: Path, realtime: bool = False, rows: int = 4096) -> None:
        begun = beginning(path)
        driver = {"kind": "replay", "file": str(path), "realtime": realtime}
        self.config = RigConfig.model_validate_json(json.dumps(begun.rig | {"driver": driver}))
        self.driver = ReplayDriver(ReplayOptions.model_validate(driver), lambda: 0.0)
        channels = [sensor["channel"] for sensor in begun.rig["sensors"].values()]
        self.driver.open(channels, [])
        self.shared = Shared(len(self.config.axes), rows)
        self.notes = Notes()
        self.rig = gateway(self.config, self.shared, self.notes)
        self.now = 0.0
        self.slept: list[float] = []
        self.replay = Replay(self.config, self.driver, self.shared, 1, lambda: self.now, self.sleep)

    def sleep(self, seconds: float) -> None:
        self.now += seconds
        self.slept.append(seconds)
        self.rig.poll()
        if any(event.get("code") == "replay_ended" for event in self.notes.of(EVENTS)):
            self.replay.ending = True

    def run(self) -> None:
        self.replay.run()
        self.rig.poll()

    def close(self) -> None:
        self.rig.close()
        self.driver.close()
        self.shared.close()


@pytest.fixture
def played(recording: Path) -> Iterator[Played]:
    it = Played(recording)
    yield it
    it.close()


@pytest.mark.slow
def test_estimates_are_those_of_the_live_run_bit_for_bit(recording: Path, played: Played) -> None:
    live = estimates(Content(recording).json(ESTIMATES + "motor"))
    played.run()
    again = estimates(played.notes.of(ESTIMATES + "motor"))
    assert len(live) > 100
    assert {estimate["method"] for estimate in live} == {"wave", "peaks"}
    assert sum(estimate["quality"] == "ok" for estimate in live) > 50
    assert again == live


@pytest.mark.slow
def test_rows_are_those_of_the_live_run_bit_for_bit(recording: Path, played: Played) -> None:
    played.run()
    again = np.concatenate(played.notes.blocks)
    live = np.concatenate([item for item in items(recording, ["motor"]) if not isinstance(item, dict)])
    assert again.tobytes() == live.tobytes()
    assert set(live["axes"]["u"][:, 0]) >= {-0.5, 0.0, 0.5}


@pytest.mark.slow
def test_events_come_again_and_the_end_is_told(recording: Path, played: Played) -> None:
    played.run()
    live = [e for e in Content(recording).json(EVENTS) if e["event"] not in ("started",)]
    again = [e for e in played.notes.of(EVENTS) if e["event"] not in ("started",)]
    assert again[:-1] == live
    assert again[-1]["code"] == "replay_ended"
    assert {e["event"] for e in live} >= {"state", "changed"}


@pytest.mark.slow
def test_a_small_ring_and_real_time_change_nothing(recording: Path) -> None:
    live = estimates(Content(recording).json(ESTIMATES + "motor"))
    it = Played(recording, realtime=True, rows=64)
    it.run()
    assert estimates(it.notes.of(ESTIMATES + "motor")) == live
    times = np.concatenate(it.notes.blocks)["tick_t"]
    assert it.now == pytest.approx(times[-1] - times[0], abs=0.1)
    it.close()


@pytest.mark.slow
def test_nothing_can_be_started_and_what_ends_a_movement_is_done(played: Played) -> None:
    ops = {"start": False, "set": False, "drive": False, "stop": True, "reset": True, "keepalive": True}
    for number, op in enumerate(ops):
        played.shared.commands.put({"id": number, "op": op, "axis": None, "values": {}})
    played.shared.words[Word.ESTOPS] += 1
    reader = Shared(1, played.shared.rows, os.dup(played.shared.fd))
    played.run()
    replies = [event for event in reader.events.take() if event["event"] == "reply"]
    reader.close()
    assert [reply["ok"] for reply in replies] == list(ops.values())
    assert played.shared.words[Word.ESTOPS_OBEYED] == 1


def test_other_axes_than_the_recorded_ones_are_refused(played: Played) -> None:
    config = played.config.model_copy(update={"axes": {"other": played.config.axes["motor"]}})
    with pytest.raises(DriverError, match="the rig file has other, the recording motor"):
        Replay(config, played.driver, played.shared, 1)


def test_lost_rows_interrupt_the_estimators_as_they_did(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.mcap"
    warning = {"event": "warning", "t": 100.0, "axis": None, "code": "rows_lost", "why": "5 rows"}
    live = Bench()
    write_recording(path, rows(10), [Note(EVENTS, 100.0, warning)], live.config.model_dump(mode="json"))
    live.close()
    it = Played(path)
    interrupted = []
    monkeypatch.setattr(Axis, "interrupted", lambda self: interrupted.append(self.name))
    it.run()
    assert interrupted == ["motor"]
    it.close()


def test_a_truncated_recording_plays_to_its_last_whole_chunk(tmp_path: Path) -> None:
    path, torn, ends = tmp_path / "a.mcap", tmp_path / "torn.mcap", []
    series = Series(path, about(), Rotation(), dict, 0.0)
    for number in range(5):
        series.put([rows(20, first=20 * number)], 0.0)
        ends.append(series.bytes)
    series.finish(0.0)
    data = path.read_bytes()
    for cut in range(ends[0] - 300, len(data), 97):
        torn.write_bytes(data[:cut])
        found = [len(item) for item in items(torn, ["motor"])]
        whole = sum(end <= cut + 500 for end in ends)  # the index behind a chunk is not needed
        assert sum(end <= cut for end in ends) <= len(found) <= whole
        assert set(found) <= {20}


def test_a_damaged_chunk_is_left_out(tmp_path: Path) -> None:
    write_recording(tmp_path / "a.mcap", rows(1000))
    data = bytearray((tmp_path / "a.mcap").read_bytes())
    data[len(data) // 3] ^= 0xFF
    (tmp_path / "a.mcap").write_bytes(data)
    assert [item["code"] for item in items(tmp_path / "a.mcap", ["motor"])] == ["rows_lost"]


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("small") / "a.mcap"
    write_recording(path, rows(30), [Note(EVENTS, 100.0, {"event": "state", "t": 100.0})])
    return path


@settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_whatever_a_disk_made_of_it_a_recording_is_read_or_refused(small: Path, data: st.DataObject) -> None:
    content = bytearray(small.read_bytes())
    places = st.tuples(st.integers(0, len(content) - 1), st.integers(0, 255))
    for at, value in data.draw(st.lists(places, max_size=3)):
        content[at] = value
    torn = small.with_name("torn.mcap")
    torn.write_bytes(content[: data.draw(st.integers(0, len(content)))])
    try:
        found = list(items(torn, ["motor"]))
    except RecordingError:
        return
    assert sum(len(item) for item in found if not isinstance(item, dict)) in (0, 30)


def test_the_parts_of_a_recording_follow_each_other(tmp_path: Path) -> None:
    for name, first in (("a.mcap", 0), ("a.0002.mcap", 10), ("a.0003.mcap", 20)):
        write_recording(tmp_path / name, rows(10, first=first))
    (tmp_path / "a.0004.mcap").write_bytes(b"")  # the power went off just then
    assert len(parts(tmp_path / "a.mcap")) == 3
    found = np.concatenate(list(items(tmp_path / "a.mcap", ["motor"])))
    assert found["tick"].tolist() == list(range(30))


def test_other_files_are_refused_by_name(tmp_path: Path) -> None:
    (tmp_path / "a.mcap").write_bytes(b"no such thing")
    with pytest.raises(RecordingError, match=r"a\.mcap: is no recording of seod"):
        beginning(tmp_path / "a.mcap")
    options = ReplayOptions(kind="replay", file=str(tmp_path / "a.mcap"))
    with pytest.raises(DriverError, match=r"driver\.file: .*a\.mcap"):
        ReplayDriver.channels(options)


def test_the_driver_keeps_the_recorded_pace(tmp_path: Path) -> None:
    write_recording(tmp_path / "a.mcap", table := rows(100))
    now = [50.0]
    driver = ReplayDriver(ReplayOptions(kind="replay", file=str(tmp_path / "a.mcap")), lambda: now[0])
    driver.open(["angle"], ["valve"])
    driver.start()
    (sample,) = driver.read(50.01001)
    assert sample.value == table["axes"]["y"][20, 0]
    assert sample.t == pytest.approx(50.01 - 1e-4 / 3.0)
    (last,) = driver.read(math.inf)
    assert last.value == table["axes"]["y"][-1, 0]
    assert driver.read(math.inf) == [last], "it stays where it ended"
    assert driver.counters[0] == 100
    driver.close()
