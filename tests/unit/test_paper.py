"""`seod paper`: the daemon on the physical rigs; pictures and page from given numbers."""

import json
from pathlib import Path

import pytest

from seod.batch.executor import StoppedError
from seod.cli import app
from seod.paper import command, figures, findings, pictures, words
from seod.paper.bench import Bench, rig
from seod.paper.daemon import Daemon, PaperError, middle
from seod.paper.figures import PRINTED, answer, at_pressure, exponent, figure_4, kept, swept
from seod.paper.findings import _largest, merged
from tests.command_line import CliRunner

pytestmark = pytest.mark.slow

PLANT = {
    "zeta": 0.2,
    "omega_n": 120.0,
    "K_L": 0.5,
    "quality": "ok",
    "zeta_95": 0.01,
    "omega_n_95": 1.0,
    "K_L_95": None,
}
POINT = {
    "small_signal": {"zeta": 0.2, "omega_n": 120.0, "K_L": 0.5},
    **dict.fromkeys(("peaks", "exact", "wave"), PLANT),
    "two-phase": {**PLANT, "zeta": None, "omega_n": None, "quality": "nonlinear"},
    "response_0.1": {**PLANT, "points": {"omega": [10.0, 100.0], "gain": [0.5, 0.4], "phase": [-0.1, -1.5]}},
    "response_0.5": {**PLANT, "points": {"omega": [10.0, 100.0], "gain": [0.5, 0.4], "phase": [-0.1, -1.5]}},
}
POINT_OF_MOTOR = {
    **{name: of for name, of in POINT.items() if not name.startswith("response")},
    **{f"response_{size}": POINT["response_0.1"] for size in ("0.3", "1.5")},
}
LINE = {
    "ps": [5e6, 1e7],
    "zeta": [0.2, 0.3],
    "omega_n": [100.0, 120.0],
    "zeta_95": [0.0, 0.0],
    "omega_n_95": [1.0, None],
}
SWEEP = {
    **{m: {**LINE, "quality": ["ok", "nonlinear"]} for m in ("peaks", "exact", "wave")},
    "small_signal": LINE,
    "response_0.3": LINE,
    "exponents": {"exact": 0.26},
}
ROW = {"small_signal": 0.25, "exact": 0.4, "exact_small": None}
OVER_SPEED = {name: {"speed": of["ps"], **of} for name, of in SWEEP.items() if "ps" in of}
NUMBERS = {
    "4": {
        "zeta": [0.1, 1.0],
        "zeta_simulated": [0.2],
        **{f"{factor}_{by}": [0.9, 1.1] for factor in ("xi", "Gamma") for by in ("exact", "eq8")},
        "xi_simulated": [1.0], "Gamma_simulated": [1.2], "worst_xi": 0.01, "worst_Gamma": 0.02,
    },
    "10": {
        **{name: [0.0, 1.0] for name in ("t", "speed", "relay_input", "relay_output")},
        "switches": 9, "speed_noise": 0.2, "cycle_s": 0.1,
    },
    "11": SWEEP,
    "12": OVER_SPEED,
    "13": {"0": POINT_OF_MOTOR, "70": POINT_OF_MOTOR, "133": POINT_OF_MOTOR},
    "14": {"pitch": POINT, "roll": POINT, "printed": PRINTED},
    "15": SWEEP,
    "exponent": {
        "large": 1.5,
        "small": 0.1,
        "rows": [{"mechanism": m, **ROW} for m in ("air 2 %", "air 20 %, isothermal (not plausible)")],
    },
    "amplitude": {
        "within": 0.02,
        "maps": [
            {"axis": "roll", "ps": [5e6, 1e7], "e_a": [0.1, 1.0], "worst": [[0.01, 0.3], [None, 0.2]],
             "largest_e_a": [0.2, None], "rig_e_a": 0.5},
            {"axis": "rudder", "ps": [5e6, 1e7], "e_a": [0.1, 1.0], "worst": [[0.03, 0.3], [0.04, 0.2]],
             "largest_e_a": [None, None], "rig_e_a": 0.1},
        ],
        "rudder_gains": {"steady": 0.14, "quick": 0.15},
    },
}  # fmt: skip


