"""`seod response`: excitation designed within the limits; recordings in, table, JSON and plot out."""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from seod.calibrate.procedure import CalibrationError
from seod.cli import app
from seod.config.load import load_rig
from seod.files.shipped import configs_dir
from seod.loop.tones import MOST_TONES
from seod.respond import RespondError, Segment, respond
from seod.respond.design import Excitation, Room, largest, multisines, settling_time, sines
from seod.respond.fit import Plant
from seod.respond.live import Options, at_rest_afterwards, drive_all, measure, plan, room_of
from seod.respond.predict import predict
from seod.respond.relay import recorded
from tests.command_line import CliRunner
from tests.unit.flow_truth import Actuator, driven, relay_run

if TYPE_CHECKING:
    from pathlib import Path

    from seod.config.model import RigConfig

PLANT = Plant(17.0, 117.0, 0.21)
SERVO = Actuator(17.0, 80.0, 0.25, 729.0)
TICK = 5e-4


@pytest.fixture
def rig() -> RigConfig:
    return load_rig(configs_dir() / "virtual.yaml")


def frequencies(tones: Any, period: float) -> list[float]:
    return [tone.frequency * period for tone in tones]


def test_multisines_have_odd_lines_some_left_out_and_new_phases() -> None:
    first, second = multisines((1.0, 50.0), 1.0, 2, "position", np.random.default_rng(1))
    orders = frequencies(first, 1.0)
    assert orders == frequencies(second, 1.0)
    assert all(order % 2 == 1 for order in orders)
    assert orders[:2] == [1.0, 3.0]
    assert 17 <= len(orders) <= 20  # of 25
    assert {tone.phase for tone in first}.isdisjoint(tone.phase for tone in second)
    t = np.arange(4000) / 4000.0
    peak = max(abs(sum(a * np.sin(2 * np.pi * f * t + p) for f, a, p in first)))
    assert peak == pytest.approx(1.0, rel=0.02)


@pytest.mark.slow
def test_many_lines_are_thinned_and_too_few_refused() -> None:
    tones = multisines((0.1, 100.0), 10.0, 1, "velocity", np.random.default_rng(1))[0]
    assert len(tones) <= MOST_TONES
    assert all(round(order) % 2 == 1 for order in frequencies(tones, 10.0))
    with pytest.raises(RespondError, match="a longer period"):
        multisines((1.0, 5.0), 1.0, 1, "velocity", np.random.default_rng(1))


def test_the_motion_expected_stays_within_its_room() -> None:
    """Against a simulation of the very motion, written apart."""
    tones = multisines((0.9, 55.0), 1.0, 1, "position", np.random.default_rng(2))[0]
    factor = largest(tones, 1.0, Room("position", 0.2, 20.0, 2.0), 17.0, PLANT)
    t = np.arange(6000) * TICK
    u = factor * sum(a * np.sin(2 * np.pi * f * t + p) for f, a, p in tones)
    y = driven(Actuator(17.0, 117.0, 0.21, 1e9), u)[4000:]
    swing, speed = np.ptp(y) / 2.0, np.abs(np.diff(y)).max() / TICK
    assert max(swing / 0.2, speed / 20.0, np.abs(u).max() / 2.0) == pytest.approx(1.0, abs=0.1)
    blind = largest(tones, 1.0, Room("position", 0.2, 20.0, 2.0), 17.0, None)
    assert blind < factor


@pytest.mark.slow
def test_a_plan_fits_the_rig_or_says_what_would(rig: RigConfig) -> None:
    axis = rig.axes["motor"]
    room = room_of(axis, 0.1, 0.0, 0.0)
    assert room.measured == pytest.approx(0.6 * 0.45)  # limits.amplitude is nearer than the travel
    drives = plan(axis, Options(), room, 17.0, PLANT)
    assert len(drives) == 4
    assert all(drive.most <= 0.5 for drive in drives)
    assert all(drive.duration - drive.settling == pytest.approx(6 * drive.period + 0.05) for drive in drives)
    with pytest.raises(RespondError, match=r"V fits"):
        plan(axis, Options(amplitude=1.9), room, 17.0, PLANT)
    with pytest.raises(RespondError, match="give the band"):
        plan(axis, Options(), room, 17.0, None)
    with pytest.raises(RespondError, match=r"limits\.excitation"):
        plan(axis, Options(periods=1000, band=(0.1, 50.0)), room, 17.0, PLANT)
    with pytest.raises(RespondError, match="no room"):
        room_of(axis, 1.2, 0.0, 0.0)


