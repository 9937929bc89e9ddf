"""Counters and times across 2^32 and across midnight: nothing is lost, repeated, or out of order."""

from __future__ import annotations

import dataclasses
import datetime as dt
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from record_rows import Content, about, rows

from drivers import can_counters as count
from drivers.can_sequence import NEW, Sequence
from drivers.device_clock import WRAP, DeviceClock
from drivers.neutral import SocketcanNeutral
from seod.observe.health import Health
from seod.observe.rows import RowReader
from seod.processes.ring import AXIS_FIELDS, Shared, Word
from seod.record.layout import ROWS, decode
from seod.record.series import Rotation, Series

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from seod.record.mcap_file import About

BIG = 1 << 32
MIDNIGHT_S = dt.datetime(2027, 1, 1, tzinfo=dt.UTC).timestamp()
MIDNIGHT_NS = int(MIDNIGHT_S) * 1_000_000_000


@pytest.fixture
def shared() -> Iterator[Shared]:
    block = Shared(axes=1, rows=16)
    yield block
    block.close()


def put_row(block: Shared, tick: int) -> None:
    numbers = [0.0] * len(AXIS_FIELDS)
    ring = block.row_ring
    block.row_struct.pack_into(ring.data, ring.next_offset(), tick, 0.5, *numbers, 1, 2)
    ring.commit()


def test_rows_are_read_once_and_in_order_across_2_to_the_32(shared: Shared) -> None:
    first = BIG - 20
    shared.row_ring.head[0] = shared.words[Word.CONSUMED] = first
    reader, ticks = RowReader(shared), []
    for k in range(40):
        put_row(shared, first + k)
        if k % 3 == 0:
            ticks += reader.take()["tick"].tolist()
    ticks += reader.take()["tick"].tolist()
    assert ticks == list(range(first, first + 40))
    assert reader.lost == 0
    assert shared.words[Word.CONSUMED] == first + 40
    for k in range(40, 60):
        put_row(shared, first + k)
    reader.take()
    assert reader.lost == 20 - 15  # of 16 slots one may be under the pen
    reader.close()


def test_events_are_read_once_and_in_order_across_2_to_the_32(shared: Shared) -> None:
    ring = shared.events
    ring.head[0] = BIG - 3
    ring.skip_to_head()
    heard = []
    for k in range(6):
        ring.put({"n": k})
        heard += [message["n"] for message in ring.take()]
    assert heard == list(range(6))


def test_health_tells_counts_beyond_2_to_the_32(shared: Shared) -> None:
    health = Health(shared)
    shared.words[Word.TICKS] = BIG - 1000
    health.measure(10.0)
    shared.words[Word.TICKS] += 2000
    shared.words[Word.OVERRUNS] = BIG + 7
    shared.counters[0] = BIG + 1
    shared.lateness[3] = BIG
    health.measure(11.0)
    told = health.loop(11.0, ["frames_received"])
    assert (told["ticks"], told["rate_hz"], told["overruns"]) == (BIG + 1000, 2000.0, BIG + 7)
    assert told["counters"] == {"frames_received": BIG + 1}
    assert told["lateness"]["bins"][3] == BIG


@pytest.mark.parametrize("bits", [4, 8, 16, 32])
def test_sequence_counters_of_frames_wrap_without_a_loss(bits: int) -> None:
    counts = [0] * len(count.COUNTER_NAMES)
    sequence, period = Sequence(1 << bits, counts), 1 << bits
    assert all(sequence.judge((period - 5 + k) % period) == NEW for k in range(10))
    assert not any(counts)
    assert sequence.judge((5 + 2) % period) == NEW
    assert sequence.judge(5 % period) == count.REORDERED


def test_neutral_goes_on_with_the_counter_of_the_2_to_the_32nd_command(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    class Raw:
        def __init__(self) -> None:
            self.sent: list[bytes] = []

        def send(self, frame: bytes) -> None:
            self.sent.append(frame)

    raw = Raw()
    monkeypatch.setattr("drivers.neutral._raw_socket", lambda *_: raw)
    writer = SocketcanNeutral("can0", False, [[bytes([k])] for k in range(16)])
    writer.write(BIG - 1)
    writer.write(BIG + 1)
    assert [frame[0] for frame in raw.sent] == [15, *range(15), *range(1, 16), 0]


def test_a_boards_clock_wraps_again_and_again() -> None:
    """A sample each minute through nine hours: seven wraps of 71.6 minutes."""
    clock = DeviceClock()
    times = [100.0 + 60.0 * k for k in range(540)]
    taken = [clock.heard(int(t * 1e6) % WRAP, t + 1e-4) for t in times]
    assert np.abs(np.array(taken) - times).max() < 1.1e-4
    assert clock.resets == 0


def before_midnight() -> About:
    """A recording that begins 5 ms before a new year, UTC; its rows' clock reads 100 s then."""
    offset_ns = MIDNIGHT_NS - 100_005_000_000
    return dataclasses.replace(about(), started=MIDNIGHT_S - 0.005, offset_ns=offset_ns)


def log_times(path: Path) -> tuple[list[int], list[Any]]:
    found = [message for topic, message in Content(path).messages if topic.startswith(ROWS)]
    return [message.log_time for message in found], found


def test_a_recording_goes_over_midnight_and_2_to_the_32_ticks(tmp_path: Path) -> None:
    table = rows(100, first=BIG - 50)
    table["tick_t"] = 100.0 + np.arange(100) * 5e-4
    series = Series(tmp_path / "a.mcap", before_midnight(), Rotation(time=3600.0), dict, 0.0)
    series.put([table[:40]], 0.0)
    series.put([table[40:]], 0.1)
    series.finish(0.2)
    assert [path.name for path in tmp_path.iterdir()] == ["a.mcap"]  # a new day begins no new file
    assert Content(tmp_path / "a.mcap").metadata["started"] == "2026-12-31T23:59:59.995000+00:00"
    told, messages = log_times(tmp_path / "a.mcap")
    assert np.diff(told).tolist() == [500_000] * 99
    assert told[10] == MIDNIGHT_NS
    decoded = decode([message.data for message in messages])
    assert decoded["tick"].tolist() == list(range(BIG - 50, BIG + 50))
