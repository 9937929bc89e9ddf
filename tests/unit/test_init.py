"""`seod init`: what is proposed can be run, and what is dangerous is not guessed."""

from __future__ import annotations

import shutil
import threading
import time

import can
import pytest
from test_cli import invoke

from seod.config.load import load_rig
from seod.files.shipped import configs_dir
from seod.init.listen import heard
from seod.init.signals import InitError, candidates, output, sensor

DBC = configs_dir() / "motor.dbc"
LIMITS = {
    "--travel": "-30 deg:30 deg",
    "--speed": "40 rad/s",
    "--output-limit": "1500 mV",
    "--amplitude": "0.2 rad",
    "--e-a": "300 mV",
    "--watchdog": "40 ms",
}


def words(without=""):
    return [word for option, value in LIMITS.items() if option != without for word in (option, value)]


def test_a_virtual_rig_is_the_shipped_one_by_another_name(tmp_path):
    out = tmp_path / "bench7.yaml"
    assert invoke("init", "--virtual", "--out", out)[0] == 0
    assert load_rig(out).rig == "bench7"
    assert out.read_text().count("#") == (configs_dir() / "virtual.yaml").read_text().count("#")


def test_a_dbc_becomes_a_rig_with_the_limits_that_were_typed(tmp_path):
    shutil.copy(DBC, tmp_path)
    out = tmp_path / "rig.yaml"
    code, said, err = invoke("init", "--dbc", tmp_path / "motor.dbc", "--rate", 500, "--out", out, *words())
    assert code == 0, err
    assert "seod check" in said
    assert "sensor: Encoder.angle [rad]" in err
    rig = load_rig(out)
    axis = rig.axes["motor"]
    assert (rig.sensors["reading"].channel, rig.outputs["valve"].channel) == (
        "Encoder.angle",
        "Valve.voltage",
    )
    assert (axis.limits.output, axis.limits.speed, axis.relay.e_a) == (1.5, 40.0, 0.3)
    assert axis.limits.travel == pytest.approx((-0.5236, 0.5236), abs=1e-4)
    assert rig.guard.rig_watchdog == 0.04
    assert rig.driver["dbc"] == str(tmp_path / "motor.dbc")
    assert invoke("check", out)[0] == 0


@pytest.mark.parametrize("option", LIMITS)
@pytest.mark.parametrize("where", [["--dbc", DBC, "--rate", "500"], ["--serial", "/dev/ttyACM0"]])
def test_each_limit_is_asked_for(tmp_path, option, where):
    out = tmp_path / "rig.yaml"
    code, _, err = invoke("init", *where, "--out", out, *words(without=option))
    assert code == 1
    assert err.endswith(f"limits are never guessed: give {option}\n")
    assert not out.exists()


def test_a_board_on_a_line_gets_its_port_and_its_limits(tmp_path):
    out = tmp_path / "board.yaml"
    assert invoke("init", "--serial", "/dev/ttyUSB3", "--out", out, *words())[0] == 0
    rig = load_rig(out)
    assert rig.driver["port"] == "/dev/ttyUSB3"
    assert rig.axes["motor"].limits.output == 1.5


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ([], "--virtual, --dbc FILE or --serial PORT"),
        (["--dbc", DBC, *words()], "how often does Encoder come? --rate HERTZ, or --listen"),
        (["--dbc", DBC, "--rate", 500, "--sensor", "Encoder.angel", *words()], "Encoder.angle"),
        (["--dbc", DBC, "--rate", 500, "--sensor", "Encoder.counter", *words()], "has no unit"),
        (
            ["--dbc", configs_dir() / "seat.dbc", "--rate", 500, *words()],
            "choose one by --output MESSAGE.SIGNAL",
        ),
        (["--dbc", configs_dir() / "virtual.yaml", "--rate", 500, *words()], "cannot be read as a DBC"),
    ],
)
def test_what_must_be_chosen_is_listed(tmp_path, given, said):
    code, _, err = invoke("init", "--out", tmp_path / "rig.yaml", *given)
    assert code == 1
    assert said in err


def test_a_file_that_exists_is_kept(tmp_path):
    out = tmp_path / "rig.yaml"
    out.write_text("mine")
    assert invoke("init", "--virtual", "--out", out)[0] == 1
    assert out.read_text() == "mine"
    assert invoke("init", "--virtual", "--out", out, "--force")[0] == 0


def test_the_only_signal_that_can_be_is_taken_and_a_command_is_none_of_the_sensors():
    found = candidates(DBC)
    measured = sensor(found, None)
    assert measured.name == "Encoder.angle"
    assert output(found, None, measured).name == "Valve.voltage"
    with pytest.raises(InitError, match="sensor's own message"):
        output([*found, measured], "Encoder.angle", measured)
    with pytest.raises(InitError, match="no signal can be a position"):
        sensor(found, None, seen={0x102: 100.0})


def test_a_bus_is_listened_to_and_nothing_is_sent():
    with can.Bus("init", interface="virtual") as other:
        stop = threading.Event()

        def speak():
            while not stop.is_set():
                other.send(can.Message(arbitration_id=0x101, data=[0] * 8))
                time.sleep(0.005)

        thread = threading.Thread(target=speak)
        thread.start()
        try:
            rates = heard("virtual", "init", 0.3)
        finally:
            stop.set()
            thread.join()
        assert set(rates) == {0x101}
        assert rates[0x101] > 5.0
        assert other.recv(0.0) is None
    with pytest.raises(InitError, match="cannot be listened to"):
        heard("socketcan", "nosuchbus0", 0.1)
