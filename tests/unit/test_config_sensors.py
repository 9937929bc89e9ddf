"""Sensor sections of a rig file: what is wrong is told with its line; today's files go on as they are."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
import yaml

from seod.config.load import load_text
from seod.config.model import RigConfig
from seod.config.sensors import LinearConfig, sensor_or_none
from seod.config.truth import truth
from seod.config.units import parse_quantity, to_si
from seod.files.shipped import configs_dir
from tests.unit.test_config_load import VIRTUAL, edited, errors_of, line_of

PLAIN = """  angle:
    channel: encoder
    unit: rad
"""
OUTPUT = "      output: encoder\n"

ENCODER = """  angle:
    kind: incremental_encoder
    channel: encoder
    unit: deg
    bits: 16
    counts_per_rev: 20000
"""
COUNTS = "      sensor: {kind: incremental_encoder, bits: 16, counts_per_unit: 3183.098861837907}\n"

SCALE = """  angle:
    kind: linear_scale
    channel: encoder
    unit: mm
    linkage:
      crank: {base: 500 mm, rod: 500 mm, arm: 0.1}
"""
STROKE = "      sensor: {kind: linear_scale, scale: 1000, crank: {base: 0.5, rod: 0.5, arm: 0.1}}\n"

TABLE = """  angle:
    kind: linear_scale
    channel: encoder
    unit: mm
    linkage:
      unit: deg
      table:
        stroke: [-60, 0, 60]
        angle: [-70, 0, 70]
