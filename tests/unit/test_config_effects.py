"""Effects of simulated plants in rig files: checked, named with their line, known to editors."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from seod.config.load import ConfigErrors, load_text
from seod.config.schema import rig_schema
from seod.config.truth import truth
from seod.config.yaml_lines import parse
from seod.files.shipped import configs_dir
from sim.config import PlantConfig, SimulationConfig
from sim.effects import EFFECTS, contradiction
from sim.parameters import plant_parameters

VIRTUAL = (configs_dir() / "virtual.yaml").read_text()
COUNTS = "        sensor_quantization: {step: 1.0e-6}   # [rad]\n"
LINE = VIRTUAL[: VIRTUAL.index(COUNTS)].count("\n") + 1
PLANT = {"input": "u", "output": "y", "K_L": 17.0, "omega_n": 100.0, "zeta": 0.3}


def with_effects(*lines: str) -> str:
    assert COUNTS in VIRTUAL
    return VIRTUAL.replace(COUNTS, "".join(f"        {line}\n" for line in lines))


def errors_of(text: str) -> list[tuple[int, str, str]]:
    with pytest.raises(ConfigErrors) as caught:
        load_text(text, "x.yaml", configs_dir())
    return [(e.line, e.key.rpartition("effects.")[2], f"{e.message}; {e.right}") for e in caught.value.errors]


def test_all_that_is_wrong_is_told_at_once_each_at_its_line() -> None:
    wrong = [
        ("valve_leg: {time: 1}", "valve_leg", "did you mean 'valve_lag'?"),
        ("valve_deadband: {width: 1}", "valve_deadband.width", "did you mean 'half_width'?"),
        ("valve_lag: {time: 500}", "valve_lag.time", "must be <= 100, got 500"),
        ("coulomb_friction: {level: .inf}", "coulomb_friction.level", "must be a finite number"),
        ("sensor_lag: {time: 2 ms}", "sensor_lag.time", 'must be a number, got "2 ms"'),
        ("backlash: 3", "backlash", "must be a mapping of keys to values"),
        ("null_shift:", "null_shift", "must be a mapping of keys to values"),
    ]
    errors = errors_of(with_effects(*[line for line, _, _ in wrong]))
    assert [(line, key) for line, key, _ in errors] == [
        (LINE + k, key) for k, (_, key, _) in enumerate(wrong)
    ]
    for (_, _, told), (_, _, fragment) in zip(errors, wrong, strict=True):
        assert fragment in told


def test_bristles_without_a_force_at_which_they_give_way_are_refused() -> None:
    ((_, _, told),) = errors_of(with_effects("lugre_friction: {stiffness: 1.0e4}"))
    assert "needs coulomb_friction.level > 0" in told


def values(effect: Any) -> st.SearchStrategy[dict[str, float]]:
    numbers = {p.name: st.floats(p.low, min(p.high, 1e9)) for p in effect.parameters}
    return st.fixed_dictionaries({}, optional=numbers)


@given(effects=st.fixed_dictionaries({}, optional={e.name: values(e) for e in EFFECTS.values()}))
def test_effects_within_their_ranges_survive_the_way_to_the_kernel(effects: dict[str, Any]) -> None:
    if contradiction(effects):
        with pytest.raises(ValidationError):
            PlantConfig.model_validate({**PLANT, "effects": effects})
        return
    plant = PlantConfig.model_validate({**PLANT, "effects": effects})
    again = PlantConfig.model_validate_json(plant.model_dump_json())
    assert again == plant
    record = plant_parameters(again)
    for name, parameters in effects.items():
        for of, value in parameters.items():
            assert record[f"{name}_{of}"][0] == value


@pytest.mark.slow
def test_editors_know_each_effect_with_its_ranges() -> None:
    import jsonschema  # a second of processor time

    schema = rig_schema()
    validator = jsonschema.Draft202012Validator(schema)
    validator.validate(parse(with_effects("backlash: {gap: 0.01}")).value)
    for line in ("backlash: {gab: 0.01}", "backlash: {gap: -1}", "backlsh: {gap: 1}"):
        with pytest.raises(jsonschema.ValidationError):
            validator.validate(parse(with_effects(line)).value)
    gap = schema["$defs"]["backlash"]["properties"]["gap"]
    assert "[unit] the whole gap" in gap["description"]


@pytest.mark.parametrize(
    ("changes", "constants", "why"),
    [
        ({"supply_pressure": "ps"}, {"ps": 7e6}, "supply_pressure and nominal_pressure go together"),
        ({"nominal_temperature": 40.0}, {}, "temperature and nominal_temperature go together"),
        ({"supply_pressure": "ps", "nominal_pressure": 7e6}, {"p": 7e6}, "'ps', no constant; there are p"),
        ({"supply_pressure": "ps", "nominal_pressure": 7e6}, {"ps": 0.0}, "a supply pressure must be > 0"),
        ({"temperature": "T", "nominal_temperature": 40.0}, {}, "'T', no constant; there are none"),
    ],
)
def test_conditions_are_constants_with_nominal_values(
    changes: dict[str, Any], constants: dict[str, float], why: str
) -> None:
    document = {"plants": {"motor": {**PLANT, **changes}}, "constants": constants}
    with pytest.raises(ValidationError, match=why):
        SimulationConfig.model_validate(document)


def test_the_truth_is_that_of_small_movements_and_unchanged_without_effects() -> None:
    def true(*effects: str) -> dict[str, float | None]:
        config = load_text(with_effects(*effects), "x.yaml", configs_dir())
        return truth(config)["motor"]

    assert true("{}") == {"K_L": 17.0, "omega_n": 117.0, "zeta": 0.21}
    unequal = true("asymmetric_gain: {ratio: 0.1}")
    assert unequal["K_L"] == pytest.approx(17.0 * 1.1)
    cannot = true("square_root_flow: {supply: 100}", "load_bias: {acceleration: 200}")
    assert set(cannot.values()) == {None}
