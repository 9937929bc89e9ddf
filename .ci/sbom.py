"""What the daemon is made of (`make sbom`): build/sbom.json, CycloneDX, about this version."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import seod

OUT = Path("build/sbom.json")


def main() -> int:
    """cyclonedx-py reads the lock and pyproject.toml, where the version is not."""
    program = Path(sys.executable).with_name("cyclonedx-py")
    about = ["--pyproject", "pyproject.toml", "--mc-type", "application"]
    OUT.parent.mkdir(exist_ok=True)
    made = [program, "requirements", *about, "requirements-run.lock", "--output-reproducible", "-o", OUT]
    done = subprocess.run(made, check=False, capture_output=True, text=True)  # noqa: S603 - our own
    if done.returncode:
        print(done.stderr, file=sys.stderr)
        return done.returncode
    told = json.loads(OUT.read_text("utf-8"))
    component = told["metadata"]["component"]
    component |= {"version": seod.__version__, "purl": f"pkg:pypi/seod@{seod.__version__}"}
    parts = [each["bom-ref"] for each in told["components"]]
    told["dependencies"] = [
        {"ref": component["bom-ref"], "dependsOn": sorted(parts)},
        *(each for each in told["dependencies"] if each["ref"] != component["bom-ref"]),
    ]
    OUT.write_text(json.dumps(told, indent=1, sort_keys=True) + "\n", "utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
