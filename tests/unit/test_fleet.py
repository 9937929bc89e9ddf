"""The fleet without sockets: what is stored, given up, sent again and taken once; commands refused."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import pytest

from seod.fleet.board import Board
from seod.fleet.commands import Commands, RefusedError
from seod.fleet.outbox import MARGIN_S, Outbox
from seod.fleet.store import Store
from seod.fleet.topics import NOTHING, Key

if TYPE_CHECKING:
    from pathlib import Path


def test_a_torn_tail_is_cut_away_and_told(tmp_path: Path) -> None:
    store = Store(tmp_path, 1e6, 1000.0)
    for number in range(5):
        store.append("event", b'{"n":%d}' % number)
    store.close()
    path = next(tmp_path.glob("*.records"))
    path.write_bytes(path.read_bytes()[:-4])
    again = Store(tmp_path, 1e6, 1000.0)
    assert [record.key.seq for record in again.read(NOTHING, 10)] == [1, 2, 3, 4]
    assert again.torn == 1
    assert again.session > store.session


def test_damage_within_is_left_out_and_told(tmp_path: Path) -> None:
    store = Store(tmp_path, 1e6, 1000.0)
    for _ in range(3):
        store.append("event", b'{"n":1}')
    store.close()
    path = next(tmp_path.glob("*.records"))
    path.write_bytes(path.read_bytes().replace(b"1000 2 event", b"1000 2 evenX"))
    again = Store(tmp_path, 1e6, 1000.0)
    assert [record.key.seq for record in again.read(NOTHING, 10)] == [1, 3]
    assert again.damaged == 1


def test_the_oldest_estimates_are_given_up_first(tmp_path: Path) -> None:
    limit = 60_000.0
    store = Store(tmp_path, limit, 1000.0)
    for number in range(1500):
        store.append("event" if number % 50 == 0 else "estimate/motor", b'{"x":"%s"}' % (b"-" * 60))
    kept = store.read(NOTHING, 10_000)
    store.close()
    assert store.size <= limit
    assert sum(record.suffix == "event" for record in kept) == 30
    assert set(store.thinned) == {"estimate"}
    assert len(kept) + store.thinned["estimate"] == 1500
    numbers = [record.key.seq for record in kept]
    assert numbers == sorted(set(numbers))
    assert sum(seq <= 750 for seq in numbers) < sum(seq > 750 for seq in numbers)


def payload(key: tuple[int, int], prev: tuple[int, int], **more: Any) -> bytes:
    return json.dumps({"session": key[0], "seq": key[1], "prev": prev, **more}).encode()


def test_each_key_is_taken_once_and_gaps_are_counted() -> None:
    board = Board()
    for key, prev in (((1, 1), (0, 0)), ((1, 2), (1, 1)), ((1, 2), (1, 1)), ((1, 5), (1, 4))):
        board.take("seod/v1/press/event", payload(key, prev), retained=False, now=0.0)
    assert (board.counts.taken, board.counts.twice, board.counts.lost) == (3, 1, 2)


def test_an_archive_takes_nothing_behind_a_gap() -> None:
    board = Board("hall")
    board.take("seod/v1/press/event", payload((1, 1), (0, 0), archive="hall"), retained=False, now=0.0)
    late = payload((1, 3), (1, 2), archive="hall")
    assert board.take("seod/v1/press/event", late, retained=False, now=0.0) is None
    assert board.gaps == {"press"}
    gone = payload((1, 3), (1, 2), archive="hall", oldest=True)
    assert board.take("seod/v1/press/event", gone, retained=False, now=0.0) is not None


def test_what_is_not_released_is_sent_again(tmp_path: Path) -> None:
    store = Store(tmp_path, 1e6, 1000.0)
    outbox = Outbox("press", store)
    for number in range(3):
        outbox.put("event", {"n": number})
    first = outbox.batch(2)
    outbox.taken(first[-1].key, now=0.0)
    outbox.begin()
    assert [parcel.key.seq for parcel in outbox.batch(10)] == [1, 2, 3]
    outbox.age(MARGIN_S + 1.0)
    outbox.begin()
    assert [parcel.key.seq for parcel in outbox.batch(10)] == [3]
    outbox.close()


def test_only_the_archive_releases_what_is_kept_for_it(tmp_path: Path) -> None:
    outbox = Outbox("press", Store(tmp_path, 1e6, 1000.0), "hall")
    outbox.put("event", {})
    key = outbox.batch(10)[-1].key
    outbox.taken(key, now=0.0)
    outbox.age(1e6)
    outbox.confirmed(Key(key.session, key.seq + 5), again=True, now=0.0)  # of what was never sent
    assert [parcel.key for parcel in outbox.batch(10)] == [key]
    outbox.confirmed(key, again=True, now=0.0)
    assert outbox.batch(10) == []
    outbox.close()


@pytest.mark.parametrize(
    ("change", "retained", "why"),
    [
        ({}, True, "retained"),
        ({"at": 90.0}, False, "ago"),
        ({"at": float("nan")}, False, "ago"),
        ({"at": None}, False, "at: required"),
        ({"id": None}, False, "id: required"),
        ({"method": "drive"}, False, "must be one of"),
        ({"method": "estop"}, True, "retained"),
    ],
)
def test_commands_that_are_not_carried_out(change: dict[str, Any], retained: bool, why: str) -> None:
    body = {"id": "1", "at": 100.0, "method": "start", **change}
    with pytest.raises(RefusedError, match=why):
        Commands().judge(json.dumps(body).encode(), retained, 100.0)


def test_an_estop_is_taken_however_old_and_no_command_twice() -> None:
    commands = Commands()
    stop = json.dumps({"id": "1", "at": 0.0, "method": "estop"}).encode()
    assert commands.judge(stop, retained=False, now=100.0).method == "estop"
    with pytest.raises(RefusedError, match="before"):
        commands.judge(stop, retained=False, now=100.0)
