"""docs/serial.md says what the rig file takes, and how a board to try it with is built."""

from __future__ import annotations

import re
import shutil
import struct
import subprocess
import time
from pathlib import Path
from typing import Any

import pytest

from drivers.serial import SerialDriver
from drivers.serial_config import CODES, FieldOptions, SerialOptions
from tests.unit.serial_bench import until

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "serial.md").read_text()


def rows(*heads: str) -> dict[str, list[str]]:
    """Those of the tables that begin with these columns, by their first cell."""
    found, inside = {}, False
    for line in PAGE.splitlines():
        cells = [cell.strip().strip("`") for cell in line.strip("|").split("|")]
        if not line.startswith("|"):
            inside = False
        elif tuple(cells[: len(heads)]) == heads:
            inside = True
        elif inside and not cells[0].startswith("---"):
            found[cells[0]] = cells[1:]
    return found


def expected(schema: dict[str, Any]) -> tuple[str, str]:
    """Type and range, as the page would have them ("" where nothing is to be said)."""
    kind = {"integer": "whole number", "number": "number", "string": "text", "boolean": "true`, `false"}
    told = kind.get(schema.get("type", "string"), "list of")
    if "exclusiveMinimum" in schema:
        return told, f"above {schema['exclusiveMinimum']:g}"
    if "maximum" in schema:
        return told, f"{schema['minimum']} to {schema['maximum']}"
    return told, "`, `".join(schema.get("enum", [])) if len(schema.get("enum", [])) < 5 else "see below"


@pytest.mark.parametrize("model", [SerialOptions, FieldOptions])
def test_every_key_is_there_with_its_type_range_and_default(
    model: type[SerialOptions | FieldOptions],
) -> None:
    table, fields = rows("key", "type", "range", "default"), model.model_fields
    others = SerialOptions.model_fields | FieldOptions.model_fields
    assert table.keys() == others.keys()
    for name, schema in model.model_json_schema()["properties"].items():
        kind, bounds, default, meaning = table[name]
        told, told_bounds = expected(schema)
        assert kind.startswith(told), name
        assert bounds.startswith(told_bounds), name
        assert default.strip('"') == (
            "required" if fields[name].is_required() else str(fields[name].default).lower()
        )
        assert meaning


def test_every_type_is_there_with_its_code_and_numbers() -> None:
    table = rows("type", "code in the layout")
    assert {name: cells[0] for name, cells in table.items()} == CODES
    for name, (code, size, numbers) in table.items():
        field = FieldOptions.model_validate({"name": "x", "type": name})
        assert int(size) == struct.calcsize("<" + code)
        assert tuple(float(end) for end in numbers.split(" to ")) == field.numbers


def test_the_documented_line_builds_a_board_that_answers(tmp_path: Path) -> None:
    (line,) = re.findall(r"^gcc .*$", PAGE, re.MULTILINE)
    if shutil.which("gcc") is None:
        pytest.fail("no gcc: `apt-get install gcc libc6-dev`")
    (tmp_path / "drivers").symlink_to(ROOT / "drivers")
    subprocess.run(line.split(), check=True, cwd=tmp_path)
    link = tmp_path / "seod-board"
    board = subprocess.Popen(["./board", link], cwd=tmp_path, stdout=subprocess.PIPE)
    assert board.stdout is not None
    try:
        assert b"ready" in board.stdout.readline()
        inputs = [{"name": "angle", "type": "int32"}, {"name": "run_enable", "type": "uint8"}]
        section = {"kind": "serial", "port": str(link), "inputs": inputs, "usb": True}
        outputs = [{"name": "valve", "type": "int16"}]
        driver = SerialDriver(SerialOptions.model_validate({**section, "outputs": outputs}), time.monotonic)
        driver.open(["run_enable"], ["valve"])
        driver.start()
        until(lambda: driver.read(time.monotonic())[0].value == 1.0)
        driver.close()
    finally:
        board.terminate()
        board.wait()
        board.stdout.close()
