"""The editors' schema is the models', the examples fit it, and units mean what they say."""

from __future__ import annotations

import json
import math
from functools import cache
from pathlib import Path
from typing import Any

import pytest

import seod.files.shipped
from seod.config.schema import FILE_NAME, rig_schema, schema_text
from seod.config.units import UNITS, dimension_of, parse_quantity
from seod.config.yaml_lines import parse
from seod.files.shipped import configs_dir

EXAMPLES = sorted(configs_dir().glob("*.yaml"))


@cache
def validator() -> Any:
    """Of the models' schema, which takes 0.1 s to make: that it is one is a test of its own."""
    import jsonschema  # a second of processor time

    return jsonschema.Draft202012Validator(rig_schema())


def test_the_committed_schema_is_the_models() -> None:
    committed = (configs_dir() / FILE_NAME).read_text()
    assert committed == schema_text(), "run: python -m seod.config.schema"


@pytest.mark.slow
def test_the_schema_is_one() -> None:
    validator().check_schema(rig_schema())


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.name)
def test_the_examples_fit_the_schema_and_name_it(path: Path) -> None:
    text = path.read_text()
    assert text.startswith(f"# yaml-language-server: $schema={FILE_NAME}\n")
    validator().validate(parse(text).value)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        (("loop", "rat_hz"), 2000),
        (("driver", "kind"), "cna"),
        (("driver", "reeltime"), True),
        (("driver", "simulation"), {}),
        (("axes", "motor", "relay", "e_a"), "30 deg"),
        (("axes", "motor", "limits", "travel"), [1]),
        (("sensors", "angle", "unit"), "degs"),
        (("version",), 2),
    ],
)
def test_the_schema_finds_what_an_editor_should_mark(key: tuple[str, ...], value: object) -> None:
    document = parse((configs_dir() / "virtual.yaml").read_text()).value
    *sections, last = key
    section = document
    for name in sections:
        section = section[name]
    section[last] = value
    from jsonschema import ValidationError

    with pytest.raises(ValidationError):
        validator().validate(document)


def test_editors_can_show_what_a_key_means() -> None:
    relay = rig_schema()["$defs"]["RelayConfig"]["properties"]
    assert all("description" in key for key in relay.values())


@pytest.mark.parametrize(
    ("text", "dimensions", "si"),
    [
        ("30 deg", ("angle", "length"), math.pi / 6),
        ("1 rev", ("angle",), 2 * math.pi),
        ("-2.5e1mm", ("length",), -0.025),
        (" .5 kHz ", ("frequency",), 500.0),
        ("7 MPa", ("pressure",), 7e6),
        ("90 deg/s", ("angular speed",), math.pi / 2),
        (3, ("voltage",), 3.0),
    ],
)
def test_quantities_become_si(text: object, dimensions: tuple[str, ...], si: float) -> None:
    assert parse_quantity(text, *dimensions) == pytest.approx(si)


@pytest.mark.parametrize(
    "text", ["5", "V", "5 V V", "0x5 V", "1e V", "", "5 m", True, None, [1], "nan V", "٣ V"]
)
def test_what_is_no_voltage_is_refused_with_the_units_that_are_right(text: object) -> None:
    with pytest.raises(ValueError, match="V, mV"):
        parse_quantity(text, "voltage")


def test_the_dimension_of_what_is_written() -> None:
    assert [dimension_of(value) for value in ("3 mm", "2 rad/s", "2", 2, "2 parsec", None)] == [
        "length", "angular speed", None, None, None, None,
    ]  # fmt: skip


def test_every_unit_has_a_positive_factor() -> None:
    assert all(factor > 0 for _, factor in UNITS.values())


def test_files_are_found_in_a_checkout_and_as_installed(tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert configs_dir() == Path(seod.files.shipped.__file__).parents[2] / "configs"
    installed = tmp_path / "prefix" / "share" / "seod" / "configs"
    installed.mkdir(parents=True)
    (installed / "virtual.yaml").write_text("")
    monkeypatch.setattr(seod.files.shipped, "__file__", str(tmp_path / "lib/seod/files/shipped.py"))
    monkeypatch.setattr(seod.files.shipped.sysconfig, "get_path", lambda *_: str(tmp_path / "prefix"))
    assert configs_dir() == installed
    (installed / "virtual.yaml").unlink()
    with pytest.raises(FileNotFoundError, match=r"configs/virtual\.yaml"):
        configs_dir()


def test_the_schema_text_is_stable() -> None:
    assert json.loads(schema_text()) == rig_schema()
