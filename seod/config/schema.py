"""JSON schema of the rig file, for editors: `python -m seod.config.schema` writes it beside the examples."""

from __future__ import annotations

import json
from typing import Any

from drivers import TABLE, driver_class
from seod.config.model import RigConfig
from seod.config.schema_words import described
from seod.files.shipped import configs_dir

FILE_NAME = "seod-rig.schema.json"


def rig_schema() -> dict[str, Any]:
    """The schema, with the options of all built-in drivers; each key tells meaning, unit, range, default."""
    schema = RigConfig.model_json_schema()
    options = [_driver_schema(kind) for kind in sorted(TABLE)]
    for option in options:
        schema["$defs"].update(option.pop("$defs", {}))
    about = schema["properties"]["driver"].get("description", "")
    schema["properties"]["driver"] = {"oneOf": options, "description": about}
    top = {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": "seod rig file", **schema}
    return described(top)


def _driver_schema(kind: str) -> dict[str, Any]:
    schema = driver_class(kind).Options.model_json_schema()
    schema["properties"].pop("simulation", None)  # filled from the section at the top level
    return schema


def schema_text() -> str:
    """The schema as it is committed."""
    return json.dumps(rig_schema(), indent=2, sort_keys=True) + "\n"


def main() -> None:
    """Write the file."""
    (configs_dir() / FILE_NAME).write_text(schema_text(), encoding="utf-8")


if __name__ == "__main__":
    main()
