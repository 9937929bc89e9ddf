"""Rules of velocity mode and of the gain in a rig file: each mistake with its place and what is right."""

from __future__ import annotations

import pytest

from seod.config.gain import GainModel
from seod.config.load import ConfigErrors, load_text
from seod.config.model import RigConfig
from seod.files.shipped import configs_dir

VELOCITY = (configs_dir() / "virtual.yaml").read_text()
EQ_9 = "K_L: {polynomial: [4.25, 2.72e-6, -0.134e-12], range: [5 MPa, 10 MPa]} #"
for old, new in (
    ("    unit: rad\n", "    unit: rad/s\n  supply:\n    channel: ps\n    unit: MPa\n    kind: pressure\n"),
    ("mode: position ", "mode: velocity\n    reference: 32.5 rad/s\n    supply_pressure: supply # "),
    ("K_L: 17                     #", EQ_9),
    ("output: 2 V", "output: 10 V"),
    ("travel: [-60 deg, 60 deg]", "travel: [-40 rad/s, 170 rad/s]"),
    ("      speed: 60 rad/s           # twice what the limit cycle needs, and room for noise\n", ""),
    ("movement: 30 mrad", "movement: 3 rad/s"),
    ("      output: encoder\n", "      output: encoder\n      measures: velocity\n"),
    ("      stops: [-1.5, 1.5]        # [rad]\n", ""),
    ("  seed: 1  ", "  constants: {ps: 8.0}\n  seed: 1  "),
):
    assert VELOCITY.count(old) == 1, old
    VELOCITY = VELOCITY.replace(old, new)


POSITION = (configs_dir() / "virtual.yaml").read_text()
K_L_LINE = "K_L: 17                     #"
PHASES = "      # two_phase: {enabled: true}"


def errors_of(text: str) -> list[tuple[int, str, str]]:
    with pytest.raises(ConfigErrors) as caught:
        load_text(text, "x.yaml", configs_dir())
    return [(error.line, error.key, f"{error.message}; {error.right}") for error in caught.value.errors]


def test_a_velocity_axis_loads() -> None:
    axis = load_text(VELOCITY, "x.yaml", configs_dir()).axes["motor"]
    assert (axis.mode, axis.reference, axis.limits.speed, axis.trim) == ("velocity", 32.5, None, True)
    assert axis.limits.travel == (-40.0, 170.0)


def test_a_gain_of_which_nothing_is_known_begins_with_what_the_limits_say() -> None:
    text = POSITION.replace(K_L_LINE, "K_L: identified #")
    axis = load_text(text, "x.yaml", configs_dir()).axes["motor"]
    guess = axis.K_L
    assert guess == GainModel(identified=60.0 / 0.5)
    assert axis.two_phase
    again = RigConfig.model_validate_json(load_text(text, "x.yaml", configs_dir()).model_dump_json())
    assert again.axes["motor"] == axis


@pytest.mark.parametrize(
    ("K_L", "phases", "on"),
    [
        ("17", "enabled: true", True),
        ("17", "shift: 0.2", False),
        ("{identified: 15}", "cycles: 4", True),
        ("{identified: 15}", "enabled: false", False),
    ],
)
def test_two_phases_where_they_are_asked_for_or_needed(K_L: str, phases: str, on: bool) -> None:
    text = POSITION.replace(K_L_LINE, f"K_L: {K_L} #").replace(PHASES, f"      two_phase: {{{phases}}}")
    assert load_text(text, "x.yaml", configs_dir()).axes["motor"].two_phase is on