def test_sines_are_smaller_where_the_position_would_swing_too_far(rig: RigConfig) -> None:
    axis = rig.axes["motor"]
    options = Options(kind="sine", points=6, band=(0.5, 50.0), amplitude=0.5)
    drives = plan(axis, options, room_of(axis, 0.0, 0.0, 0.0), 17.0, PLANT)
    volts = [drive.tones[0].amplitude for drive in drives]
    assert volts[0] == pytest.approx(0.27 * 2 * math.pi * 0.5 / 17.0, rel=0.05)
    assert volts[-1] == 0.5
    assert [len(each) for each in sines((1.0, 10.0), 3)] == [1, 1, 1]
    assert settling_time(PLANT, 5.0) == pytest.approx(8.0 / (0.21 * 117.0) + 1.6)


class FakeClient:
    """A daemon whose axis is driven: what a simulated actuator does, as samples."""

    def __init__(self, state: str = "idle") -> None:
        self.state, self.stopped, self.drives = state, 0, 0

    def get(self, axis: str) -> dict[str, Any]:
        return {"state": self.state, "settings": {"bias": 0.0, "e_a": 0.5, "K_L": 17.0}}

    def stop(self, axis: str) -> None:
        self.stopped += 1
        self.state = "idle"

    def excite(self, volts: float, duration: float, tones: Any) -> list[dict[str, Any]]:
        self.drives += 1
        t = np.arange(round(duration / TICK)) * TICK
        u = sum(a * np.sin(2 * np.pi * f * t + p) for f, a, p in tones)
        assert np.abs(u).max() <= volts
        y = driven(Actuator(17.0, 117.0, 0.21, 1e9), u, 1e-4)
        keys = ("t", "u", "y", "t_u")
        rows = zip(100.0 + t, u, y, 100.0 + t, strict=True)
        return [dict(zip(keys, row, strict=True)) | {"fresh": k % 50 != 7} for k, row in enumerate(rows)]


def test_drives_are_made_into_segments_that_tell_the_plant(rig: RigConfig) -> None:
    client = FakeClient()
    axis = rig.axes["motor"]
    options = Options(realisations=2, periods=3, band=(2.0, 50.0))
    drives = plan(axis, options, room_of(axis, 0.0, 0.0, 0.0), 17.0, PLANT)
    segments = drive_all(client, "motor", drives, "position", lambda done: None)  # type: ignore[arg-type] # as much of a rig as is needed
    assert client.drives == 2
    assert segments[0].t[0] == pytest.approx(100.0 + drives[0].settling, abs=1e-3)
    found = respond(segments)
    assert found.fit.plant.zeta == pytest.approx(0.21, rel=5e-3)
    assert found.fit.plant.omega_n == pytest.approx(117.0, rel=2e-3)


def test_the_axis_is_stopped_however_it_ends() -> None:
    client = FakeClient("exciting")

    def interrupted() -> None:
        with at_rest_afterwards(client, "motor"):  # type: ignore[arg-type] # likewise
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert client.stopped == 1


def test_a_busy_axis_is_left_alone(rig: RigConfig, monkeypatch: pytest.MonkeyPatch) -> None:
    class Silent:
        def __init__(self, *_: object) -> None: ...

        def close(self) -> None: ...

    monkeypatch.setattr("seod.respond.live.RemoteRig", Silent)
    client = FakeClient("exciting")
    with pytest.raises(CalibrationError, match="is exciting: stop"):
        measure(client, "motor", rig.axes["motor"], Options(), lambda what, done: None)  # type: ignore[arg-type] # likewise
    assert (client.stopped, client.drives) == (0, 0)


