"""The bus log on a bus that the test holds; on a real one: tests/vm/guest/test_record.py."""

import errno
import itertools
import subprocess
import sys
import time

import can
import pytest
from fake_loop import rig_config
from record_rows import until

from drivers.can_config import CanOptions
from seod.observe.process import ObserveError, start_recording
from seod.record import bus as bus_module
from seod.record.bus import BusLog
from seod.record.errors import BusLogError
from seod.record.opening import open_bus_log

CHANNELS = itertools.count()


@pytest.fixture
def peer(monkeypatch):
    """The other end of a bus that the log hears."""
    channel = f"buslog{next(CHANNELS)}"
    bus = can.Bus(interface="virtual", channel=channel, ignore_config=True)
    listen = can.Bus(interface="virtual", channel=channel, ignore_config=True)
    monkeypatch.setattr(bus_module, "_listen", lambda options: listen)
    yield bus
    bus.shutdown()
    listen.shutdown()


def send(bus, count):
    for number in range(count):
        bus.send(can.Message(arbitration_id=0x100 + number, data=bytes([number]), is_extended_id=False))


def wait_for(log, frames):
    until(lambda: log.report()["frames"] + log.report()["lost"] >= frames)


OPTIONS = CanOptions.model_construct(interface="socketcan", channel="x", fd=False, bus_options={})


@pytest.mark.parametrize("suffix", [".blf", ".asc", ".log", ".mf4"])
def test_each_frame_is_in_the_file(tmp_path, peer, suffix):
    path = tmp_path / f"bus{suffix}"
    log = BusLog(path, OPTIONS)
    send(peer, 20)
    wait_for(log, 20)
    log.close()
    assert log.report() == {"file": str(path), "frames": 20, "lost": 0, "error": None}
    with can.LogReader(path) as frames:
        assert [(f.arbitration_id, bytes(f.data)) for f in frames] == [
            (0x100 + n, bytes([n])) for n in range(20)
        ]


def test_what_a_full_disk_does_not_take_is_counted_and_said(tmp_path, peer, monkeypatch):
    log = BusLog(tmp_path / "bus.log", OPTIONS)
    write = log._logger.on_message_received
    full = [True]

    def on_message(frame):
        if full[0]:
            raise OSError(errno.ENOSPC, "No space left on device")
        write(frame)

    monkeypatch.setattr(log._logger, "on_message_received", on_message)
    send(peer, 3)
    wait_for(log, 3)
    assert log.error.endswith("cannot be written: No space left on device")
    full[0] = False
    send(peer, 2)
    wait_for(log, 5)
    assert log.report() == {"file": str(tmp_path / "bus.log"), "frames": 2, "lost": 3, "error": None}
    log.close()


@pytest.fixture
def slow(monkeypatch):
    """The log's format takes this many seconds for a frame; meanwhile other threads run."""
    seconds = [0.02]
    make = bus_module._logger

    def slowed(path):
        logger = make(path)
        write = logger.on_message_received

        def on_message(frame):
            time.sleep(seconds[0])
            write(frame)

        monkeypatch.setattr(logger, "on_message_received", on_message)
        return logger

    monkeypatch.setattr(bus_module, "_logger", slowed)
    return seconds


def ids(path):
    with can.LogReader(path) as frames:
        return [frame.arbitration_id for frame in frames]


def test_what_was_heard_before_the_end_is_written_by_a_slow_format_too(tmp_path, peer, slow):
    log = BusLog(tmp_path / "bus.log", OPTIONS)
    send(peer, 20)
    log.close()
    assert ids(tmp_path / "bus.log") == [0x100 + n for n in range(20)]
    assert log.report()["lost"] == 0


@pytest.mark.slow
def test_what_waits_too_long_is_counted_and_said(tmp_path, peer, slow, monkeypatch, capsys):
    monkeypatch.setattr(bus_module, "WAITING_FRAMES", 5)
    slow[0] = 0.3
    log = BusLog(tmp_path / "bus.log", OPTIONS)
    send(peer, 20)
    until(lambda: log.error)
    assert log.error == f"{tmp_path / 'bus.log'} is written more slowly than the bus speaks"
    slow[0] = 0.0
    wait_for(log, 20)
    lost = log.report()["lost"]
    assert 0 < lost < 20
    until(lambda: not log.error)
    log.close()
    assert len(ids(tmp_path / "bus.log")) == 20 - lost
    assert capsys.readouterr().err == f"seod: bus log {tmp_path / 'bus.log'}: {lost} frames are not in it\n"


def test_the_end_does_not_wait_for_all_that_a_slow_format_has_left(tmp_path, peer, slow, monkeypatch, capsys):
    monkeypatch.setattr(bus_module, "LATE_S", 0.05)
    log = BusLog(tmp_path / "bus.log", OPTIONS)
    send(peer, 20)
    log.close()
    written = ids(tmp_path / "bus.log")
    assert written == [0x100 + n for n in range(len(written))]
    lost = 20 - len(written)
    assert 0 < lost < 20
    assert log.report()["lost"] == lost
    assert f"{lost} frames are not in it" in capsys.readouterr().err


def test_an_older_log_is_kept_aside(tmp_path, peer):
    (tmp_path / "bus.log").write_text("precious")
    BusLog(tmp_path / "bus.log", OPTIONS).close()
    assert (tmp_path / "bus.log~").read_text() == "precious"


def test_what_cannot_be_logged_is_refused_with_the_reason(tmp_path, monkeypatch):
    private = OPTIONS.model_copy(update={"interface": "virtual"})
    with pytest.raises(BusLogError, match="belongs to the loop's process"):
        BusLog(tmp_path / "bus.log", private)
    with pytest.raises(BusLogError, match="cannot listen on socketcan channel"):
        BusLog(tmp_path / "bus.log", OPTIONS)


@pytest.mark.parametrize(
    ("name", "why"), [("bus.txt", "expected one of .asc, .blf"), ("no/bus.log", "No such file")]
)
def test_a_file_that_cannot_be_written_is_refused(tmp_path, peer, name, why):
    with pytest.raises(BusLogError, match=why):
        BusLog(tmp_path / name, OPTIONS)


@pytest.mark.slow
def test_the_loop_loads_python_can_without_its_file_formats():
    code = """if True:
        import sys
        from drivers import driver_class
        driver_class("can")
        print(sorted({"pandas", "asammdf", "pyarrow"} & sys.modules.keys()))
        import asammdf"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


def test_without_a_bus_there_is_none_to_log(tmp_path):
    config = rig_config()
    assert open_bus_log(config, tmp_path) is None
    asked = config.model_copy(update={"record": config.record.model_copy(update={"bus_log": "bus.blf"})})
    with pytest.raises(ObserveError, match="driver kind virtual has no bus"):
        start_recording(None, asked, tmp_path / "rig.yaml")
