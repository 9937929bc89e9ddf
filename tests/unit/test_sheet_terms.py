"""Terms of the standard on the sheet, against formulae and simulations written apart."""

from __future__ import annotations

import json
import math
import re

import numpy as np
import pytest
from scipy import signal
from sheet_rows import HYSTERESIS, row, sheet_of, term

from seod.calibrate.value import measured
from seod.cli import app
from seod.sheet import second_order
from seod.sheet.response import read_response
from seod.sheet.rig import of_file
from seod.sheet.segments import SheetError


@pytest.mark.parametrize("zeta", [0.02, 0.21, 0.45, 0.70, 0.9999999, 1.0, 1.3, 5.0])
def test_frequencies_are_those_of_the_transfer_function(zeta):
    def first(beyond):
        """Of all frequencies; then of those beside it."""
        omega = np.geomspace(1e-3, 1e3, 20_001)
        for _ in range(2):
            k = np.argmax(beyond(signal.freqs([1.0], [1.0, 2.0 * zeta, 1.0], omega)[1]))
            found, omega = omega[k], np.geomspace(omega[k - 1], omega[k], 1001)
        return found

    assert second_order.bandwidth(zeta) == pytest.approx(
        first(lambda G: 20.0 * np.log10(np.abs(G)) < -3.0), rel=2e-5
    )
    assert second_order.phase_90(zeta) == pytest.approx(
        first(lambda G: np.degrees(np.unwrap(np.angle(G))) < -90.0), rel=2e-5
    )


@pytest.mark.slow
@pytest.mark.parametrize("zeta", [0.05, 0.21, 0.45, 0.69, 0.9, 1.0, 1.3, 5.0])
def test_step_figures_are_those_of_a_simulated_step(zeta):
    t = np.linspace(0.0, 120.0, 600_001)
    (b,), a, _ = signal.cont2discrete(([1.0], [1.0, 2.0 * zeta, 1.0]), t[1])
    y = signal.lfilter(b, a, np.ones(len(t)))
    rise = t[np.argmax(y >= 0.9)] - t[np.argmax(y >= 0.1)]
    outside = np.flatnonzero(np.abs(y - 1.0) > 0.05)
    assert second_order.rise_time(zeta) == pytest.approx(rise, abs=1e-3)
    assert second_order.overshoot(zeta) == pytest.approx(max(0.0, y.max() - 1.0), abs=1e-6)
    assert second_order.settling_time(zeta) == pytest.approx(t[outside[-1]], abs=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("of", "power"),
    [(second_order.bandwidth, 1), (second_order.rise_time, -1), (second_order.settling_time, -1)],
)
def test_intervals_are_those_of_a_monte_carlo(of, power):
    # at zeta 0.21 the settling time jumps between half cycles within the interval
    zeta, omega = measured(0.21, 0.008, math.inf), measured(117.0, 1.2, math.inf)
    found = second_order.propagated(of, zeta, omega, power)
    rng = np.random.default_rng(1)
    drawn = (
        np.array([of(z) for z in rng.normal(0.21, 0.008, 20_000)]) * rng.normal(117.0, 1.2, 20_000) ** power
    )
    low, high = np.quantile(drawn, (0.025, 0.975))
    assert found.value == pytest.approx(of(0.21) * 117.0**power)
    wide = high - low
    assert found.interval == (pytest.approx(low, abs=0.03 * wide), pytest.approx(high, abs=0.03 * wide))


# -- trends ----------------------------------------------------------------------------------------


def test_what_was_not_measured_says_which_command_does_it():
    sheet = sheet_of([row(quality="noisy")])
    commands = {each.name or each.callback.__name__.rstrip("_") for each in app.registered_commands}
    terms = sheet.axes[0].terms
    assert len({each.term for each in terms}) == 9
    for each in terms:
        assert each.value is None
        assert each.how == "not measured"
        assert re.search(r"seod (\w+)", each.source)[1] in commands


def test_hysteresis_is_twice_the_half_width_of_the_newest_diagnosis_that_names_it():
    rows = [row(0, verdict="effects", causes=HYSTERESIS), row(1, verdict="clean", causes="[]")]
    (found,) = term(sheet_of(rows), "hysteresis")
    assert found.value == pytest.approx(0.04)
    assert found.interval == pytest.approx((0.038, 0.044))
    assert "day0-0.mcap (2026-11-01)" in found.source
    (none,) = term(sheet_of(rows[1:]), "hysteresis")
    assert none.value is None
    assert "no diagnosis names it, the newest of day1-0.mcap" in none.source


CALIBRATION = """
    calibration:
      date: 2026-10-30
      K_L: {value: 17.1, sd: 0.01, interval: [17.08, 17.12]}
      K_L_up: {value: 17.2, sd: 0.01, interval: [17.18, 17.22]}
      null: {value: 0.02, sd: 1.0e-5, interval: [0.01998, 0.02002]}
      deadband_up: {interval: [0.0202, 0.0205]}
      deadband_down: {interval: [0.0195, 0.0198]}
      delay: {value: 0.0, sd: 1.0e-5, interval: [-2.0e-5, 2.0e-5]}
"""