def test_the_seat_gives_table_2_by_the_daemons_own_loop():
    for axis in ("pitch", "roll"):
        with Daemon(at_pressure("seat-hydraulic", axis, 7e6), axis, ("exact",)) as daemon:
            daemon.start()
            daemon.run(0.5)
            daemon.forget()
            daemon.run(0.7)
            told = daemon.told.estimates["exact"]
        for name in ("zeta", "omega_n"):
            assert middle(told, name) == pytest.approx(PRINTED[axis][name]["SEO"], rel=0.02)


def test_a_sweep_of_pressure_is_followed():
    def pressure(s: float) -> None:
        daemon.constant("pressure", 6e6 + 2e6 * s)

    with Daemon(at_pressure("seat-hydraulic", "roll", 6e6), "roll", ("exact",)) as daemon:
        found = swept(daemon, "ps", pressure, 1.0)["exact"]
    assert found["ps"][0] < 6.5e6 < 7.5e6 < found["ps"][-1]
    assert found["omega_n"][-1] > found["omega_n"][0]


def test_a_fault_is_told():
    config = at_pressure("seat-hydraulic", "roll", 7e6)
    with Daemon(config, "roll", ("exact",)) as daemon, pytest.raises(PaperError, match="e_a"):
        daemon.set(e_a=1e3)


def test_the_same_seed_is_the_same_run_and_another_is_not():
    def run(seed: int) -> float:
        with Daemon(rig("seat-hydraulic"), "roll", ("exact",), seed) as daemon:
            daemon.start()
            daemon.run(0.3)
            return middle(daemon.told.estimates["exact"], "omega_n")

    assert run(1) == run(1) != run(2)


def test_the_servo_motor_has_the_gain_that_was_measured():
    bench = Bench("servo-hydraulic", "motor", parts={"supply": {"droop": 0.0}, "load": {"coulomb": 0.0}})
    for ps in (5e6, 7.5e6, 10e6):
        assert bench.true(ps, 32.5)["K_L"] == pytest.approx(4.25 + 2.72e-6 * ps - 0.134e-12 * ps**2, rel=1e-6)


def test_simulation_lies_on_the_exact_curves_and_eq_8_does_not():
    n = figure_4()
    assert 0.005 < n["worst_xi"] < 0.01
    exact = {0.2: (0.99872, 1.27573), 1.0: (0.97801, 1.31663), 4.0: (0.93477, 1.41561)}
    for zeta, xi, gamma in zip(n["zeta_simulated"], n["xi_simulated"], n["Gamma_simulated"], strict=True):
        if zeta in exact:
            assert (xi, gamma) == pytest.approx(exact[zeta], rel=2e-5)


def test_response_and_small_signals_agree_where_the_amplitude_is_small():
    clean = {"valve": {"omega": 5000.0}, "load": {"coulomb": 0.0}, "supply": {"ripple": 0.0}}
    bench = Bench("seat-hydraulic", "roll", parts=clean, noise=1e-9, clean=True)
    fit = bench.response(0.005, (3.0, 60.0), period=1.0).fit.plant
    true = bench.true()
    assert fit.omega_n == pytest.approx(true["omega_n"], rel=0.01)
    assert pytest.approx(true["K_L"], rel=0.02) == fit.K_L


def test_the_gain_of_quick_movements_is_the_steady_one_but_of_a_single_rod():
    roll, rudder = (Bench(f"{rig}-hydraulic", axis) for rig, axis in (("seat", "roll"), ("tail", "rudder")))
    assert roll.quick_gain(7e6, 0.0) == pytest.approx(roll.true(7e6)["K_L"], rel=0.01)
    assert rudder.quick_gain(7e6, 0.0) > 1.05 * rudder.true(7e6)["K_L"]


