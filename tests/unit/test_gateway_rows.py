import pytest
from fake_loop import PERIOD, FakeLoop, eventually, peer, rig_config, running

from seod.observe import process as observing
from seod.observe.process import ObserveError
from seod.observe.rows import RowReader
from seod.processes.ring import Word


def test_rows_that_were_overwritten_are_counted_and_none_is_torn():
    loop = FakeLoop(rows=64)
    reader = RowReader(loop.shared)
    loop.rows(50)
    assert reader.take()["tick"].tolist() == list(range(50))
    loop.rows(100)
    taken = reader.take()["tick"].tolist()
    assert taken == list(range(150 - 63, 150))  # the slot that is written next is not touched
    assert reader.lost == 150 - 50 - len(taken)
    assert loop.shared.words[Word.CONSUMED] == 150
    reader.close()
    loop.close()


def test_rows_overwritten_while_they_are_copied_are_dropped():
    loop = FakeLoop(rows=64)
    reader = RowReader(loop.shared)
    loop.rows(60)

    class WhileCopying:
        def __init__(self, slots):
            self.slots = slots

        def __len__(self):
            return len(self.slots)

        def __getitem__(self, index):
            loop.rows(10)  # overwrites rows 0 to 5, of which the copy then has the new ones
            return self.slots[index]

    reader._slots = WhileCopying(reader._slots)
    assert reader.take()["tick"].tolist() == list(range(7, 60))
    assert reader.lost == 7
    reader._slots = reader._slots.slots
    assert reader.take()["tick"].tolist() == list(range(60, 70))
    assert loop.shared.row_ring.lost == 0
    reader.close()
    loop.close()


def test_a_gateway_that_is_started_again_goes_on_where_the_last_one_ended():
    loop = FakeLoop()
    first = RowReader(loop.shared)
    loop.rows(10)
    first.take()
    first.close()
    loop.shared.row_ring.tail = 0
    loop.rows(5)
    second = RowReader(loop.shared)
    assert second.take()["tick"].tolist() == [10, 11, 12, 13, 14]
    second.close()
    loop.close()


async def test_lost_rows_are_told_and_the_estimator_begins_anew(monkeypatch):
    class Counting:
        resets = 0

        def update(self, row):
            return None

        def reset(self):
            Counting.resets += 1

        def inherit(self, before):
            pass

    monkeypatch.setattr(observing, "make_estimator", lambda settings: Counting())
    async with running(rows=64) as run, peer(run) as client:
        run.loop.row()
        await eventually(lambda: run.loop.shared.words[Word.CONSUMED] == 1)
        began = Counting.resets
        await client.call("subscribe", topics=["event"])
        run.loop.rows(200)
        warning = await client.until("event", code="rows_lost")
        assert warning["why"].startswith("137 rows")
        await eventually(lambda: Counting.resets > began)
        assert (await client.call("status"))["health"]["rows_lost"] == 137


async def test_estimation_rests_where_rows_would_be_lost_and_these_still_come(monkeypatch):
    class Counting:
        updates = 0

        def update(self, row):
            Counting.updates += 1

        def reset(self):
            pass

        def inherit(self, before):
            pass

    monkeypatch.setattr(observing, "make_estimator", lambda settings: Counting())
    async with running(rows=1000) as run, peer(run) as client:
        await client.call("subscribe", topics=["event", "sample"])
        run.loop.rows(900)  # before anybody can take some
        await client.until("event", code="estimator_rests")
        samples = [await client.until("sample") for _ in range(900)]
        assert [sample["tick"] for sample in samples] == list(range(900))
        assert Counting.updates < 200
        before = Counting.updates
        run.loop.rows(10)
        await eventually(lambda: Counting.updates == before + 10)


@pytest.mark.slow
async def test_recording_goes_with_the_stream_and_is_whole_at_the_end(tmp_path):
    path = tmp_path / "a.csv"
    async with running(record=path) as run, peer(run) as client:
        run.loop.rows(500)
        recorder = (await client.call("status"))["health"]["recorder"]
        assert recorder["error"] is None
        run.loop.rows(500)
    lines = path.read_text().splitlines()
    assert [int(line.split(",")[-2]) for line in lines[1:]] == list(range(1000))


async def test_a_recording_that_fails_is_told_and_the_stream_goes_on(tmp_path):
    path = tmp_path / "a.csv"
    async with running(record=path) as run, peer(run) as client:
        await client.call("subscribe", topics=["event", "sample"])
        path.unlink()
        run.loop.rows(100)
        warning = await client.until("event", code="recording")
        assert "deleted" in warning["why"]
        run.loop.row()
        await client.until("sample", tick=100)
        assert (await client.call("status"))["health"]["recorder"]["lost"] >= 100


def test_a_recording_that_cannot_begin_is_refused(tmp_path):
    with pytest.raises(ObserveError, match=r"cannot record to .*: No such file"):
        observing.start_recording(tmp_path / "no" / "a.csv", rig_config(), tmp_path / "rig.yaml")


async def test_on_simulated_time_ages_are_simulated_as_well():
    loop = FakeLoop()
    config = rig_config()
    config.driver["realtime"] = False
    clock = observing.clock_of(config, loop.shared)
    loop.rows(5)
    assert clock() == pytest.approx(100 + 4 * PERIOD)
    loop.close()