"""


def rig(section: str, simulated: str = "") -> str:
    return edited(edited(VIRTUAL, PLAIN, section), OUTPUT, OUTPUT + simulated)


def test_a_sensor_of_no_kind_is_linear() -> None:
    sensor = load_text(VIRTUAL, "x.yaml", configs_dir()).sensors["angle"]
    assert isinstance(sensor, LinearConfig)
    assert sensor.kind == "linear"


@pytest.mark.parametrize(("section", "simulated"), [(ENCODER, COUNTS), (SCALE, STROKE), (TABLE, STROKE)])
def test_kinds_load_and_survive_the_way_to_another_process(section: str, simulated: str) -> None:
    config = load_text(rig(section, simulated), "x.yaml", configs_dir())
    assert RigConfig.model_validate_json(config.model_dump_json()) == config
    assert config.sensors["angle"].dimension == "angle"
    assert truth(config)["motor"]["K_L"] == 17.0  # a plant behind a sensor of its own moves in SI


WRONG = [
    (ENCODER, "kind: incremental_encoder", "kind: incremental", "sensors.angle.kind", "mean 'incremental_en"),
    (ENCODER, "kind: incremental_encoder", "kind: 7", "sensors.angle.kind", "must name a kind, got 7"),
    (ENCODER, "unit: deg", "unit: bar", "sensors.angle.unit", "wrong unit 'bar': must be one of rad, mrad"),
    (ENCODER, "unit: deg", "unit: dge", "sensors.angle.unit", "unknown unit 'dge'"),
    (ENCODER, "    bits: 16\n", "", "sensors.angle.bits", "missing; add `bits:` (Width of the counter"),
    (ENCODER, "bits: 16", "bits: 16.5", "sensors.angle.bits", "must be a whole number"),
    (ENCODER, "bits: 16", "bits: 60", "sensors.angle.bits", "must be <= 48, got 60"),
    (ENCODER, "counts_per_rev: 20000", "counts_per_rev: 0", "sensors.angle.counts_per_rev", "must not be 0"),
    (ENCODER, "counts_per_rev: 20000", "lag: 0", "sensors.angle", "either counts_per_rev or counts_per_unit"),
    (ENCODER, "counts_per_rev: 20000", "count_per_rev: 2", "sensors.angle.count_per_rev", "'counts_per_rev'"),
    (ENCODER, "bits: 16", "bits: 16\n    scale: 2", "sensors.angle.scale", "known keys here: bits, channel"),
    (ENCODER, "bits: 16", "bits: 8\n    largest_step: 128", "sensors.angle.largest_step", "below half"),
    (ENCODER, "unit: deg", "unit: mm", "sensors.angle", "counts_per_rev needs an angle as unit, not mm"),
    (ENCODER, "bits: 16", "bits: 16\n    index: {channel: z}", "sensors.angle.index.channel", "channel 'z'"),
    (ENCODER, "bits: 16", "bits: 16\n    range: [5, 1]", "sensors.angle.range", "lower end must come first"),
    (ENCODER, "bits: 16", "bits: 16\n    lag: -1 ms", "sensors.angle.lag", "must be >= 0"),
    (ENCODER, "bits: 16", "bits: 16\n    lag: 1 mm", "sensors.angle.lag", "wrong unit 'mm'"),
    (SCALE, "unit: mm", "unit: deg", "sensors.angle.unit", "must be one of m, mm, um"),
    (SCALE, "rod: 500 mm", "rod: 700 mm", "sensors.angle.linkage.crank", "are no triangle"),
    (SCALE, "arm: 0.1", "arm: 0.1, sign: 2", "sensors.angle.linkage.crank.sign", "must be 1 or -1"),
    (SCALE, "      crank:", "      table: {stroke: [0, 1], angle: [0, 1]}\n      crank:",
     "sensors.angle.linkage", "either table or crank"),
    (TABLE, "[-60, 0, 60]", "[-60, 60]", "sensors.angle.linkage.table", "2 strokes, but 3 angles"),
    (TABLE, "[-60, 0, 60]", "[-60, 60, 0]", "sensors.angle.linkage.table", "stroke must ascend"),
    (TABLE, "[-70, 0, 70]", "[-70, 0, -1]", "sensors.angle.linkage.table", "rise or fall throughout"),
    (TABLE, "unit: deg", "unit: mm", "sensors.angle.linkage.unit", "must be one of rad, mrad, deg, rev"),
]  # fmt: skip


@pytest.mark.parametrize(("section", "old", "new", "key", "fragment"), WRONG)
def test_a_wrong_sensor_is_told_with_its_place(
    section: str, old: str, new: str, key: str, fragment: str
) -> None:
    text = rig(edited(section, old, new), STROKE if "linear_scale" in section else COUNTS)
    told = {where: (line, words) for line, where, words in errors_of(text)}
    assert key in told, told
    line, words = told[key]
    assert fragment in words
    last_key = key.rpartition(".")[2]
    if "missing" not in words:
        assert f"{last_key}:" in text.splitlines()[line - 1]


def test_a_simulated_plant_needs_the_sensor_that_is_believed_in() -> None:
    (line, key, words), *_ = errors_of(rig(ENCODER))
    assert (line, key) == (line_of(rig(ENCODER), "kind: incremental_encoder"), "sensors.angle.kind")
    assert "is incremental_encoder, but the sensor of the simulated plant 'motor' is linear" in words


def test_saturation_lies_within_the_range() -> None:
    section = PLAIN + "    range: [-2, 2]\n    saturation: [-3, 1]\n"
    assert [(key, "within range" in words) for _, key, words in errors_of(rig(section))] == [
        ("sensors.angle", True)
    ]


def test_travel_beyond_the_linkage_would_never_be_seen() -> None:
    text = edited(rig(TABLE, STROKE), "travel: [-60 deg, 60 deg]", "travel: [-75 deg, 60 deg]")
    ((line, key, words),) = errors_of(text)
    assert (line, key) == (line_of(text, "travel: [-75"), "limits.travel")
    assert "reads only -1.22173 to 1.22173: the limit would never be seen" in words


def test_units_with_a_zero_of_their_own() -> None:
    assert parse_quantity("40 degC", "temperature") == pytest.approx(313.15)
    assert to_si(1500.0, "rpm") == pytest.approx(157.0796327)
    assert to_si(-273.15, "degC") == pytest.approx(0.0)


def test_the_documents_example_is_right() -> None:
    text = (Path(__file__).parents[2] / "docs" / "sensors.md").read_text()
    block = re.search(r"```yaml\n(.*?)```", text, re.DOTALL)
    assert block is not None
    sensors = yaml.safe_load(block[1])["sensors"]
    assert len(sensors) == 3
    assert [name for name, section in sensors.items() if sensor_or_none(json.dumps(section)) is None] == []