@pytest.mark.parametrize(
    ("old", "new", "key", "told"),
    [
        ("method: wave", "method: exact", "axes.motor.estimator.method", "identified by the method `wave`"),
        (PHASES, "      two_phase: {shift: 0.5}", "axes.motor.excitation.two_phase.shift", "0.4"),
        (PHASES, "      two_phase: {cycles: 1}", "axes.motor.excitation.two_phase.cycles", "2"),
        (
            PHASES,
            "      two_phase: {cycle: 3}",
            "axes.motor.excitation.two_phase.cycle",
            "did you mean 'cycles'",
        ),
    ],
)
def test_mistakes_about_two_phases_are_told(old: str, new: str, key: str, told: str) -> None:
    text = POSITION.replace(K_L_LINE, "K_L: identified #")
    assert text.count(old) == 1
    found = errors_of(text.replace(old, new))
    assert [each[1] for each in found] == [key]
    assert told in found[0][2]


def test_two_phases_need_wave() -> None:
    text = POSITION.replace(PHASES, "      two_phase: {enabled: true}").replace(
        "method: wave", "method: peaks"
    )
    assert "two-phase excitation is for the method `wave`" in errors_of(text)[0][2]


def test_a_speed_needs_a_first_guess() -> None:
    found = errors_of(VELOCITY.replace(EQ_9, "K_L: identified #"))
    assert found[0][1] == "axes.motor.K_L"
    assert "`K_L: {identified: 17}`" in found[0][2]
    assert load_text(VELOCITY.replace(EQ_9, "K_L: {identified: 15} #"), "x.yaml", configs_dir())


MISTAKES = [
    ("reference: 32.5 rad/s", "reference: 180 rad/s", "axes.motor.reference", "limits.travel, -40 to 170"),
    ("reference: 32.5 rad/s", "reference: 150 rad/s", "axes.motor.reference", "limits.output is 10 V"),
    ("reference: 32.5 rad/s", "reference: 32.5 m/s", "axes.motor.reference", "must be in rad/s"),
    ("    reference: 32.5 rad/s\n", "", "axes.motor.reference", "the speed about which it oscillates"),
    ("travel: [-40 rad/s, 170 rad/s]", "travel: [2, 170]", "axes.motor.limits.travel", "0 inside"),
    ("travel: [-40 rad/s,", "travel: [-40 rad,", "axes.motor.limits.travel[0]", "must be in rad/s"),
    ("hysteresis: 4 mrad", "hysteresis: 4 rad/s", "axes.motor.relay.hysteresis", "wrong unit"),
    ("output: 10 V\n", "output: 10 V\n      speed: 9\n", "axes.motor.limits.speed", "limits.travel is"),
    ("    sensor: angle", "    filter: 90 Hz\n    sensor: angle", "axes.motor.filter", "the integrator is"),
    ("    unit: rad/s\n", "    unit: rad\n", "axes.motor.sensor", "velocity control needs a speed"),
    ("supply_pressure: supply", "supply_pressure: suply", "axes.motor.supply_pressure", "did you mean"),
    ("supply_pressure: supply", "supply_pressure: angle", "axes.motor.supply_pressure", "one of Pa, kPa"),
    ("    supply_pressure: supply", "    #", "axes.motor.K_L", "which no sensor tells"),
    ("range: [5 MPa, 10 MPa]", "range: [10 MPa, 5 MPa]", "axes.motor.K_L", "lower end"),
    ("range: [5 MPa, 10 MPa]", "rnge: [5 MPa, 10 MPa]", "axes.motor.K_L.rnge", "did you mean 'range'"),
    ("measures: velocity", "measures: position", "simulation.plants.motor.measures", "`measures: velocity`"),
    ("mode: velocity", "mode: position", "axes.motor.reference", "belongs to velocity mode"),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "key", "told"), MISTAKES)
def test_each_mistake_is_told_with_its_place(old: str, new: str, key: str, told: str) -> None:
    assert VELOCITY.count(old) == 1
    text = VELOCITY.replace(old, new)
    errors = errors_of(text)
    found = [(line, words) for line, where, words in errors if where == key]
    assert found, errors
    assert told in found[0][1]
    assert 1 < found[0][0] <= len(text.splitlines())
