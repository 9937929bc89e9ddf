"""What the daemon is made of (`make sbom`): build/sbom.json, CycloneDX, about this version."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

OUT = Path("build/sbom.json")


def version() -> str:
    """Of this checkout, whatever is installed."""
    found = re.search(r'^__version__ = "(.+)"$', Path("seod/__init__.py").read_text("utf-8"), re.M)
    return found[1] if found else ""


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
    component |= {"version": version(), "purl": f"pkg:pypi/seod@{version()}"}
    parts = [each["bom-ref"] for each in told["components"]]
    told["dependencies"] = [
        {"ref": component["bom-ref"], "dependsOn": sorted(parts)},
        *(each for each in told["dependencies"] if each["ref"] != component["bom-ref"]),
    ]
    OUT.write_text(json.dumps(told, indent=1, sort_keys=True) + "\n", "utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