@pytest.mark.slow
@pytest.mark.parametrize("e_a", [0.3, 1.2])
def test_what_a_large_amplitude_changes_is_predicted(rig: RigConfig, e_a: float) -> None:
    """Flow by the square root: relay and tones see two plants, in the kernel as in truth written apart."""
    simulation = rig.simulation
    assert simulation is not None
    plant = simulation.plants["motor"].model_copy(
        update={
            "omega_n": SERVO.omega_n,
            "zeta": SERVO.zeta,
            "effects": {"square_root_flow": {"supply": SERVO.supply}},
            "stops": None,
        }
    )
    axis = rig.axes["motor"]
    axis = axis.model_copy(update={"relay": axis.relay.model_copy(update={"hysteresis": 0.0})})
    config = rig.model_copy(
        update={
            "simulation": simulation.model_copy(update={"plants": {"motor": plant}}),
            "axes": {"motor": axis},
        }
    )
    tones = multisines((1.5, 38.0), 1 / 1.5, 1, "position", np.random.default_rng(1))[0]
    drive = Excitation(1 / 1.5, tones, 1.0, 0.0).scaled(e_a)
    expected = predict(config, "motor", [drive], e_a, SERVO.K_L)
    t = np.arange(6500) * TICK
    u = sum(a * np.sin(2 * np.pi * f * t + p) for f, a, p in drive.tones)
    segment = Segment.of("apart", t, u, driven(SERVO, u), None, period=drive.period).after(1.0)
    assert expected.response.zeta == pytest.approx(respond([segment]).fit.plant.zeta, rel=0.01)
    t, u, y = relay_run(SERVO, e_a, 1.5)
    late = t > 0.7
    cycle = recorded("apart", t[late], u[late], y[late], None, "position", SERVO.K_L, 0.0).plant
    assert expected.limit_cycle.zeta == pytest.approx(cycle.zeta, rel=0.01)
    assert expected.limit_cycle.zeta > 1.1 * expected.response.zeta > 1.1 * SERVO.zeta


def invoke(*words: str | Path) -> tuple[int, str, str]:
    done = CliRunner().invoke(app, ["response", *map(str, words)])
    return done.exit_code, done.stdout, done.stderr


@pytest.fixture
def recordings(tmp_path: Path) -> tuple[Path, Path]:
    """Of multisine and relay, on one plant."""
    plant = Actuator(17.0, 117.0, 0.21, 1e9)
    t = np.arange(8000) * TICK
    tones = multisines((1.5, 60.0), 1 / 1.5, 1, "position", np.random.default_rng(3))[0]
    u = 0.3 * sum(a * np.sin(2 * np.pi * f * t + p) for f, a, p in tones)
    paths = tmp_path / "tones.csv", tmp_path / "relay.csv"
    for path, columns in zip(
        paths, ((t, u, driven(plant, u, 1e-4)), relay_run(plant, 0.5, 2.0, 1e-4)), strict=True
    ):
        np.savetxt(path, np.stack(columns, 1), delimiter=",", header="t,u,y", comments="")
    return paths


@pytest.fixture(scope="module")
def fonts(tmp_path_factory: pytest.TempPathFactory) -> None:
    """matplotlib opens its fonts once and keeps them."""
    figure = Figure()
    figure.subplots().loglog([1e-3, 1.0], [1e-3, 1.0])
    figure.savefig(tmp_path_factory.mktemp("fonts") / "x.png")


@pytest.mark.slow
def test_recordings_become_a_table_json_and_a_plot(
    recordings: tuple[Path, Path], tmp_path: Path, fonts: None
) -> None:
    tones, relay = recordings
    plot = tmp_path / "bode.png"
    code, out, err = invoke(tones, "--limit-cycle", relay, "--gain", "17", "--plot", plot, "--json")
    assert (code, err) == (0, "")
    found = json.loads(out, parse_constant=lambda word: pytest.fail(f"{word} in JSON"))
    assert found["quality"] == "ok"
    assert found["periodic"]
    assert found["fit"]["omega_n"]["value"] == pytest.approx(117.0, rel=2e-3)
    assert found["fit"]["K_L"] == {"value": 17.0, "sd": 0.0}
    assert found["limit_cycle"]["e_a"] == pytest.approx(0.5)
    assert abs(found["difference"]["omega_n"]) < 0.01
    assert abs(found["difference"]["zeta"]) < 0.03
    assert plot.read_bytes().startswith(b"\x89PNG")
    code, out, _ = invoke(tones)
    assert code == 0
    assert "ok, " in out
    assert "limit cycle" not in out


@pytest.mark.parametrize(
    ("words", "why"),
    [
        ((), "give recordings, or a rig"),
        (("no.csv",), "no.csv"),
        (("no.csv", "--amplitude", "1"), "--amplitude: for a rig that is excited"),
        (("no.csv", "--predict"), "--predict: for a rig"),
        (("--config", configs_dir() / "virtual.yaml", "--output", "velocity"), "--output: for recordings"),
        (("--config", configs_dir() / "seat-virtual.yaml"), "--axis takes one of pitch, roll"),
        (("--config", configs_dir() / "virtual.yaml", "--band", "5:1"), "two rising numbers"),
    ],
)
def test_what_does_not_go_together_is_told(words: tuple[Any, ...], why: str) -> None:
    code, out, err = invoke(*words)
    assert (code, out) == (1, "")
    assert why in err