def calibrated(folder, name="seat"):
    """A rig file with a calibration."""
    from seod.files.shipped import configs_dir

    text = (configs_dir() / "virtual.yaml").read_text().replace("rig: virtual-motor", f"rig: {name}")
    assert "\nguard:\n" in text
    path = folder / "rig.yaml"
    path.write_text(text.replace("\nguard:\n", f"{CALIBRATION.rstrip()}\n\nguard:\n", 1))
    return path


def test_a_calibration_gives_flow_gain_null_bias_and_a_bound_of_the_threshold(tmp_path):
    rig = of_file(calibrated(tmp_path), "seat")
    sheet = sheet_of([row(axis="motor")], rig=rig)
    mean, up = term(sheet, "flow gain")
    assert (mean.value, mean.interval, mean.unit) == (17.1, (17.08, 17.12), "rad/s/V")
    assert up.value == 17.2
    (null,) = term(sheet, "null bias")
    assert null.value == 0.02
    assert "2026-10-30" in null.source
    (threshold,) = term(sheet, "threshold")
    assert threshold.at_most
    assert threshold.value == pytest.approx(0.0205 - 0.0195)
    assert threshold.interval == pytest.approx((0.0202 - 0.0198, 0.0205 - 0.0195))
    with pytest.raises(SheetError, match="of 'seat', not of 'other'"):
        of_file(tmp_path / "rig.yaml", "other")


def response_file(path, *, output="position", band=(0.5, 60.0), noise=0.0):
    """What `seod response --json` prints, of a plant of K_L 17, omega_n 117, zeta 0.21."""
    omega = math.tau * np.geomspace(*band, 160)
    G = 17.0 / (1.0 - (omega / 117.0) ** 2 + 0.42j * omega / 117.0)
    if output == "position":
        G = G / (1j * omega)
    sd = np.abs(G) * 0.01
    rng = np.random.default_rng(3)
    G = G + noise * sd * (rng.normal(size=len(G)) + 1j * rng.normal(size=len(G)))
    points = [
        {"omega": w, "real": g.real, "imag": g.imag, "sd": s}
        for w, g, s in zip(omega.tolist(), G.tolist(), sd.tolist(), strict=True)
    ]
    known = {"K_L": 17.0, "omega_n": 117.0, "zeta": 0.21, "delay": 0.0}
    fit = {name: {"value": value, "sd": 0.01 * value} for name, value in known.items()}
    path.write_text(json.dumps({"output": output, "quality": "ok", "points": points, "fit": fit}))
    return path


@pytest.mark.parametrize("output", ["position", "velocity"])
def test_a_measured_response_gives_minus_3_db_and_minus_90_deg(output, tmp_path):
    found = read_response(response_file(tmp_path / "bode.json", output=output))
    assert found.minus_90_deg().value == pytest.approx(117.0 / math.tau, rel=1e-3)
    omega = np.geomspace(100.0, 300.0, 1_000_001)  # by search, against the gain at low frequency
    gain = np.abs(1.0 / (1.0 - (omega / 117.0) ** 2 + 0.42j * omega / 117.0))
    by_search = omega[np.argmax(20.0 * np.log10(gain) < -3.0)] / math.tau
    assert found.minus_3_db().value == pytest.approx(by_search, rel=3e-3)
    assert found.gain.value == pytest.approx(17.0, rel=5e-3)


def test_intervals_of_a_noisy_response_hold_the_truth(tmp_path, monkeypatch):
    hits = 0
    for seed in range(100):
        monkeypatch.setattr(
            np.random, "default_rng", lambda _, s=seed: np.random.Generator(np.random.PCG64(s))
        )
        low, high = read_response(response_file(tmp_path / "b.json", noise=1.0)).minus_90_deg().interval
        hits += low <= 117.0 / math.tau <= high
    assert hits >= 85  # where points fall through -90 deg twice, the first counts


def test_beyond_the_band_it_is_not_measured_but_calculated(tmp_path):
    narrow = read_response(response_file(tmp_path / "bode.json", band=(0.5, 10.0)))
    sheet = sheet_of([row()], responses={"roll": [narrow]})
    none, calculated = term(sheet, "frequency response, -3 dB")
    assert none.how == "not measured"
    assert "not reached between 0.5 and 10 Hz" in none.source
    assert calculated.how == "calculated"
    assert calculated.value == pytest.approx(second_order.bandwidth(0.21) * 117.0 / math.tau)
    assert "zeta and omega_n of 2026-11-01" in calculated.source


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"output": "position", "points": [], "fit": {}}', "\xff"])
def test_a_file_that_is_no_response_says_so(text, tmp_path):
    path = tmp_path / "x.json"
    path.write_text(text)
    with pytest.raises(SheetError, match=r"x.json: is no answer of `seod response --json`"):
        read_response(path)
    with pytest.raises(SheetError, match="is a folder"):
        read_response(tmp_path)


# -- findings --------------------------------------------------------------------------------------
