"""Rings: what is written is read once and in order, and what was overwritten is counted, across processes."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

import pytest
from hypothesis import given
from hypothesis import strategies as st

from seod.processes.ring import AXIS_FIELDS, MESSAGE_SLOTS, Column, Shared, Word, bin_edges_us

if TYPE_CHECKING:
    from collections.abc import Iterator


@pytest.fixture
def shared() -> Iterator[Shared]:
    block = Shared(axes=2, rows=64)
    yield block
    block.close()


NUMBERS = [0.0] * len(AXIS_FIELDS)


def put_row(block: Shared, number: int) -> None:
    ring = block.row_ring
    block.row_struct.pack_into(ring.data, ring.next_offset(), number, 0.5, *NUMBERS, 1, 2, *NUMBERS, 3, 4)
    ring.commit()


def read_rows(block: Shared) -> list[int]:
    ring = block.row_ring
    tail, head = ring.pending()
    ring.tail = head
    at = [(entry % ring.slots) * ring.slot_bytes for entry in range(tail, head)]
    return [block.row_struct.unpack_from(ring.data, offset)[0] for offset in at]


def test_each_column_of_a_row_has_its_place_by_name(shared: Shared) -> None:
    names = (*AXIS_FIELDS, "state", "flags")
    assert [getattr(Column, name.upper()) for name in names] == list(range(Column.COUNT))
    values = shared.row_struct.unpack(bytes(shared.row_struct.size))
    assert len(values) == 2 + shared.axes * Column.COUNT


@given(st.lists(st.one_of(st.integers(1, 200), st.just(-1)), max_size=30))
def test_rows_come_once_in_order_and_losses_are_counted(steps: list[int]) -> None:
    """Positive: write that many; -1: read."""
    block = Shared(axes=2, rows=64)
    try:
        written, got = 0, []
        for step in [*steps, -1]:
            if step < 0:
                got += read_rows(block)
            for _ in range(max(step, 0)):
                put_row(block, written)
                written += 1
        assert got == sorted(set(got))
        assert len(got) + block.row_ring.lost == written
        assert got[-1:] == ([written - 1] if written else [])
    finally:
        block.close()


def test_messages_cross_processes(shared: Shared) -> None:
    pid = os.fork()
    if pid == 0:
        other = Shared(axes=2, rows=64, fd=os.dup(shared.fd))
        other.events.put({"event": "hello", "n": 1})
        other.words[Word.TICKS] = 7
        os._exit(0)
    os.waitpid(pid, 0)
    assert list(shared.events.take()) == [{"event": "hello", "n": 1}]
    assert list(shared.events.take()) == []
    assert shared.words[Word.TICKS] == 7


def test_message_ring_loses_the_oldest_and_counts(shared: Shared) -> None:
    for number in range(MESSAGE_SLOTS + 10):
        shared.commands.put({"n": number})
    got = [m["n"] for m in shared.commands.take()]
    assert got == list(range(11, MESSAGE_SLOTS + 10))
    assert shared.commands.lost == 11


def test_message_longer_than_a_slot_is_refused(shared: Shared) -> None:
    with pytest.raises(ValueError, match="a slot holds"):
        shared.events.put({"why": "x" * 5000})
    assert list(shared.events.take()) == []


def test_undefined_numbers_never_enter_a_ring(shared: Shared) -> None:
    with pytest.raises(ValueError, match="JSON"):
        shared.events.put({"x": float("nan")})


def test_histogram_edges_span_a_microsecond_to_tens_of_milliseconds() -> None:
    edges = bin_edges_us()
    assert edges[0] == 1.0
    assert edges == sorted(edges)
    assert 4e4 < edges[-1] < 5e4


def test_each_word_of_the_status_block_is_one_things():
    numbers = [number for name, number in vars(Word).items() if name.isupper() and name != "WORDS"]
    assert len(set(numbers)) == len(numbers)
    assert max(numbers) < Word.WORDS