def test_a_larger_relay_finds_another_plant():
    bench = Bench("seat-hydraulic", "roll", parts={"load": {"coulomb": 0.0}}, noise=0.0, clean=True)
    from seod.paper.answers import answer as steady

    small, large = (
        steady(bench, bench.relay(1.0, e, hysteresis=1e-5 * e), "exact", 1e-5 * e) for e in (0.05, 1.0)
    )
    assert large["zeta"] > 1.3 * small["zeta"]


def test_parts():
    assert exponent([1.0, 2.0, 4.0], [3.0, 6.0, 12.0]) == pytest.approx(1.0)
    assert merged({"a": {"x": 1.0}}, {"a": {"y": 2.0}}) == {"a": {"x": 1.0, "y": 2.0}}
    assert kept({"a": [1.23456789012, float("nan")]}) == {"a": [1.23456789, None]}
    assert _largest([0.1, 1.0], [0.002, 0.2]) == pytest.approx(0.1 * 10**0.5)
    assert _largest([0.1, 1.0], [0.03, 0.01]) is None
    assert answer([])["quality"] == "no_oscillation"


@pytest.fixture
def short(monkeypatch):
    """Figures of shorter runs, fewer pressures and mechanisms, by the methods that take no search."""
    for name in ("SETTLED_S", "STEADY_S", "SWEEP_S"):
        monkeypatch.setattr(figures, name, 0.3)
    along, response = figures._along_pressure, Bench.response
    monkeypatch.setattr(figures, "_along_pressure", lambda bench, ps, *more: along(bench, ps[:3], *more))
    monkeypatch.setattr(Bench, "response", lambda *at, **of: response(*at, **of, period=0.5))
    monkeypatch.setattr(figures, "LIVE", ("peaks", "exact"))
    monkeypatch.setattr(findings, "MECHANISMS", findings.MECHANISMS[:2])
    monkeypatch.setattr(findings, "AXES", tuple((*of, sizes[:2]) for *of, sizes in findings.AXES))


def test_every_figure_is_the_same_numbers_again(short):
    first = {figure: json.dumps(command.compute(figure)) for figure in command.WEIGHTS}
    again = {figure: json.dumps(command.compute(figure)) for figure in reversed(command.WEIGHTS)}
    assert first == again


def test_pictures_numbers_and_page_are_the_same_bytes_twice(tmp_path: Path):
    first, second = (command.write(NUMBERS, tmp_path / name) for name in ("a", "b"))
    assert set(NUMBERS) == set(command.WEIGHTS)
    assert {path.suffix for path in first} == {".svg", ".png", ".json", ".html"}
    assert [path.read_bytes() for path in first] == [path.read_bytes() for path in second]
    assert json.loads((tmp_path / "a" / "paper.json").read_text()) == NUMBERS
    page = (tmp_path / "a" / "paper.html").read_text()
    assert "0.45" in page
    assert "<img src='figure-11.svg'" in page


def test_every_figure_has_words_and_a_picture():
    assert set(words.TITLES) == set(words.SAYS) == set(pictures.PICTURES) == set(command.WEIGHTS)


def test_an_unknown_figure_is_told():
    result = CliRunner().invoke(app, ["paper", "--figure", "5"])
    assert result.exit_code == 2 or result.exit_code == 1
    assert "there are 4, 10" in result.output


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--scheduler", "host:8786"), "give local, or an address"),
        (("--scheduler", "tcp://host:8786", "--workers", "2"), "has its own"),
    ],
)
def test_a_scheduler_that_is_none_is_refused(options, said):
    result = CliRunner().invoke(app, ["paper", *options])
    assert result.exit_code == 1
    assert said in str(result.exception or "") + result.output


def test_a_figure_that_cannot_be_computed_is_told(monkeypatch):
    def fails(_figure):
        raise PaperError("the rig stands still")

    monkeypatch.setattr(command, "compute", fails)
    with pytest.raises(StoppedError, match="figure 4: PaperError: the rig stands still"):
        command.compute_all(["4"], lambda *_: None, command.executor(workers=0))
